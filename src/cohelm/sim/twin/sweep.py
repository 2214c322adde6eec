"""A LiDAR that turns while the robot drives: every beam from where the sensor was at its time."""

from __future__ import annotations

import math

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, X, Y
from cohelm.robot.sensors import Lidar
from cohelm.sim.grid import Grid
from cohelm.sim.lidar import sight
from cohelm.sim.twin.movers import MovingDiscs
from cohelm.sim.twin.physics import PhysicsHistory


@jit
def sweep(
    first: int, steps: int, trail: PhysicsHistory, lidar: Lidar, discs: Floats, movers: MovingDiscs,
    walls: Floats, grid: Grid, ranges: Floats,
) -> None:  # fmt: skip
    """True distances of a scan that began at step `first` and took `steps`, into `ranges` [m].

    steps = 0: all beams at one instant. Otherwise the beams of each step start from the middle
    of the robot's way in it, and turn with the robot: heading runs evenly within the step, so
    beams stay evenly spaced, only wider or narrower. discs: (d, 6), movers' rows are written to.
    """
    n = len(ranges)
    for k in range(max(steps, 1)):
        low, high = (0, n) if steps == 0 else (n * k // steps, n * (k + 1) // steps)
        if low == high:
            continue
        a = trail.poses[(first + k) % len(trail.poses)]
        b = a if steps == 0 else trail.poses[(first + k + 1) % len(trail.poses)]
        row = (first + k) % len(trail.places)
        for m in range(len(movers.which)):
            discs[movers.which[m], X] = trail.places[row, m, 0]
            discs[movers.which[m], Y] = trail.places[row, m, 1]
        slow = (b[2] - a[2]) / (high - low)  # the robot's turn from one beam to the next [rad]
        step = lidar.step + slow
        beams = lidar.beams[low:high].copy()
        if slow != 0.0:
            for i in range(high - low):
                bearing = lidar.first + lidar.step * (low + i) + slow * i
                beams[i, 0], beams[i, 1] = math.cos(bearing), math.sin(bearing)
        part = Lidar(
            lidar.mount, lidar.first + lidar.step * low, step, lidar.range_min, lidar.range_max,
            lidar.noise, lidar.lost, beams, lidar.whole_from, lidar.floor_from, lidar.floor_to,
        )  # fmt: skip
        pose = Pose(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), a[2])
        sight(pose, part, discs, walls, grid, ranges[low:high])
