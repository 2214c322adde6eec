"""Unobserved ground: no beam looks there now, and none ever did or somebody went there.

A LiDAR that does not look all round leaves some beside or behind the robot, unless another looks
there. Where it begins is told as standing points, so that nobody backs the robot into what it has
never seen, or turns it into who has just gone behind it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.clusters import Look
from cohelm.perceive.scan.deskew import beam_at
from cohelm.perceive.space.cell_window import CELL, SIDE, cell, holds, nowhere
from cohelm.perceive.space.free_space_memory import NEAR
from cohelm.perceive.track.departed import HVX, HVY, HX, HY, REACH, UNSEEN, in_view
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.sensors import Lidar, vouched_floor

VOUCHED = 0.2
"""So far beyond its turning circle, ground is taken to be free where the robot is switched on: who
does that has looked; and it can turn and look for itself [m]."""

KEPT = 2.7
"""Ground is remembered until it is farther from the LiDAR than this: sooner forgotten than by the
collision monitor (`free_space`, 2.85 m and half a step), which would let nobody have it [m]."""

_COMES = 4.0  # who left the view farther off is on his way here if he gets here in this time [s]
_APART = 0.03  # nobody slips nearer to the outline than this [m]
_NEVER = np.iinfo(np.int64).min  # of no cell, as `nowhere`
_JUST = 0.25  # who was seen so short ago is where he is foretold [s]
_TOLD = 1.0  # such ground is told so far beyond the turning circle [m]


class View(NamedTuple):
    """Where a LiDAR looks: its beams, and its pose in `odom` at its newest sweep."""

    lidar: Lidar
    sensor: Pose


class Viewed(NamedTuple):
    """A window of cells, see `perceive.space.cell_window`, each of which has been in view.

    taken: (n, n), whether somebody may be in a cell who was seen to leave the view.
    """

    which: Ints
    taken: NDArray[np.bool_]


def nothing() -> Viewed:
    """Nothing has been in view yet."""
    return Viewed(nowhere(), np.zeros((SIDE, SIDE), np.bool_))


@jit
def vouched(viewed: Viewed, x: float, y: float, radius: float) -> Viewed:
    """As if the ground about an `odom` point had been in view."""
    which, taken = viewed.which.copy(), viewed.taken.copy()
    low_x, low_y = cell(x - radius), cell(y - radius)
    wide = math.ceil(2.0 * radius / CELL) + 1
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if math.hypot((i + 0.5) * CELL - x, (j + 0.5) * CELL - y) < radius:
                _note(which, taken, i, j)
    return Viewed(which, taken)


@jit
def looked_at(viewed: Viewed, lidar: Lidar, look: Look, floor: bool = False) -> Viewed:
    """With the ground that a sweep has in view, up to and with what stands there; or with the
    floor that it sees, which is only from where to where it looks for that, and before what ends
    it. What is farther than KEPT is forgotten."""
    which, taken = viewed.which.copy(), viewed.taken.copy()
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
            if far > NEAR or (holds(which, i, j) and not taken[i % SIDE, j % SIDE]):
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
                _note(which, taken, i, j)
    return Viewed(which, taken)


@jit_inline
def _forget(which: Ints, sensor: Pose) -> None:
    for a in range(SIDE):
        for b in range(SIDE):
            wx = (which[a, b, 0] + 0.5) * CELL - sensor.x
            wy = (which[a, b, 1] + 0.5) * CELL - sensor.y
            if wx * wx + wy * wy > KEPT * KEPT:
                which[a, b, 0] = _NEVER


@jit_inline
def _looked_at(views: tuple[View, ...], x: float, y: float) -> bool:
    """Whether a beam points at an `odom` point, whatever it ends on."""
    seen = False
    for k in range(len(views)):
        seen = seen or in_view(views[k].lidar, views[k].sensor, x, y)
    return seen


@jit
def nearing(hidden: Floats, pose: Pose, far: float) -> Floats:
    """Those out of view, see `track.departed`, who are within `far` [m] of a pose, or were on
    their way there when they left."""
    near = np.zeros(len(hidden), np.bool_)
    for k in range(len(hidden)):
        vx, vy, ago = hidden[k, HVX], hidden[k, HVY], hidden[k, UNSEEN]
        wx, wy = hidden[k, HX] - ago * vx - pose.x, hidden[k, HY] - ago * vy - pose.y
        t = min(max(-(wx * vx + wy * vy) / max(vx * vx + vy * vy, 1e-6), 0.0), _COMES)
        near[k] = math.hypot(wx + t * vx, wy + t * vy) < far
    return hidden[near]


@jit
def taken(
    viewed: Viewed, views: tuple[View, ...], hidden: Floats, pose: Pose, outline: Floats,
    fastest: float, dt: float,
) -> Viewed:  # fmt: skip
    """With the cells that those out of view may be in dt [s] later: where they left the view, and
    where one can have walked to from there, and from beyond what is known, over cells that nothing
    looks at and that one of them can have reached from where he was last seen, as he was going.

    fastest: nobody is faster, but who was seen to be [m/s].
    """
    before = viewed.taken
    after = np.zeros_like(before)
    if not len(hidden):
        return Viewed(viewed.which, after)
    pace, away = fastest, False
    for k in range(len(hidden)):
        away = away or hidden[k, UNSEEN] >= _JUST
        pace = max(pace, math.hypot(hidden[k, HVX], hidden[k, HVY]))
    steps = math.ceil(pace * dt / CELL)
    low_x, low_y = cell(pose.x - KEPT), cell(pose.y - KEPT)
    wide = math.ceil(2.0 * KEPT / CELL) + 1
    may, full = np.zeros((wide, wide), np.bool_), np.zeros((wide, wide), np.bool_)
    for a in range(wide):
        for b in range(wide):
            i, j = low_x + a, low_y + b
            x, y = (i + 0.5) * CELL, (j + 0.5) * CELL
            if _looked_at(views, x, y) or disc_clearance(pose, outline, x, y, 0.0) < _APART:
                continue
            for k in range(len(hidden)):
                if math.hypot(x - hidden[k, HX], y - hidden[k, HY]) < hidden[k, REACH]:
                    may[a, b] = True
                    full[a, b] |= hidden[k, UNSEEN] < _JUST
            full[a, b] |= before[i % SIDE, j % SIDE] or (away and not holds(viewed.which, i, j))
            full[a, b] &= may[a, b]
    for _ in range(steps):
        one = full.copy()
        for a in range(1, wide - 1):
            for b in range(1, wide - 1):
                if may[a, b] and not one[a, b]:
                    full[a, b] = (
                        one[a - 1, b] or one[a + 1, b] or one[a, b - 1] or one[a, b + 1]
                        or one[a - 1, b - 1] or one[a - 1, b + 1]
                        or one[a + 1, b - 1] or one[a + 1, b + 1]
                    )  # fmt: skip
    for a in range(wide):
        for b in range(wide):
            after[(low_x + a) % SIDE, (low_y + b) % SIDE] = full[a, b]
    return Viewed(viewed.which, after)


@jit
def doubtful(viewed: Viewed, pose: Pose) -> Floats:
    """Where somebody may be who left the view, by cells, (p, 2), in `odom`, near a robot there."""
    low_x, low_y = cell(pose.x - KEPT), cell(pose.y - KEPT)
    wide = math.ceil(2.0 * KEPT / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if viewed.taken[i % SIDE, j % SIDE]:
                out[k, 0], out[k, 1] = (i + 0.5) * CELL, (j + 0.5) * CELL
                k += 1
    return out[:k].copy()


@jit
def blind(
    viewed: Viewed, views: tuple[View, ...], pose: Pose, outline: Floats, far: float,
    floor: bool = False,
) -> Floats:  # fmt: skip
    """Where such ground, or floor, begins, (p, 2), in `odom`, within `far` [m] of a robot with this
    outline at this pose: cells beside one that is known, or beside the robot itself."""
    low_x, low_y = cell(pose.x - far), cell(pose.y - far)
    wide = math.ceil(2.0 * far / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        px = (i + 0.5) * CELL
        for j in range(low_y, low_y + wide):
            py = (j + 0.5) * CELL
            if math.hypot(px - pose.x, py - pose.y) > far or _free(viewed, i, j):
                continue
            if not floor and _looked_at(views, px, py):
                continue  # hidden by what is seen before it
            gap = disc_clearance(pose, outline, px, py, 0.0)
            if gap <= 0.0:
                continue
            if (
                gap < _APART + 1.5 * CELL
                or _free(viewed, i - 1, j) or _free(viewed, i + 1, j)
                or _free(viewed, i, j - 1) or _free(viewed, i, j + 1)
            ):  # fmt: skip
                out[k, 0], out[k, 1] = px, py
                k += 1
    return out[:k].copy()


@jit_inline
def _note(which: Ints, taken: NDArray[np.bool_], i: int, j: int) -> None:
    a, b = i % SIDE, j % SIDE
    which[a, b, 0], which[a, b, 1] = i, j
    taken[a, b] = False


@jit_inline
def _free(viewed: Viewed, i: int, j: int) -> bool:
    return holds(viewed.which, i, j) and not viewed.taken[i % SIDE, j % SIDE]


class Blind:
    """What one robot has had in view, none of whose LiDARs looks all round."""

    def __init__(self, outline: Floats) -> None:
        """outline: (k, 2) of what the LiDARs are on [m]."""
        self.reshape(outline)
        self._viewed: Viewed | None = None
        self._stamp = -math.inf

    def reshape(self, outline: Floats) -> None:
        """It has another outline from the next sweep on."""
        self._outline = outline
        self._reach = float(np.hypot(*outline.T).max())

    def points(
        self, lidar: Lidar, look: Look, looking: list[tuple[Lidar, Look]], pose: Pose,
        hidden: Floats, fastest: float,
    ) -> Floats:  # fmt: skip
        """After a sweep from an `odom` pose, where ground begins that may hold anything, (p, 2).

        looking: each LiDAR with its newest sweep, this one too. hidden: who may be out of view, as
        in `track.departed`. fastest: nobody is faster, but who was seen to be [m/s].
        """
        far = self._reach + _TOLD
        views = tuple(View(one, its.sensor) for one, its in looking)
        if self._viewed is None:
            self._viewed = vouched(nothing(), pose.x, pose.y, self._reach + VOUCHED)
        viewed = looked_at(self._viewed, lidar, look)
        dt, self._stamp = min(max(look.stamp - self._stamp, 0.0), 1.0), look.stamp
        near = nearing(hidden, pose, far)
        self._viewed = taken(viewed, views, near, pose, self._outline, fastest, dt)
        return blind(self._viewed, views, pose, self._outline, far)

    def doubtful(self, pose: Pose) -> Floats:
        """Where somebody may be who left the view, (p, 2), in `odom`, as of the last sweep, from
        that pose."""
        if self._viewed is None:
            return np.empty((0, 2))
        return doubtful(self._viewed, pose)


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
        return blind(self._viewed, view, pose, self._outline, far, True)
