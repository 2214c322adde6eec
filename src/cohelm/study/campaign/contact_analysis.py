"""Analyses a contact: what could have been known of the obstacle before it was touched."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import compose, placed
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.perceive.track.params import TrackerParams
from cohelm.robot.achievable import braking_time
from cohelm.robot.clearance import disc_clearance, segment_clearance
from cohelm.robot.sensors import Lidar
from cohelm.sim.lidar import sight
from cohelm.sim.setup import Setup, Twinned

_BEAMS = 5  # of a scan that end on a thing: fewer do not count as having it in view
_ON = 0.01  # an end as near to a disc's surface as this is on it [m]
_AROUND = 0.1  # of a wall, what is as near to where it was touched as this [m]


class Touch(NamedTuple):
    """See the columns of `Row` that begin with contact_."""

    seen: float
    needed: float
    share: float
    speed: float
    driven: float


NOTHING_TOUCHED = Touch(math.nan, math.nan, math.nan, math.nan, math.nan)


def first_touch(
    setup: Setup, twin: Twinned, rows: NDArray[np.void], discs: Floats, when: float
) -> Touch:
    """Facts of the contact at time `when` [s]. rows: (n,) of a drive, discs: (n, m, 6)."""
    k = int(np.argmin(np.abs(rows["t"] - when)))
    pose, walls = _pose(rows[k]), setup.obstacles.walls
    at = discs[k]
    clearances = [disc_clearance(pose, setup.outline, d[X], d[Y], d[RADIUS]) for d in at]
    clearances += [segment_clearance(pose, setup.outline, *wall) for wall in walls.tolist()]
    which = int(np.argmin(clearances))
    disc = discs[max(k - 1, 0)][which] if which < len(at) else None  # before it bumped, and stood
    speed = 0.0 if disc is None else math.hypot(disc[VX], disc[VY])
    turn = setup.reach * abs(float(rows["applied_omega"][k]))
    driven = abs(float(rows["applied_v"][k])) + turn
    first = twin.robot.lidar
    if first is None:
        return Touch(0.0, 0.0, 0.0, speed, driven)
    place = (0.0, 0.0) if disc is not None else _place(pose, setup.outline, walls[which - len(at)])
    lidars, every = [one.lidar() for one in twin.robot.lidars], 1.0 / (first.rate_hz * setup.dt)
    steps = [k - round(j * every) for j in range(int(k / every) + 1)]
    view = [
        any(_in_view(setup, lidar, rows[j], discs[j], which, place) for lidar in lidars)
        for j in steps
    ]
    unbroken = view.index(False) if False in view else len(view)
    came = rows[steps[min(unbroken, len(steps) - 1)]]
    needed = _notices(twin) + braking_time(
        Twist(float(came["applied_v"]), float(came["applied_omega"])), setup.limits
    )
    return Touch(unbroken * every * setup.dt, needed, float(np.mean(view)), speed, driven)


def _notices(twin: Twinned) -> float:
    """How long it takes at most until what comes into view makes the robot brake [s]: the scans
    that must show that it moves, the first of them a period away, and the delays of LiDAR and
    wheels."""
    robot = twin.robot
    first = robot.lidars[0]
    more = (TrackerParams().proof - 1) / first.rate_hz
    return robot.scan_age + more + robot.delay_s


def _in_view(
    setup: Setup, lidar: Lidar, row: NDArray[np.void], discs: Floats, which: int,
    place: tuple[float, float],
) -> bool:  # fmt: skip
    """Whether enough beams of a scan from there end on disc `which`, or at the place on a wall."""
    ranges, walls = np.empty(len(lidar.beams)), setup.obstacles.walls
    pose = _pose(row)
    sight(pose, lidar, discs, walls, setup.grid, ranges)
    near = ranges < lidar.range_max
    ends = placed(ranges[near, None] * lidar.beams[near], compose(pose, lidar.mount))
    if which < len(discs):
        x, y, radius = discs[which, [X, Y, RADIUS]]
        on = np.abs(np.hypot(ends[:, 0] - x, ends[:, 1] - y) - radius) < _ON
    else:
        on = np.hypot(ends[:, 0] - place[0], ends[:, 1] - place[1]) < _AROUND
    return bool(on.sum() >= _BEAMS)


def _place(pose: Pose, outline: Floats, wall: Floats) -> tuple[float, float]:
    """The point of a wall that is nearest to the outline."""
    share = np.linspace(0.0, 1.0, max(round(math.dist(wall[:2], wall[2:]) / 0.01), 1) + 1)
    points = wall[:2] + share[:, None] * (wall[2:] - wall[:2])
    near = points[np.hypot(*(points - pose[:2]).T) < 2.0]
    clearances = [disc_clearance(pose, outline, x, y, 0.0) for x, y in near.tolist()]
    x, y = near[int(np.argmin(clearances))].tolist()
    return x, y


def _pose(row: NDArray[np.void]) -> Pose:
    return Pose(float(row["x"]), float(row["y"]), float(row["psi"]))
