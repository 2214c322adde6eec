"""Fixed mounts from `/tf_static`: where a sensor is on the robot, and whether it is level."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose

TILTED = math.radians(3.0)
"""A planar LiDAR inclined by more does not see what the robot meets [rad]."""
LEVEL = math.radians(0.2)
"""One that is inclined by less is as high everywhere: to 1 cm, over the 3 m that count [rad]."""

_SAME = 1e-3
"""Transforms whose numbers differ by less are the same [m, and of rotations]."""


class Mount(NamedTuple):
    """Of a planar LiDAR."""

    pose: Pose
    """In the body frame."""
    upside_down: bool
    """Its beams that run counter-clockwise run clockwise on the floor then."""
    height: float
    """Of its plane above the body's origin [m]; NaN: it is not level, or unknown."""


class StaticTransforms:
    """All static transforms received, as 4 x 4 matrices from child to parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}
        self._others: dict[str, tuple[str, Floats]] = {}
        """Another place of a frame than the newest one, where there was any."""

    def add(self, message: Any) -> None:
        """A `tf2_msgs/msg/TFMessage`; what is not finite is left out."""
        for one in message.transforms:
            at, q = one.transform.translation, one.transform.rotation
            matrix = _matrix((at.x, at.y, at.z), (q.x, q.y, q.z, q.w))
            if matrix is not None:
                child, parent = one.child_frame_id.lstrip("/"), one.header.frame_id.lstrip("/")
                before = self._parents.get(child)
                if before is not None and (
                    before[0] != parent or np.abs(before[1] - matrix).max() > _SAME
                ):
                    self._others[child] = before
                self._parents[child] = parent, matrix

    def __len__(self) -> int:
        return len(self._parents)

    def frames(self) -> list[str]:
        """All that are known, in order."""
        parents = {parent for parent, _ in self._parents.values()}
        return sorted({*self._parents, *parents})

    def between(self, frame: str, body: str) -> Floats | None:
        """From one frame into another, (4, 4); None where nothing fixed connects them."""
        up, down = self._to_root(frame.lstrip("/")), self._to_root(body.lstrip("/"))
        for name, matrix in up.items():
            if name in down:
                made: Floats = np.linalg.inv(down[name]) @ matrix
                return made
        return None

    def ambiguous(self, frame: str, body: str) -> str:
        """Two places of one frame between these, in words; empty: each has one."""
        chains = (*self._to_root(frame.lstrip("/")), *self._to_root(body.lstrip("/")))
        child = next((one for one in chains if one in self._others), None)
        if child is None:
            return ""
        places = [
            f"at x {matrix[0, 3]:.3f} y {matrix[1, 3]:.3f} z {matrix[2, 3]:.3f} m on {parent!r}"
            for parent, matrix in (self._others[child], self._parents[child])
        ]
        return f"of {child!r}, {places[0]} and {places[1]}"

    def mount(self, frame: str, body: str, option: str = "--scan") -> Mount | None:
        """Of a planar LiDAR; None where nothing fixed connects its frame and the body's. option: by
        which another topic is named.

        Raises CohelmError for one that does not lie flat.
        """
        matrix = self.between(frame, body)
        if matrix is None:
            return None
        tilt = _tilt(matrix)
        if tilt > TILTED:
            raise CohelmError(
                f"{frame} is inclined by {math.degrees(tilt):.0f} deg to {body}: only a LiDAR that "
                f"lies flat can be used yet; name the topic of a flat one with {option}"
            )
        return mount_of(matrix)

    def _to_root(self, frame: str) -> dict[str, Floats]:
        """Every frame above, the frame itself first, with the transform into it."""
        found: dict[str, Floats] = {frame: np.eye(4)}
        matrix: Floats = np.eye(4)
        while frame in self._parents:
            parent, step = self._parents[frame]
            if parent in found:  # a ring, which a tree has not
                break
            matrix = step @ matrix
            frame = parent
            found[frame] = matrix
        return found


def mount_of(matrix: Floats) -> Mount:
    """Of a planar LiDAR, by the transform from its frame into the body's, (4, 4)."""
    x, y, z = (float(v) for v in matrix[:3, 3])
    yaw = math.atan2(float(matrix[1, 0]), float(matrix[0, 0]))
    height = z if _tilt(matrix) < LEVEL else math.nan
    return Mount(Pose(x, y, yaw), float(matrix[2, 2]) < 0.0, height)


def _tilt(matrix: Floats) -> float:
    return math.acos(min(abs(float(matrix[2, 2])), 1.0))


def yaw_of(q: Any) -> float:
    """Heading of a `geometry_msgs/msg/Quaternion` [rad]; NaN where it is no rotation."""
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not 0.5 < norm < 2.0:
        return math.nan
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)


def _matrix(at: tuple[float, ...], rotation: tuple[float, ...]) -> Floats | None:
    norm = math.sqrt(sum(v * v for v in rotation))
    if not all(map(math.isfinite, at)) or not 0.5 < norm < 2.0:
        return None
    x, y, z, w = (v / norm for v in rotation)
    made: Floats = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = at
    return made
