"""Robots whose motion can be seen from another process, whatever stands still meanwhile."""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Twist
from cohelm.robot.clock import WallClock
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Readings
from cohelm.robot.sensors import CameraModel
from cohelm.scenario.load import robot as described
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import world

SALLY = described("sally", Path())
HALL = np.array([[-5.0, -3.0, 60.0, -3.0], [-5.0, 3.0, 60.0, 3.0], [60.0, -3.0, 60.0, 3.0]])
"""Walls far off the way of a robot that drives straight on [m]."""
_TRACE = struct.Struct("=ddd")


class Moved(NamedTuple):
    """What a robot did last, as far as its process has worked it out."""

    t: float
    x: float
    v: float


class Watch:
    """The other end of a robot's trace."""

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(_TRACE.size))
        self.path = path

    def now(self) -> Moved:
        return Moved(*_TRACE.unpack(self.path.read_bytes()))


@dataclass(frozen=True)
class Traced:
    """Makes a kinematic robot in a hall, with a camera, that leaves its trace in a file."""

    trace: Path
    width: int = 0
    """Of the camera's pictures, 3:4; 0: no camera [pixels]."""
    beams: int = 720

    @property
    def model(self) -> RobotModel:
        camera = CameraModel(width=self.width, height=self.width * 3 // 4) if self.width else None
        lidar = SALLY.lidar.model_copy(update={"beams": self.beams})
        return SALLY.model_copy(update={"camera": camera, "lidar": lidar})

    def __call__(self) -> Kinematic:
        return _Leaving(self)


class _Leaving(Kinematic):
    def __init__(self, made: Traced) -> None:
        super().__init__(made.model, obstacles=world(([], HALL)), clock=WallClock())
        with made.trace.open("r+b") as file:
            self._trace = mmap.mmap(file.fileno(), _TRACE.size)
        camera = made.model.camera
        self._pixels = np.zeros((camera.height, camera.width, 3) if camera else 0, dtype=np.uint8)
        self._sees = camera is not None

    def read(self) -> Readings:
        readings = super().read()
        if not self._sees:
            return readings
        number = int(self.now() * 15.0)
        self._pixels[:] = number % 256
        return readings._replace(frame=Frame(number / 15.0, number, self._pixels))

    def send(self, twist: Twist) -> Twist:
        done = super().send(twist)
        self._leave()
        return done

    def stop(self) -> None:
        super().stop()
        self._leave()

    def _on(self, tick: int) -> None:
        super()._on(tick)
        if hasattr(self, "_trace"):
            self._leave()

    def _leave(self) -> None:
        motion = self._motion
        self._trace[:] = _TRACE.pack(self._tick * 0.002, motion.pose.x, motion.twist.v)
