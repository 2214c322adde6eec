"""A robot in the corridor whose sensors fail at a set time; it can be made in any process."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cohelm.core.types import Pose, Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.robot.port import Health, Readings, Scan
from cohelm.scenario.model import Scenario
from tests.drive.wrapped import wrapped

CORRIDOR = Path(__file__).parent / "corridor.yaml"


def along_corridor(end: float, start: float = 0.0) -> Simulated:
    """A robot with few beams and no camera, whose route ends so far along the corridor [m]."""
    middle = 0.5 * (start + end)
    route = [f"reference.waypoints_m=[[{start}, 0], [{middle}, 0], [{end}, 0]]"]
    made = simulated(CORRIDOR, real_time=False, seed=2, changes=route)
    return Simulated(coarse(made), made.kind, False, made.seed)


def coarse(made: Simulated) -> Scenario:
    """Its scenario with few beams and no camera."""
    lidar = made.model.lidar.model_copy(update={"beams": 120})
    model = made.model.model_copy(update={"lidar": lidar, "camera": None})
    return made.scenario.model_copy(update={"robot": model})


FAULTS = {
    "odometry stops": "the odometry is",
    "odometry is not a number": "the odometry is not a number",
    "odometry is gone": "there is no odometry",
    "odometry jumps": "the odometry jumped by",
    "scans stop": "the scan is",
    "scans are no number": "the scan is not a number",
    "clock jumps on": "after its stamp: a clock jumped",
    "clock jumps back": "from the future: a clock jumped",
    "bumper": "the robot reports: the bumper is pressed",
}
REAR_FAULTS = {
    "rear scans stop": "rear LiDAR: the scan is",
    "rear scans are gone": "rear LiDAR: there is no scan",
    "rear scans are no number": "rear LiDAR: the scan is not a number",
    "rear scans freeze": "rear LiDAR: the scan repeats",
    "rear scans are empty": "rear LiDAR: ",
}
"""What can happen, and what the record says then."""
JUMPS = {"clock jumps on": 5.0, "clock jumps back": -1.0}
"""By how much the robot's clock does [s]."""
NOTICED = {
    "scans stop": 0.40, "odometry stops": 0.12, "rear scans stop": 0.40, "rear scans freeze": 0.2,
    "rear scans are empty": 1.0,
}  # fmt: skip
"""How long it may take until a loss is noticed [s]; others within two periods."""
HELD_UP = "the loop is held up"
"""No fault: between looking at the clock and reading, other processes had the processor."""


@dataclass(frozen=True)
class Failing(Simulated):
    """Fails in one way, from a time of the robot's clock on."""

    fault: str = ""
    at: float = math.inf
    when: Path | None = None

    def maker(self):
        return wrapped(super().maker(), Faulty, self.fault, self.at, self.when)


def failing(
    fault: str, at: float, real_time: bool = False, when: Path | None = None
) -> Failing:  # fmt: skip
    """At a time of the robot's clock [s], or once a file is there: then that time is put in it."""
    changes = ["robot=sally-rear"] if fault in REAR_FAULTS else []
    made = simulated(CORRIDOR, real_time=real_time, seed=2, changes=changes)
    scenario = made.scenario if real_time or fault in REAR_FAULTS else coarse(made)
    return Failing(scenario, made.kind, real_time, made.seed, fault, at, when)


class Faulty:
    """Another robot, seen through broken glass."""

    def __init__(self, robot, fault: str, at: float, when: Path | None = None) -> None:
        self._robot, self._fault, self._at, self._when = robot, fault, at, when
        self._kept: Readings | None = None
        self._rear: Scan | None = None

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def _broken(self) -> bool:
        if self._when is not None and self._at == math.inf and self._when.exists():
            self._at = self._robot.now()
            self._when.write_text(f"{self._at}")
        return bool(self._fault) and self._robot.now() >= self._at

    def now(self) -> float:
        t = self._robot.now()
        if self._broken() and self._fault.startswith("clock"):
            return t + JUMPS[self._fault]
        return t

    def wait(self, until: float) -> None:
        self._robot.wait(until - (self.now() - self._robot.now()))

    def read(self) -> Readings:
        if self._broken() and self._fault == HELD_UP:
            self._robot.wait(self._robot.now() + 0.06)
        readings = self._robot.read()
        if not self._broken():
            self._kept = readings
            return readings
        kept, odometry, scan = self._kept or readings, readings.odometry, readings.scan
        match self._fault:
            case "odometry stops":
                return readings._replace(odometry=kept.odometry)
            case "odometry is not a number":
                return readings._replace(odometry=odometry._replace(pose=Pose(math.nan, 0.0, 0.0)))
            case "odometry is gone":
                return readings._replace(odometry=None)
            case "odometry jumps":
                x, y, psi = odometry.pose
                return readings._replace(odometry=odometry._replace(pose=Pose(x + 1.0, y, psi)))
            case "scans stop":
                return readings._replace(scan=kept.scan)
            case "scans are no number":
                return readings._replace(scan=scan._replace(ranges=scan.ranges * math.nan))
            case "rear scans stop":
                return readings._replace(further=kept.further)
            case "rear scans are gone":
                return readings._replace(further=())
            case "rear scans are no number":
                return self._behind(readings, readings.further[0].ranges * math.nan)
            case "rear scans freeze":
                return self._behind(readings, kept.further[0].ranges)
            case "rear scans are empty":
                return self._behind(readings, np.full(len(kept.further[0].ranges), math.inf))
            case "bumper":
                said = ("the bumper is pressed",)
                return readings._replace(health=Health(self.now(), math.nan, said))
        return readings

    def _behind(self, readings: Readings, ranges) -> Readings:
        """With other ranges of the rear LiDAR, the same as long as its scan is."""
        (scan,) = readings.further
        if self._rear is None or self._rear.number != scan.number:
            self._rear = scan._replace(ranges=ranges)
        return readings._replace(further=(self._rear,))

    def send(self, twist: Twist) -> Twist:
        return self._robot.send(twist)
