"""Every adapter of the port `robot.port.Robot`, and what the conformance suite may ask of it.

A new adapter adds itself to `ADAPTERS`; the suite then holds it to the port's promises.
"""

import atexit
import io
import math
import shutil
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from cohelm.core.row import ROW
from cohelm.core.types import Pose, Twist
from cohelm.link.bulk_messages import LineKind, Map, Polyline, Zone, ZoneMap
from cohelm.link.messages import Alarm, AlarmKind, Discs, Mode, Severity
from cohelm.link.recorded_status import Displayed, StatusWords
from cohelm.record.file import About, RecordWriter
from cohelm.record.replay import Replayed
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.base import Robot as BaseRobot
from cohelm.robot.clock import WallClock
from cohelm.robot.keep.record_pipe import Event
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Encoded, Readings, RobotPort
from cohelm.scenario.load import robot as load_robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.sim.world import World, world


class Adapter(NamedTuple):
    make: Callable[[], RobotPort]
    """A new robot, standing, at least 2 m from anything."""
    obeys: bool = True
    """Whether it moves as it is told; a replayed record does not."""
    real_time: bool = False
    """Whether `now()` is the clock on the wall."""
    timeout: float = 0.5
    """After how long without a command it stops by itself [s]."""


def sally() -> RobotModel:
    return load_robot("sally")


def room() -> World:
    walls = [[-4, -3, 6, -3], [6, -3, 6, 3], [6, 3, -4, 3], [-4, 3, -4, -3]]
    return world(([], np.array(walls, dtype=np.float64)))


START = Pose(0.0, 0.0, 0.0)


SHOWN = (
    StatusWords(3, "ann", Mode.SHARED, "", "near a wall", 0.4, "the link is slow",
         (Alarm(7, Severity.WARNING, True, False, "the stick is lost"),
          Alarm(8, Severity.ALARM, True, True, "lost: nothing fits", AlarmKind.LOST))),
    Map(1, Pose(-4.0, -3.0, 0.5), 0.05, 3, 2, 0, 0, 3, 2, zlib.compress(bytes([0, 100, 255] * 2))),
    ZoneMap(Zone.KEEP_OUT, Pose(1.0, 2.0, 0.5), 0.05, math.nan, 2, 1, zlib.compress(b"\0d")),
    ZoneMap(Zone.SPEED, Pose(-1.0, 2.0, 0.0), 0.1, math.nan, 1, 2, zlib.compress(bytes([40, 0]))),
    Polyline(LineKind.REFERENCE, np.array([[0.0, 0.0], [1.0, 0.5]], dtype=np.float32)),
    Polyline(LineKind.DETOUR, np.array([[0.0, 0.5], [1.0, 0.5]], dtype=np.float32)),
    Polyline(LineKind.WAYPOINTS, np.array([[1.0, 0.5]], dtype=np.float32)),
    Discs(0, np.array([[2.0, 1.0, 0.25, -0.5, 0.25, 0.75]], dtype=np.float32)),
)  # fmt: skip
"""What stations were shown of a drive, one of each kind."""


def recorded(path: Path, seconds: float) -> Path:
    """A drive on a curve, written down as the loop does it."""
    robot = Kinematic(sally(), START, room(), seed=4)
    row = np.zeros((), dtype=ROW)
    row["applied_v"], row["applied_omega"] = 0.3, 0.4
    with path.open("wb") as file:
        drive = RecordWriter(file, About("drive", 1_700_000_000_000_000_000), sally())
        last = -1
        while robot.now() < seconds:
            robot.send(Twist(0.3, 0.4))
            readings = robot.read()
            drive.write(readings.odometry)
            if readings.scan.number > last:
                drive.write(readings.scan)
                last = readings.scan.number
            row["t"] = robot.now()
            drive.period(row)
            robot.wait(robot.now() + 0.02)
        for what in SHOWN:
            drive.write(Displayed(robot.now(), what))
        grey = io.BytesIO()
        Image.new("RGB", (8, 6), (99, 99, 99)).save(grey, "JPEG")
        drive.write(Encoded(robot.now(), 0, grey.getvalue()))
        drive.write(Event(robot.now(), "loop", "the end"))
        drive.finish()
    return path


@cache
def _replayed() -> Path:
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return recorded(folder / "drive.mcap", 3.0)


class Own(BaseRobot):
    """A robot by somebody else: three methods. Inside, a kinematic one without a time-out."""

    def __init__(self, real_time: bool) -> None:
        super().__init__(sally())
        self.real_time = real_time
        clock = WallClock() if real_time else None
        self._inside = Kinematic(self.model, START, room(), seed=3, timeout=1e6, clock=clock)
        self._number = -1
        self.now, self.wait = self._inside.now, self._inside.wait

    def read(self) -> Readings:
        odometry, scan, *_ = self._inside.read()
        if scan is None or scan.number == self._number:
            return Readings(odometry)
        self._number = scan.number
        return Readings(odometry, self.scan(scan.ranges, self.now() - scan.stamp))

    def send(self, twist: Twist) -> None:
        self._inside.send(twist)

    def stop(self) -> None:
        self._inside.stop()


ADAPTERS: dict[str, Adapter] = {
    "own": Adapter(lambda: RobotAdapter(Own(real_time=False))),
    "own, real time": Adapter(lambda: RobotAdapter(Own(real_time=True)), real_time=True),
    "kinematic": Adapter(lambda: Kinematic(sally(), START, room(), seed=3)),
    "replayed": Adapter(lambda: Replayed(_replayed()), obeys=False),
    "kinematic, real time": Adapter(
        lambda: Kinematic(sally(), START, room(), seed=3, clock=WallClock()), real_time=True
    ),
    "twin": Adapter(lambda: Twin(sally(), START, room(), seed=3, camera="none")),
    "twin, real time": Adapter(
        lambda: Twin(sally(), START, room(), seed=3, clock=WallClock(), camera="none"),
        real_time=True,
    ),
}
