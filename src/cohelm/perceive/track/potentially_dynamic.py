"""Potentially dynamic points: at rest now, but they have come there by themselves.

Movers are told by `movers`; until a thing is one, when two are seen as one, and after one was
dropped, its points are loose. Each is told as a small disc of unknown velocity beside counting as
a standing point, until it has stood; then as one that may begin to move. Who has come so near to
the LiDAR that it can not measure him is one of them, at the LiDAR, as long as he is there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.perceive.scan.clusters import FREE, Look, was_free
from cohelm.perceive.scan.deskew import beam_at
from cohelm.perceive.space.free_space_memory import Ground, came
from cohelm.robot.sensors import Lidar

NEAR = 2.0
"""Farther from the robot than this there is time yet [m]."""
LX, LY, STOOD = range(3)
"""Columns of loose points: place in `odom` [m], whether it has stood (1) or not (0)."""

_APART = 0.06  # of points that are nearer to each other one is told [m]
_COVERS = 0.3  # beams over so much of the view end on whatever is that near; strays do not [rad]


class Wary(NamedTuple):
    """What is assumed of things that may set off."""

    fastest: float = 1.3
    """Nobody is faster [m/s]."""
    creeping: float = 0.1
    """What has stood, as far as can be seen, may yet be as fast as this [m/s]."""
    keep: float = 10.0
    """What came by itself is taken to be able to go on for so long [s]."""
    vouched: float = 2.0
    """So far driven, odometry no longer says to a hand's breadth what was free where [m]."""


@jit
def came_by_itself(
    places: Floats, near: NDArray[np.bool_], ground: Ground, since: float, look: Look, noise: float
) -> Ints:
    """(m,) whether a sweep's points in `odom` have come since then, of those that are `near`, as
    `came` tells.

    noise: of its ranges, one standard deviation; a thing may be farther than measured by that [m].
    """
    found = np.zeros(len(places), np.int64)
    for i in range(len(places)):
        if near[i]:
            x, y = places[i, 0], places[i, 1]
            wx, wy = x - look.sensor.x, y - look.sensor.y
            far = noise / max(math.hypot(wx, wy), 0.05)
            found[i] = came(ground, x + far * wx, y + far * wy, since)
    return found


@jit
def loose(
    lidar: Lidar, places: Floats, there: NDArray[np.bool_], before: Look, earlier: Look
) -> Floats:
    """The loose points among those in `odom` that have come by themselves, `there`: (l, 3).

    before, earlier: two sweeps of a while ago; a thing has stood if it was there in both of them.
    """
    out = np.empty((len(there), 3))
    k = 0
    for i in range(len(there)):
        if not there[i]:
            continue
        x, y = places[i, 0], places[i, 1]
        stood = _was_there(lidar, before, x, y) and _was_there(lidar, earlier, x, y)
        near = False
        for j in range(k - 1, -1, -1):
            far = math.hypot(out[j, LX] - x, out[j, LY] - y)
            if far < _APART and (out[j, STOOD] == 0.0 or stood):
                near = True
                break
        if not near:
            out[k, LX], out[k, LY], out[k, STOOD] = x, y, 1.0 if stood else 0.0
            k += 1
    return out[:k].copy()


@jit
def covers(lidar: Lidar, now: Look, earlier: Look, before: bool) -> bool:
    """Whether somebody is within the LiDAR's least range: many beams side by side end there, and he
    was there `before`, or it was free there in an earlier sweep. What the robot has driven up to
    itself is not meant, and stands."""
    n, run = len(now.ranges), 0
    c, s = math.cos(now.sensor.psi), math.sin(now.sensor.psi)
    came = before
    for i in range(n):
        if now.ranges[i] != -math.inf:
            run, came = 0, before
            continue
        run += 1
        if not came and len(earlier.ranges) == n:
            x, y = lidar.range_min * lidar.beams[i, 0], lidar.range_min * lidar.beams[i, 1]
            x, y = now.sensor.x + c * x - s * y, now.sensor.y + s * x + c * y
            came = was_free(lidar, earlier, x, y, 0.0)
        if came and run * lidar.step > _COVERS:
            return True
    return False


@jit
def _was_there(lidar: Lidar, look: Look, x: float, y: float) -> bool:
    """Whether an earlier sweep ended about there."""
    wx, wy = x - look.sensor.x, y - look.sensor.y
    c, s = math.cos(look.sensor.psi), math.sin(look.sensor.psi)
    beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
    far = math.hypot(wx, wy)
    for k in range(max(beam - 2, 0), min(beam + 3, len(look.ranges))):
        if abs(look.ranges[k] - far) < FREE:
            return True
    return False


def spread(speed: Floats, max_acceleration: float, age: float) -> tuple[Floats, Floats]:
    """By how much discs are larger, and by how much their velocities are off, that were off by up
    to `speed` `age` ago, and may have changed by `max_acceleration` since [m, m/s]."""
    return (
        speed * age + 0.5 * max_acceleration * age * age,
        speed + max_acceleration * age,
    )


def wild(points: Floats, age: float, max_acceleration: float, wary: Wary) -> tuple[Floats, Floats]:
    """Loose points as discs that may go anywhere, (l, 6), `age` [s] later, and how fast (l,)."""
    stood = points[:, STOOD] > 0.0
    speed = np.where(stood, wary.creeping, wary.fastest)
    more, off = spread(speed, max_acceleration, age)
    discs = np.zeros((len(points), 6))
    discs[:, :2] = points[:, [LX, LY]]
    discs[:, 4] = discs[:, 5] = 0.5 * _APART + more
    return discs, off
