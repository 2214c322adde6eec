"""A simulated robot that is driven by a script, and what the monitor says of its readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cohelm.core.types import Pose, Twist, disc
from cohelm.robot.achievable import achievable
from cohelm.robot.monitor import Restriction
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.port import Readings
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import Body, world

PERIOD = 0.02
SALLY = robot("sally").model_copy(update={"camera": None})
ROOM = np.array([
    [-3, -2, 6, -2], [6, -2, 6, 2], [6, 2, 2, 2], [2, 2, 2, 3], [2, 3, 1, 3], [1, 3, 1, 2],
    [1, 2, -3, 2], [-3, 2, -3, -2],
], dtype=np.float64)  # fmt: skip
NOTHING = np.empty((0, 4))


def without_noise(model=SALLY):
    """A robot whose LiDAR and odometry are exact."""
    lidar = model.lidar.model_copy(update={"noise_m": 0.0})
    exact = model.odometry.model_validate({"rate_hz": model.odometry.rate_hz})
    return model.model_copy(update={"lidar": lidar, "odometry": exact})


def person(x: float, y: float, vx: float, vy: float) -> Body:
    """Who walks straight on."""
    row = disc(x, y, 0.25, 0.7)
    return Body((*row[:2], vx, vy, *row[4:]))


def stamped_by(readings: Readings, ahead: float) -> Readings:
    """The same by a clock that is ahead [s]."""
    odometry, scan = readings.odometry, readings.scan
    return readings._replace(
        odometry=odometry and odometry._replace(stamp=odometry.stamp + ahead),
        scan=scan and scan._replace(stamp=scan.stamp + ahead),
    )


def watched(
    drive: Callable[[float], Twist], seconds: float, walls=ROOM, people=(), model=SALLY,
    told: Callable[[float, Readings, Kinematic], Readings | None] = lambda t, readings, robot: None,
    seed: int = 5, clock: Callable[[float], float] = lambda t: t,
) -> list[tuple[float, Restriction]]:  # fmt: skip
    """All that the monitor restricts, with when; told: what is read instead. clock: what the
    robot's, and so all stamps, say at a time."""
    simulated = Kinematic(model, Pose(0.0, 0.0, 0.0), world((people, walls)), seed=seed)
    monitor = PlausibilityMonitor(model)
    limits, sent, said = model.bounds(), Twist(0.0, 0.0), []
    for k in range(1, round(seconds / PERIOD)):
        t = k * PERIOD
        simulated.wait(t)
        readings = simulated.read()
        readings = told(t, readings, simulated) or readings
        readings = stamped_by(readings, clock(t) - t)
        restriction = monitor.observe(clock(t), readings, sent)
        sent = achievable(drive(t), sent, limits, PERIOD)
        if restriction.share == 1.0 and not restriction.fault:
            restriction = monitor.restrict(clock(t), sent)
        if restriction.fault or restriction.share < 1.0:
            said.append((t, restriction))
        simulated.send(sent)
    return said
