"""Potentially dynamic points: they stand on ground that was free a while ago.

An object is covered by them until `tracker` proves that it moves, while two are merged, and after
its track was dropped. Each is reported as a small disc of unknown velocity, and as a static point
too; once it has stood, as a disc that may begin to move. An object nearer to the LiDAR than its
minimum range is one such point at the LiDAR.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.perceive.scan.deskew import (
    FREE,
    NO_SWEEP,
    DeskewedScan,
    beam_at,
    in_sensor_frame,
    was_free,
)
from cohelm.perceive.space.free_space_memory import (
    CERTAINLY,
    NEAR,
    POSSIBLY,
    FreeSpaceMemory,
    appeared,
    empty_memory,
    with_scan,
)
from cohelm.perceive.track.params import PotentiallyDynamicParams
from cohelm.robot.sensors import Lidar

LX, LY, STOOD = range(3)
"""Columns of the points: position in `odom` [m], whether it has stood (1) or not (0)."""

_APART = 0.06  # minimum spacing of the points [m]
_COVERED_ANGLE = 0.3  # adjacent beams that end below the minimum range [rad]


class Appeared(NamedTuple):
    """What has appeared near one LiDAR by its newest sweep.

    free_space: near the robot. clock: its clock [s]. points: (l, 3), potentially dynamic ones.
    certain: those that would be so without possibly occupied ground. covered: whether an object is
    within the LiDAR's minimum range.
    """

    free_space: FreeSpaceMemory
    clock: float
    points: Floats
    certain: Floats
    covered: bool


def nothing_appeared(lidar: Lidar, dynamic: PotentiallyDynamicParams) -> Appeared:
    """Of a LiDAR that has not looked yet."""
    memory, nothing = empty_memory(_free_within(lidar, dynamic)), np.empty((0, 3))
    return Appeared(memory, 0.0, nothing, nothing, False)


def _free_within(lidar: Lidar, dynamic: PotentiallyDynamicParams) -> float:
    """Range of the free-space memory from a LiDAR [m]: all that is considered."""
    return max(NEAR, dynamic.near + math.hypot(lidar.mount.x, lidar.mount.y))


def update_appeared(
    before: Appeared, sweep: DeskewedScan, places: Floats, of_movers: NDArray[np.bool_],
    fixed: NDArray[np.bool_], sweeps: Sequence[DeskewedScan], stood: Sequence[DeskewedScan],
    dt: float, way: float, dynamic: PotentiallyDynamicParams,
) -> Appeared:  # fmt: skip
    """After a sweep, whose points are at `places` in `odom`.

    of_movers, fixed: (m,) which of them belong to movers, and are on walls of a map. sweeps: those
    of a while before. stood: two of them; a point has stood if it was there in both. dt, way: time
    since the sweep before, and distance driven [s, m].
    """
    covered = bool((sweep.ranges == -math.inf).any()) and any(
        is_covered(sweep, one, before.covered) for one in (*sweeps, NO_SWEEP)
    )
    clock = before.clock + dt + way * dynamic.keep / dynamic.vouched
    near = (np.hypot(sweep.points[:, 0], sweep.points[:, 1]) < dynamic.near) & ~of_movers & ~fixed
    found = which_appeared(places, near, before.free_space, clock - dynamic.keep, sweep)
    free_space = with_scan(
        before.free_space, sweep, places[~of_movers & (found == 0)], clock,
        _free_within(sweep.lidar, dynamic),
    )  # fmt: skip
    points = certain = np.empty((0, 3))
    if found.any():
        points, certain = (
            potentially_dynamic_points(places, which, stood[0], stood[1])
            for which in (found >= POSSIBLY, found == CERTAINLY)
        )
    if covered:
        here = (sweep.sensor.x, sweep.sensor.y, 1.0)
        points, certain = np.vstack((points, here)), np.vstack((certain, here))
    return Appeared(free_space, clock, points, certain, covered)


@jit
def which_appeared(
    places: Floats, near: NDArray[np.bool_], free_space: FreeSpaceMemory, since: float,
    sweep: DeskewedScan,
) -> Ints:  # fmt: skip
    """(m,) whether a sweep's points in `odom` have appeared since then, of those that are `near`,
    see `appeared`. A point may be farther by one standard deviation of a range."""
    found = np.zeros(len(places), np.int64)
    for i in range(len(places)):
        if near[i]:
            x, y = places[i, 0], places[i, 1]
            wx, wy = x - sweep.sensor.x, y - sweep.sensor.y
            far = sweep.lidar.noise / max(math.hypot(wx, wy), 0.05)
            found[i] = appeared(free_space, x + far * wx, y + far * wy, since)
    return found


@jit
def potentially_dynamic_points(
    places: Floats, appeared: NDArray[np.bool_], first: DeskewedScan, second: DeskewedScan
) -> Floats:
    """The potentially dynamic points, (l, 3), of those in `odom`, where `appeared`.

    first, second: two earlier sweeps; a point has stood if it was there in both.
    """
    out = np.empty((len(appeared), 3))
    k = 0
    for i in range(len(appeared)):
        if not appeared[i]:
            continue
        x, y = places[i, 0], places[i, 1]
        stood = _ended_there(first, x, y) and _ended_there(second, x, y)
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
def is_covered(sweep: DeskewedScan, earlier: DeskewedScan, covered_before: bool) -> bool:
    """Whether an object covers the LiDAR: many adjacent beams end below the minimum range, and it
    was covered before, or space was free there in an earlier sweep. An obstacle that the robot
    drove up to is static, and not meant."""
    lidar, n, run = sweep.lidar, len(sweep.ranges), 0
    c, s = math.cos(sweep.sensor.psi), math.sin(sweep.sensor.psi)
    appeared = covered_before
    for i in range(n):
        if sweep.ranges[i] != -math.inf:
            run, appeared = 0, covered_before
            continue
        run += 1
        if not appeared and len(earlier.ranges) == n:
            x, y = lidar.range_min * lidar.beams[i, 0], lidar.range_min * lidar.beams[i, 1]
            x, y = sweep.sensor.x + c * x - s * y, sweep.sensor.y + s * x + c * y
            appeared = was_free(earlier, x, y, 0.0)
        if appeared and run * lidar.step > _COVERED_ANGLE:
            return True
    return False


@jit
def _ended_there(earlier: DeskewedScan, x: float, y: float) -> bool:
    """Whether a beam of an earlier sweep ended near there."""
    sx, sy = in_sensor_frame(earlier.sensor, x, y)
    beam, far = beam_at(earlier.lidar, sx, sy), math.hypot(sx, sy)
    for k in range(max(beam - 2, 0), min(beam + 3, len(earlier.ranges))):
        if abs(earlier.ranges[k] - far) < FREE:
            return True
    return False


def grown(speed: Floats, max_acceleration: float, age: float) -> tuple[Floats, Floats]:
    """By how much discs have grown, and the bound of their velocity errors, `age` after these were
    bounded by `speed` [m, m/s]."""
    gained = max_acceleration * age
    return speed * age + 0.5 * gained * age, speed + gained


def discs_of_points(
    points: Floats, age: float, max_acceleration: float, dynamic: PotentiallyDynamicParams
) -> tuple[Floats, Floats]:
    """The points as discs, (l, 6), `age` [s] later, and bounds of their velocity errors (l,)."""
    stood = points[:, STOOD] > 0.0
    speed = np.where(stood, dynamic.creeping, dynamic.fastest)
    growth, velocity_error = grown(speed, max_acceleration, age)
    discs = np.zeros((len(points), 6))
    discs[:, :2] = points[:, [LX, LY]]
    discs[:, 4] = discs[:, 5] = 0.5 * _APART + growth
    return discs, velocity_error
