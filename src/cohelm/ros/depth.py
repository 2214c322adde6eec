"""A depth image as a scan: of what stands between two heights, the nearest along each beam."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints
from cohelm.robot.sensors import LidarModel
from cohelm.ros.floor import Floor

_ENCODINGS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
"""Of a pixel, and the metres of its one (REP-118)."""
_MOST_PIXELS = 640 * 480
"""So many are looked at; of a larger image every second or third of each row and column."""
_STEEPEST, _ASKEW = 60.0, 10.0
"""A camera may look up or down by so much, and lie on its side by so little [deg]."""
_MEASURED = 0.5
"""A beam along which fewer of the pixels measured something has seen nothing."""


class Intrinsics(NamedTuple):
    """A pinhole camera of rectified images, in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def stride(self) -> int:
        """Of so many neighbouring pixels, and rows, one is looked at."""
        return math.ceil(math.sqrt(self.width * self.height / _MOST_PIXELS))

    @property
    def gap(self) -> float:
        """Between two rays that are looked at, a metre away [m]."""
        return self.stride / min(self.fx, self.fy)


def info_topic(topic: str) -> str:
    """The topic of the images' CameraInfo, in the same namespace."""
    return f"{topic.rpartition('/')[0]}/camera_info"


def camera(info: Any, topic: str) -> Intrinsics:
    """Of a `sensor_msgs/msg/CameraInfo`: of its projection for rectified images, if there is one.
    CohelmError for numbers that are none of a camera."""
    p, k = [float(v) for v in info.p], [float(v) for v in info.k]
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if p[0] else (k[0], k[4], k[2], k[5])
    made = Intrinsics(int(info.width), int(info.height), fx, fy, cx, cy)
    if (
        not all(map(math.isfinite, made))
        or not (2 <= made.width <= 8192 and 2 <= made.height <= 8192)
        or not (0.05 < fx / made.width < 50.0 and 0.05 < fy / made.height < 50.0)
        or not (0.0 <= cx < made.width and 0.0 <= cy < made.height)
    ):
        raise CohelmError(
            f"{topic} describes no camera: {made.width} x {made.height} pixels, fx {fx:g} "
            f"fy {fy:g} cx {cx:g} cy {cy:g}; calibrate it, or fix its driver"
        )
    return made


def depths(image: Any, camera: Intrinsics, topic: str) -> tuple[Any, float]:
    """(height, width) as they are in a `sensor_msgs/msg/Image`, and the metres of one.
    CohelmError for an image that is none of this camera's, or not one of depths."""
    kind, metres = _ENCODINGS.get(image.encoding, ("", 0.0))
    if not kind:
        raise CohelmError(
            f"{topic} is encoded as {image.encoding!r}, and depths are 16UC1 [mm] or 32FC1 [m]: "
            "name the topic of the depth image, not compressed"
        )
    width, height, step = int(image.width), int(image.height), int(image.step)
    if (width, height) != camera[:2]:
        raise CohelmError(
            f"{topic} has {width} x {height} pixels, and its CameraInfo says {camera.width} x "
            f"{camera.height}: let the driver publish {info_topic(topic)} of these very images"
        )
    data, size = np.asarray(image.data, dtype=np.uint8), int(kind[1])
    if step < size * width or len(data) < step * (height - 1) + size * width:
        raise CohelmError(
            f"{topic} holds no image: {height} rows of {width} pixels, {step} bytes apart, in "
            f"{len(data)} bytes; fix its driver"
        )
    order = ">" if image.is_bigendian else "<"
    return np.ndarray((height, width), order + kind, data.tobytes(), 0, (step, size)), metres


def described(camera: Intrinsics, body: Floats, configured: LidarModel, topic: str) -> LidarModel:
    """The LiDAR that a depth camera is: where it is and looks, and not more beams nor a wider view
    than its images have.

    body: (4, 4), from the camera's optical frame into the body's. CohelmError for a camera that
    does not look along the floor.
    """
    down = -math.degrees(math.asin(max(-1.0, min(1.0, float(body[2, 2])))))
    askew = math.degrees(math.asin(max(-1.0, min(1.0, float(body[2, 0])))))
    if abs(down) > _STEEPEST or abs(askew) > _ASKEW:
        raise CohelmError(
            f"{topic}: the camera looks {abs(down):.0f} deg {'down' if down >= 0.0 else 'up'} and "
            f"lies {abs(askew):.0f} deg on its side, and up to {_STEEPEST:.0f} and {_ASKEW:.0f} "
            "can be used: is the frame of its images an optical one (REP-103: z forward, x right)?"
        )
    yaw = math.atan2(float(body[1, 2]), float(body[0, 2]))
    rays = _rays(camera, body, np.array([0, camera.width - 1]), np.arange(camera.height))
    bearings = np.sort(_wrapped(np.arctan2(rays[..., 1], rays[..., 0]) - yaw), axis=1)
    right, left = float(bearings[:, 0].max()), float(bearings[:, 1].min())
    if not right < left:
        raise CohelmError(f"{topic}: the camera looks too steeply to see along the floor")
    view = min(configured.field_of_view_deg, math.degrees(left - right))
    most = int(math.radians(view) / camera.gap) + 1
    x, y, z = (float(v) for v in body[:3, 3])
    band = configured.height_band_m
    near = 0.0 if band is None else _whole_from(rays, z - band[0])
    return configured.model_copy(
        update={
            "whole_from_m": max(configured.whole_from_m, min(near, configured.range_max_m)),
            "beams": max(min(configured.beams, most), 2), "field_of_view_deg": view, "sweep_s": 0.0,
            "mount_x_m": x, "mount_y_m": y, "mount_z_m": z,
            "mount_yaw_deg": math.degrees(wrap(yaw + 0.5 * (left + right))),
        }
    )  # fmt: skip


class DepthRanges:
    """Projects the pixels of depth images onto the beams of a model.

    The range of depths for which a pixel's point is in the height band is computed here, once: the
    beam of a pixel does not change with its depth, as the beams begin at the lens.
    """

    def __init__(self, model: LidarModel, camera: Intrinsics, body: Floats, topic: str) -> None:
        """model: as `described` makes it. body: (4, 4), from the optical frame into the body's."""
        self._model, self._camera, self._topic = model, camera, topic
        self.floor = None if model.floor is None else Floor(model, model.floor)
        """Watched where the model has one."""
        lidar, every = model.lidar(), camera.stride
        rays = _rays(
            camera, body, np.arange(0, camera.width, every), np.arange(0, camera.height, every)
        )
        pixels = np.arange(camera.width * camera.height).reshape(camera.height, camera.width)
        pixels, rays = pixels[::every, ::every].ravel(), rays.reshape(-1, 3)
        far, rise = np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]
        bearing = np.arctan2(rays[:, 1], rays[:, 0]) - lidar.mount.psi - lidar.first
        beams = (np.mod(bearing + 0.5 * lidar.step, 2.0 * math.pi) / lidar.step).astype(np.int64)
        low, high = model.height_band_m or (-math.inf, math.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = model.range_max_m / far
            ends = np.sort(np.stack([(z - body[2, 3]) / rise for z in (low, high)]), axis=0)
        level = (rise == 0.0) & (low <= body[2, 3]) & (body[2, 3] <= high)
        first = np.where(level, 0.0, np.maximum(np.nan_to_num(ends[0], nan=math.inf), 0.0))
        last = np.minimum(np.where(level, math.inf, ends[1]), beyond)
        used = first <= last
        flat: Floats = far
        if model.floor is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                flat = far * (model.floor.height_m - body[2, 3]) / rise
            used |= (rise < 0.0) & (flat < model.range_max_m)
        chosen = np.flatnonzero((beams < model.beams) & used)
        chosen = chosen[np.argsort(beams[chosen], kind="stable")]
        self._pixels, self._beams = pixels[chosen], beams[chosen]
        self._far = far[chosen].astype(np.float32)
        self._first, self._last = first[chosen].astype(np.float32), last[chosen].astype(np.float32)
        self._seen, self._starts, self._counts = np.unique(
            self._beams, return_index=True, return_counts=True
        )
        """The beams that have pixels, and where theirs begin."""
        if self.floor is not None:
            self._down = np.flatnonzero(rise[chosen] < 0.0)
            self._rise, self._lens = rise[chosen].astype(np.float32), np.float32(body[2, 3])
            self.floor.expect(self._beams[self._down], flat[chosen][self._down])

    def of(self, image: Any) -> Floats:
        """(beams,) [m]: of the points within the band, the distance on the floor of the nearest
        along each beam, or where floor ends that it ought to see; inf where there is none, -inf
        where it is nearer than the least range, NaN where most of the beam's pixels measured
        nothing; where all pixels did, something is too near. CohelmError for what is no such
        image."""
        seen, metres = depths(image, self._camera, self._topic)
        made: Floats = np.full(self._model.beams, math.nan)
        if not len(self._seen):
            return made
        depth = seen.ravel()[self._pixels].astype(np.float32)
        if metres != 1.0:
            depth *= np.float32(metres)
        with np.errstate(invalid="ignore"):
            inside = (depth >= self._first) & (depth <= self._last) & (depth > 0.0)
            none = ~((depth > 0.0) | (depth == -math.inf))
            close = depth == -math.inf
        ranges = np.where(inside, depth * self._far, np.float32(math.inf))
        ranges[close] = -math.inf
        nearest = np.minimum.reduceat(ranges, self._starts).astype(np.float64)
        blind = np.add.reduceat(none, self._starts, dtype=np.int64) > _MEASURED * self._counts
        made[self._seen] = np.where(blind & (nearest == math.inf), math.nan, nearest)
        if self.floor is None and none.all():  # too near for all of it, or before the lens
            made[self._seen] = -math.inf
        if self.floor is not None:
            down, depth[~(depth > 0.0)] = self._down, math.nan
            low = depth[down]
            heights, far = self._lens + low * self._rise[down], low * self._far[down]
            made = self.floor.stood(self._beams[down], far, heights, made)
        made[made < self._model.range_min_m] = -math.inf
        return made


def _rays(camera: Intrinsics, body: Floats, columns: Ints, rows: Ints) -> Floats:
    """(rows, columns, 3), in the body's directions, what a pixel's point moves by with a metre of
    depth."""
    made: Floats = np.ones((len(rows), len(columns), 3))
    made[..., 0] = (columns - camera.cx) / camera.fx
    made[..., 1] = ((rows - camera.cy) / camera.fy)[:, None]
    rays: Floats = made @ body[:3, :3].T
    return rays


def _whole_from(rays: Floats, above: float) -> float:
    """How far from the lens the lowest rays come down to what is so far below it, in the farthest
    column; 0 where that is not below, inf where they never do [m]."""
    if above <= 0.0:
        return 0.0
    slopes = rays[..., 2] / np.hypot(rays[..., 0], rays[..., 1])
    steepest = float(slopes.min(axis=0).max())
    return above / -steepest if steepest < 0.0 else math.inf


def _wrapped(angles: Floats) -> Floats:
    wrapped: Floats = np.mod(angles + math.pi, 2.0 * math.pi) - math.pi
    return wrapped
