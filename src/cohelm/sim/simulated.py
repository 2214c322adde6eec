"""What the simulated robots share: commands on their way to the wheels, odometry, LiDARs, time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque

import numpy as np
from numpy.typing import NDArray

from cohelm.core.scalars import is_finite
from cohelm.core.types import Floats, Twist
from cohelm.robot.achievable import achievable
from cohelm.robot.clock import ClockedRobot, RobotClock
from cohelm.robot.limits import unbraked
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Health, Readings, Scan, untouched
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import Grid, borders
from cohelm.sim.lidar import noise_seed
from cohelm.sim.odometer import Odometer, next_reading_tick, reading_tick
from cohelm.sim.world import World, world

_STILL = Twist(0.0, 0.0)


class SimulatedLidar:
    """One LiDAR at work."""

    def __init__(self, model: LidarModel, seed: int, sweep: int) -> None:
        """seed: of its noise. sweep: from a scan's first beam to its last, in steps."""
        self.model, self.lidar, self.seed, self.sweep = model, model.lidar(), seed, sweep
        self.coming: deque[tuple[int, Scan]] = deque()
        """Scans that are measured, with the steps at which they can be read."""
        self.number, self.next = 0, sweep
        """Of the next scan, and the step of its last beam."""
        self._newest: Scan | None = None

    def come(self, step: int) -> Scan | None:
        """The newest scan that can be read."""
        while self.coming and self.coming[0][0] <= step:
            self._newest = self.coming.popleft()[1]
        return self._newest

    def measured(
        self, ranges: Floats, began: int, readable: int, step: float,
        edges: NDArray[np.bool_] | None = None,
    ) -> None:  # fmt: skip
        """Take a scan that began at one step and can be read at another. step: their length [s].
        edges: as of a scan."""
        if self.model.range_sensor:
            ranges[:] = ranges.min()
        ranges.flags.writeable = False
        made = Scan(began * step, self.number, ranges, self.sweep * step, self.model.name, edges)
        self.coming.append((readable, made))
        self.number += 1
        self.next = self.sweep + next_reading_tick(began, self.model.rate_hz, step)


class SimulatedRobot(ClockedRobot, ABC):
    """A robot whose world moves on in steps, whenever it is called, up to the time of its clock."""

    def __init__(
        self, model: RobotModel, obstacles: World | None, grid: Grid, seed: int,
        clock: RobotClock | None, timeout: float, step: float, *, sweeps: bool,
    ) -> None:  # fmt: skip
        """timeout: without a new command for so long the robot stops by itself [s]. step: of the
        simulated world [s]. sweeps: whether its LiDARs turn while it drives."""
        super().__init__(model, clock)
        self._step, self._grid = step, grid
        self._limits, self._outline, self._reach = model.bounds(), model.outline, model.reach
        self._world = world(([], np.empty((0, 4)))) if obstacles is None else obstacles
        self._seen_walls = self._world.walls  # a LiDAR sees the grid itself
        self._walls = np.vstack((self._seen_walls, borders(grid)))
        self._discs = np.empty((len(self._world.discs), 6))
        self._timeout = max(self._steps(timeout), 1)
        self._delay = self._steps(model.delay_s)
        self._commanded_at = 0
        self._coming: deque[tuple[int, Twist]] = deque()
        """Commands on their way, with the steps at which they reach the wheels."""
        self._odometer = Odometer(model.odometry, seed)
        self._odometry = self._odometer.start(0.0)
        self._next_odometry = reading_tick(model.odometry.rate_hz, 1, step)
        self._scanners = [
            SimulatedLidar(lidar, noise_seed(seed, i), self._steps(lidar.sweep_s) if sweeps else 0)
            for i, lidar in enumerate(model.lidars)
        ]

    @abstractmethod
    def _catch_up(self) -> int:
        """Move the world on to now; the step that it is at then."""

    def _steps(self, seconds: float) -> int:
        return round(seconds / self._step)

    def read(self) -> Readings:
        """The newest readings."""
        step = self._catch_up()
        scans = [scanner.come(step) for scanner in self._scanners]
        return Readings(
            self._odometry, scans[0] if scans else None, self._frame(), self._health(),
            tuple(scan for scan in scans[1:] if scan is not None),
            untouched(self._model, self.now()),
        )  # fmt: skip

    def send(self, twist: Twist) -> Twist:
        """Send a command; it reaches the wheels after the robot's delay."""
        self._commanded_at = self._catch_up()
        if not (is_finite(twist.v) and is_finite(twist.omega)):
            twist = _STILL
        twist = Twist(float(twist.v), float(twist.omega))
        possible = achievable(twist, _STILL, unbraked(self._limits), self._step)
        self._coming.append((self._commanded_at + self._delay, possible))
        return possible

    def stop(self) -> None:
        """Brake; what is still on its way to the wheels no longer matters, but for a stop: sent
        again and again it would never arrive."""
        due = self._catch_up() + self._delay
        stops = [at for at, twist in self._coming if twist == _STILL]
        self._coming.clear()
        self._coming.append((min([due, *stops]), _STILL))

    def _frame(self) -> Frame | None:
        return None

    def _health(self) -> Health:
        return Health(self.now(), math.nan, ())
