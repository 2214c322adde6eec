"""A world with heights: boxes that stand or hang, and ground that falls away; rays, gaps, falls.

Boxes and drops stand upright and may be turned. A drop is a box that is cut out of the floor; drops
that touch are one, so that a stair down is a row of them, each deeper than the one before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Pose

_BESIDE = 1e-6  # what is no farther beyond a drop's edge is of the next one [m]
_STEPS = 16  # drops a ray passes at most
NOTHING: Floats = np.empty((0, 8))


class Heights(NamedTuple):
    """Both as rows of x, y, cos and sin of the yaw, half lengths along it and across [m]."""

    boxes: Floats = NOTHING
    """(n, 8); and from which height to which [m]."""
    drops: Floats = NOTHING[:, :7]
    """(m, 7); and the depth of the ground [m]."""


def box(
    x: float, y: float, yaw: float, length: float, width: float, low: float, high: float
) -> list[float]:
    """A row of boxes: middle [m], yaw [rad], sides and heights [m]."""
    return [x, y, math.cos(yaw), math.sin(yaw), 0.5 * length, 0.5 * width, low, high]


def drop(x: float, y: float, yaw: float, length: float, width: float, depth: float) -> list[float]:
    """A row of drops: middle [m], yaw [rad], sides and depth [m]."""
    return [x, y, math.cos(yaw), math.sin(yaw), 0.5 * length, 0.5 * width, depth]


def edges(rows: Floats) -> Floats:
    """The four sides of each, (4 n, 4), as walls from corner to corner [m]."""
    x, y, c, s, a, b = rows[:, :6].T
    corners = np.stack(
        [
            np.column_stack((x + c * i * a - s * j * b, y + s * i * a + c * j * b))
            for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ],
        axis=1,
    )
    made: Floats = np.concatenate((corners, np.roll(corners, -1, axis=1)), axis=2).reshape(-1, 4)
    return made


def between(boxes: Floats, low: float, high: float) -> Floats:
    """Those of the boxes that have a part above the one height and below the other [m]."""
    return boxes[(boxes[:, 7] > low) & (boxes[:, 6] < high)]


@jit
def depths(
    heights: Heights, lens: Floats, turn: Floats, rays: Floats, farthest: float, found: Floats,
    slant: Floats,
) -> None:  # fmt: skip
    """What each ray meets first: how often its own length away, and how square it meets it.

    lens: (3,) in the world [m]. turn: (3, 3) from the rays' directions into the world's. rays:
    (n, 3). found: (n,), inf beyond `farthest`; slant: (n,), the cosine to the surface's normal.
    """
    boxes, drops = heights.boxes, heights.drops
    near = np.empty(len(boxes), np.int64)
    n = 0
    for k in range(len(boxes)):
        far = math.hypot(boxes[k, 0] - lens[0], boxes[k, 1] - lens[1])
        if far - math.hypot(boxes[k, 4], boxes[k, 5]) < farthest:
            near[n] = k
            n += 1
    for i in range(len(rays)):
        dx = turn[0, 0] * rays[i, 0] + turn[0, 1] * rays[i, 1] + turn[0, 2] * rays[i, 2]
        dy = turn[1, 0] * rays[i, 0] + turn[1, 1] * rays[i, 1] + turn[1, 2] * rays[i, 2]
        dz = turn[2, 0] * rays[i, 0] + turn[2, 1] * rays[i, 1] + turn[2, 2] * rays[i, 2]
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        best, square = math.inf, 1.0
        for m in range(n):
            t, normal = _into(boxes[near[m]], lens, dx, dy, dz)
            if t < best:
                best, square = t, normal / size
        if dz < 0.0:
            t, normal = _ground(drops, lens, dx, dy, dz)
            if t < best:
                best, square = t, normal / size
        found[i] = best if best <= farthest else math.inf
        slant[i] = square


@jit_inline
def _into(row: Floats, lens: Floats, dx: float, dy: float, dz: float) -> tuple[float, float]:
    """When a ray enters a box, inf for never, and its speed across the side that it enters by."""
    wx, wy = lens[0] - row[0], lens[1] - row[1]
    c, s = row[2], row[3]
    enter, leave, normal = -math.inf, math.inf, 0.0
    for axis in range(3):
        if axis == 0:
            at, way, low, high = c * wx + s * wy, c * dx + s * dy, -row[4], row[4]
        elif axis == 1:
            at, way, low, high = -s * wx + c * wy, -s * dx + c * dy, -row[5], row[5]
        else:
            at, way, low, high = lens[2], dz, row[6], row[7]
        if way == 0.0:
            if at < low or at > high:
                return math.inf, 0.0
            continue
        a, b = (low - at) / way, (high - at) / way
        if a > b:
            a, b = b, a
        if a > enter:
            enter, normal = a, abs(way)
        leave = min(leave, b)
    if enter > leave or enter <= 0.0:
        return math.inf, 0.0
    return enter, normal


@jit_inline
def _inside(drops: Floats, x: float, y: float, z: float) -> int:
    """The drop that a point is in, or -1."""
    for k in range(len(drops)):
        wx, wy = x - drops[k, 0], y - drops[k, 1]
        c, s = drops[k, 2], drops[k, 3]
        if (
            abs(c * wx + s * wy) <= drops[k, 4]
            and abs(-s * wx + c * wy) <= drops[k, 5]
            and z > -drops[k, 6]
        ):
            return k
    return -1


@jit_inline
def _ground(drops: Floats, lens: Floats, dx: float, dy: float, dz: float) -> tuple[float, float]:
    """When a ray that goes down meets the floor, or what is in a drop, and how fast."""
    t = -lens[2] / dz
    k, normal = _inside(drops, lens[0] + t * dx, lens[1] + t * dy, 0.0), abs(dz)
    for _ in range(_STEPS):
        if k < 0:
            break
        row = drops[k]
        c, s = row[2], row[3]
        wx, wy = lens[0] - row[0], lens[1] - row[1]
        ax, ay, bx, by = c * wx + s * wy, -s * wx + c * wy, c * dx + s * dy, -s * dx + c * dy
        t, normal, side = (-row[6] - lens[2]) / dz, abs(dz), False
        if bx != 0.0:
            out = (math.copysign(row[4], bx) - ax) / bx
            if out < t:
                t, normal, side = out, abs(bx), True
        if by != 0.0:
            out = (math.copysign(row[5], by) - ay) / by
            if out < t:
                t, normal, side = out, abs(by), True
        if not side:
            break
        on = t + _BESIDE / math.hypot(dx, dy)
        k = _inside(drops, lens[0] + on * dx, lens[1] + on * dy, lens[2] + t * dz)
    return t, normal


@jit
def fallen(heights: Heights, poses: Floats, wheels: Floats) -> int:
    """The first of the poses (n, 3) in which a wheel (k, 2) of the body has no floor, or -1."""
    for i in range(len(poses)):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for k in range(len(wheels)):
            x = poses[i, 0] + c * wheels[k, 0] - s * wheels[k, 1]
            y = poses[i, 1] + s * wheels[k, 0] + c * wheels[k, 1]
            if _inside(heights.drops, x, y, 0.0) >= 0:
                return i
    return -1


class DepthCamera(NamedTuple):
    """A pinhole camera of depths, and what is wrong with them."""

    width: int
    height: int
    focal: float
    """[pixels]; the middle is that of the picture."""
    lens: Floats
    """(3,) in the body [m]."""
    turn: Floats
    """(3, 3), from its optical frame (x right, y down, z ahead) into the body's."""
    farthest: float
    """[m]"""
    noise: float
    """Standard deviation of a depth, as a share of it."""
    lost: float
    """Share of pixels that measure nothing, wherever they look, ..."""
    grazing: float
    """... and below which cosine to a surface's normal all of them measure nothing; from twice
    that on, none."""
    shake: float
    """Standard deviation of its pitch from picture to picture [rad]."""


def picture(
    camera: DepthCamera, heights: Heights, pose: Pose, random: np.random.Generator
) -> NDArray[np.float32]:
    """(height, width) depths from a pose [m]; 0 where nothing was measured."""
    n = camera.width * camera.height
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.ones((n, 3))
    rays[:, 0] = (u.ravel() - 0.5 * (camera.width - 1)) / camera.focal
    rays[:, 1] = (v.ravel() - 0.5 * (camera.height - 1)) / camera.focal
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    body = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    pitch = camera.shake * float(random.standard_normal())
    c, s = math.cos(pitch), math.sin(pitch)
    pitched = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    lens = body @ camera.lens + (pose.x, pose.y, 0.0)
    found, slant = np.empty(n), np.empty(n)
    depths(heights, lens, body @ pitched @ camera.turn, rays, camera.farthest, found, slant)
    made = found * (1.0 + camera.noise * random.standard_normal(n))
    missing = np.maximum(2.0 - slant / camera.grazing, camera.lost)
    made[(random.random(n) < missing) | ~np.isfinite(made)] = 0.0
    return made.reshape(camera.height, camera.width).astype(np.float32)
