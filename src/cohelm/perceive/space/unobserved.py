"""Unobserved ground: no beam looks there now, and none ever did or somebody went there.

A LiDAR that does not look all round leaves some beside or behind the robot, unless another looks
there. What such ground
begins with is told as standing points, so that nobody backs the robot into what it has never seen,
or turns it into who has just gone behind it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.perceive.scan.clusters import Look
from cohelm.perceive.scan.deskew import beam_at
from cohelm.perceive.space.cell_window import CELL, SIDE, cell, holds, nowhere
from cohelm.perceive.space.free_space_memory import NEAR
from cohelm.robot.footprint import disc_clearance
from cohelm.robot.sensors import Lidar, vouched_floor

VOUCHED = 0.2
"""So far beyond its turning circle, ground is taken to be free where the robot is switched on: who
does that has looked; and it can turn and look for itself [m]."""

DOUBT = 10.0
"""Who left the view beside the robot may be anywhere there, for so long [s]."""

KEPT = 2.7
"""Ground is remembered until it is farther from the LiDAR than this: sooner forgotten than by the
collision monitor (`free_space`, 2.85 m and half a step), which would let nobody have it [m]."""

_COMES = 4.0  # who leaves the view farther off is on his way here if he gets here in this time [s]
_EDGE = 0.15  # who is as near to where nothing looks may be there at the next scan [m]
_APART = 0.03  # nobody slips nearer to the outline than this [m]
_NEVER = np.iinfo(np.int64).min  # of no cell, as `nowhere`
_TOLD = 1.0  # such ground is told so far beyond the turning circle [m]


class View(NamedTuple):
    """Where a LiDAR looks: its beams, and its pose in `odom` at its newest sweep."""

    lidar: Lidar
    sensor: Pose


class Viewed(NamedTuple):
    """A window of cells, see `perceive.space.cell_window`, each of which has been in view.

    doubt: (n, n), until when somebody may be in a cell, unless it is in view before [s].
    """

    which: Ints
    doubt: Floats


def nothing() -> Viewed:
    """Nothing has been in view yet."""
    return Viewed(nowhere(), np.full((SIDE, SIDE), -math.inf))


@jit
def vouched(viewed: Viewed, x: float, y: float, radius: float) -> Viewed:
    """As if the ground about an `odom` point had been in view."""
    which, doubt = viewed.which.copy(), viewed.doubt.copy()
    low_x, low_y = cell(x - radius), cell(y - radius)
    wide = math.ceil(2.0 * radius / CELL) + 1
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if math.hypot((i + 0.5) * CELL - x, (j + 0.5) * CELL - y) < radius:
                _note(which, doubt, i, j)
    return Viewed(which, doubt)


@jit
def looked_at(viewed: Viewed, lidar: Lidar, look: Look, floor: bool = False) -> Viewed:
    """With the ground that a sweep has in view, up to and with what stands there; or with the
    floor that it sees, which is only from where to where it looks for that, and before what ends
    it. What is farther than KEPT is forgotten."""
    which, doubt = viewed.which.copy(), viewed.doubt.copy()
    sensor, n = look.sensor, len(look.ranges)
    _forget(which, sensor)
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = cell(sensor.x - NEAR), cell(sensor.y - NEAR)
    wide = math.ceil(2.0 * NEAR / CELL)
    for i in range(low_x, low_x + wide):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + wide):
            wy = (j + 0.5) * CELL - sensor.y
            far = math.hypot(wx, wy)
            if far > NEAR or _known(viewed, i, j, -math.inf):
                continue
            if floor and not lidar.floor_from <= far <= lidar.floor_to:
                continue
            beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
            if not 0 <= beam < n:
                continue
            reach = look.ranges[beam]
            if floor and math.isnan(reach) and 0 < beam < n - 1:  # of things; floor is beside it
                reach = min(look.ranges[beam - 1], look.ranges[beam + 1])
            if reach > (far if floor else far - CELL):
                _note(which, doubt, i, j)
    return Viewed(which, doubt)


@jit_inline
def _forget(which: Ints, sensor: Pose) -> None:
    for a in range(SIDE):
        for b in range(SIDE):
            wx = (which[a, b, 0] + 0.5) * CELL - sensor.x
            wy = (which[a, b, 1] + 0.5) * CELL - sensor.y
            if wx * wx + wy * wy > KEPT * KEPT:
                which[a, b, 0] = _NEVER


@jit_inline
def _within(view: View, x: float, y: float) -> float:
    """How far an `odom` point is from the edge of a view; 0 beyond it [m]."""
    lidar, sensor = view.lidar, view.sensor
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    first, last = (
        lidar.first - 0.5 * lidar.step,
        lidar.first + (len(lidar.beams) - 0.5) * lidar.step,
    )
    wx, wy = x - sensor.x, y - sensor.y
    bearing = math.atan2(-s * wx + c * wy, c * wx + s * wy)
    edge = min(bearing - first, last - bearing)
    return math.hypot(wx, wy) * math.sin(min(max(edge, 0.0), 0.5 * math.pi))


@jit_inline
def _looked_at(views: tuple[View, ...], x: float, y: float) -> bool:
    """Whether a beam points at an `odom` point, whatever it ends on."""
    for k in range(len(views)):
        lidar, sensor = views[k].lidar, views[k].sensor
        c, s = math.cos(sensor.psi), math.sin(sensor.psi)
        wx, wy = x - sensor.x, y - sensor.y
        if 0 <= beam_at(lidar, c * wx + s * wy, -s * wx + c * wy) < len(lidar.beams):
            return True
    return False


@jit
def doubted(
    viewed: Viewed, views: tuple[View, ...], now: float, mobile: Floats, pose: Pose,
    outline: Floats, far: float,
) -> Viewed:  # fmt: skip
    """With doubt about all ground where nothing looks, within `far` [m] of a robot with this
    outline at this pose, if one of the discs that may move is at its edge, and as near, or
    will be if it goes on as it does."""
    x, y = pose.x, pose.y
    leaves = False
    for k in range(len(mobile)):
        wx, wy = mobile[k, X] - x, mobile[k, Y] - y
        vx, vy = mobile[k, VX], mobile[k, VY]
        t = min(max(-(wx * vx + wy * vy) / max(vx * vx + vy * vy, 1e-6), 0.0), _COMES)
        near = math.hypot(wx + t * vx, wy + t * vy) - mobile[k, RADIUS] < far
        away = 0.0
        for i in range(len(views)):
            away = max(away, _within(views[i], mobile[k, X], mobile[k, Y]))
        leaves = leaves or (near and away < mobile[k, RADIUS] + _EDGE)
    if not leaves:
        return viewed
    doubt = viewed.doubt.copy()
    low_x, low_y = cell(x - far), cell(y - far)
    wide = math.ceil(2.0 * far / CELL) + 1
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if _looked_at(views, (i + 0.5) * CELL, (j + 0.5) * CELL):
                continue
            gap = disc_clearance(pose, outline, (i + 0.5) * CELL, (j + 0.5) * CELL, 0.0)
            if gap > _APART:
                doubt[i % SIDE, j % SIDE] = now + DOUBT
    return Viewed(viewed.which, doubt)


@jit
def blind(
    viewed: Viewed, views: tuple[View, ...], now: float, pose: Pose, outline: Floats, far: float,
    floor: bool = False,
) -> Floats:  # fmt: skip
    """Where such ground, or floor, begins, (p, 2), in `odom`, within `far` [m] of a robot with this
    outline at this pose: cells beside one that was in view, or beside the robot itself."""
    low_x, low_y = cell(pose.x - far), cell(pose.y - far)
    wide = math.ceil(2.0 * far / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        px = (i + 0.5) * CELL
        for j in range(low_y, low_y + wide):
            py = (j + 0.5) * CELL
            if math.hypot(px - pose.x, py - pose.y) > far or _known(viewed, i, j, now):
                continue
            if not floor and _looked_at(views, px, py):
                continue  # hidden by what is seen before it
            gap = disc_clearance(pose, outline, px, py, 0.0)
            if gap <= 0.0:
                continue
            if (
                gap < _APART + 1.5 * CELL
                or _known(viewed, i - 1, j, now) or _known(viewed, i + 1, j, now)
                or _known(viewed, i, j - 1, now) or _known(viewed, i, j + 1, now)
            ):  # fmt: skip
                out[k, 0], out[k, 1] = px, py
                k += 1
    return out[:k].copy()


@jit_inline
def _note(which: Ints, doubt: Floats, i: int, j: int) -> None:
    a, b = i % SIDE, j % SIDE
    which[a, b, 0], which[a, b, 1] = i, j
    doubt[a, b] = -math.inf


@jit_inline
def _known(viewed: Viewed, i: int, j: int, now: float) -> bool:
    return holds(viewed.which, i, j) and viewed.doubt[i % SIDE, j % SIDE] <= now


class Blind:
    """What one robot has had in view, none of whose LiDARs looks all round."""

    def __init__(self, outline: Floats) -> None:
        """outline: (k, 2) of what the LiDARs are on [m]."""
        self.reshape(outline)
        self._viewed: Viewed | None = None

    def reshape(self, outline: Floats) -> None:
        """It has another outline from the next sweep on."""
        self._outline = outline
        self._reach = float(np.hypot(*outline.T).max())

    def points(
        self, lidar: Lidar, look: Look, looking: list[tuple[Lidar, Look]], pose: Pose,
        mobile: Floats,
    ) -> Floats:  # fmt: skip
        """After a sweep from an `odom` pose, where ground begins that may hold anything, (p, 2).

        looking: each LiDAR with its newest sweep, this one too. mobile: discs that may move, as in
        `core.types`, in `odom`.
        """
        far, now = self._reach + _TOLD, look.stamp
        views = tuple(View(one, its.sensor) for one, its in looking)
        if self._viewed is None:
            self._viewed = vouched(nothing(), pose.x, pose.y, self._reach + VOUCHED)
        viewed = looked_at(self._viewed, lidar, look)
        self._viewed = doubted(viewed, views, now, mobile, pose, self._outline, far)
        return blind(self._viewed, views, now, pose, self._outline, far)


class UnwatchedFloor:
    """The floor that one robot has not seen, of whose sensors some watch it.

    Only those count, and only where they see it: a LiDAR that looks all round sees no stair.
    """

    def __init__(self, outline: Floats, watching: list[Lidar]) -> None:
        """outline: (k, 2) of the robot [m]. watching: those that see the floor."""
        self.reshape(outline)
        least = self._reach + VOUCHED
        self._vouched = max(vouched_floor(one, outline, least) for one in watching)
        self._viewed: Viewed | None = None

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline from the next sweep on. What is beneath it is not told, and
        not seen either: a load may hang over anything."""
        self._outline = outline
        self._reach = float(np.hypot(*outline.T).max())

    def points(self, lidar: Lidar, look: Look, pose: Pose) -> Floats:
        """After a sweep of one of these from an `odom` pose, where floor that nobody has seen
        begins, (p, 2)."""
        if self._viewed is None:
            self._viewed = vouched(nothing(), pose.x, pose.y, self._vouched)
        self._viewed = looked_at(self._viewed, lidar, look, True)
        view = (View(lidar, look.sensor),)
        far = self._reach + _TOLD
        return blind(self._viewed, view, look.stamp, pose, self._outline, far, True)
