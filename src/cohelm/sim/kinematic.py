"""The kinematic simulator as a robot behind the port: wheels, delay, odometry, LiDAR, movers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.achievable import achievable
from cohelm.robot.clock import RobotClock
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.robot.model import RobotModel
from cohelm.sim.grid import NO_GRID, Grid
from cohelm.sim.lidar import scan
from cohelm.sim.odometer import next_reading_tick
from cohelm.sim.simulated import SimulatedLidar, SimulatedRobot
from cohelm.sim.world import NOWHERE, World, outline_clearance, place

TICK = 0.002
"""The simulated world moves on in steps of this [s]."""
_ORIGIN = Pose(0.0, 0.0, 0.0)
_LOOKS = 5  # ticks between two looks at the clearance
_MOVING = 1e-9  # a robot slower than this stands [m/s]


class KinematicTruth(NamedTuple):
    """Ground truth, for scores and tests, never for the loop."""

    stamp: float
    pose: Pose
    """In the world frame."""
    twist: Twist
    clearance: float
    """Real outline to the nearest disc or wall, now [m]."""
    least: float
    """The smallest there was so far."""
    least_moving: float
    """The smallest there was while the robot moved: below 0 it drove into something."""


class KinematicState(NamedTuple):
    """What changes from tick to tick."""

    pose: Pose
    twist: Twist
    left: float
    right: float
    yaw: float
    """How far the rims went and the body turned since the last odometry reading [m, m, rad]."""
    least: float
    least_moving: float


class Kinematic(SimulatedRobot):
    """A differential drive that follows commands within its wheels' limits, after a delay.

    It passes through what it hits; `truth` reports it. Movers of `obstacles` go with the robot's
    clock.
    """

    def __init__(
        self,
        model: RobotModel,
        start: Pose = _ORIGIN,
        obstacles: World | None = None,
        *,
        grid: Grid = NO_GRID,
        seed: int = 0,
        clock: RobotClock | None = None,
        timeout: float = 0.5,
        step: float = TICK,
    ) -> None:
        """timeout: without a new command for so long the robot stops by itself [s]. step: of the
        simulated world [s]; with the control period the wheels keep one speed through a period, as
        in the compiled stepper."""
        super().__init__(model, obstacles, grid, seed, clock, timeout, step, sweeps=False)
        self._world = self._world._replace(walls=self._walls)
        self._tick = 0
        self._command = Twist(0.0, 0.0)
        start = Pose(*map(float, start))  # compiled code knows no whole numbers
        self._motion = KinematicState(start, Twist(0.0, 0.0), 0.0, 0.0, 0.0, NOWHERE, NOWHERE)
        self._on(0)

    def truth(self) -> KinematicTruth:
        """How it really is."""
        self._catch_up()
        m = self._motion
        place(self._discs, self._world, self._tick * self._step)
        clearance = outline_clearance(
            m.pose, self._outline, self._reach, self._discs, self._walls, NOWHERE
        )
        return KinematicTruth(
            self._tick * self._step, m.pose, m.twist, clearance, m.least, m.least_moving
        )

    def push(self, x: float, y: float, psi: float) -> None:
        """Displaces the robot by so much [m, m, rad], in the world frame, as if carried; wheels and
        gyro notice nothing."""
        self._catch_up()
        was = self._motion.pose
        self._motion = self._motion._replace(pose=Pose(was.x + x, was.y + y, was.psi + psi))

    def _catch_up(self) -> int:
        """Move the world on to now; the tick that it is then."""
        self._open()
        self._arrive()
        due = math.floor(self._clock.due() / self._step + 1e-6)
        while self._tick < due:
            events = [due, self._next_odometry, self._commanded_at + self._timeout]
            events += [scanner.next for scanner in self._scanners]
            events += [self._coming[0][0]] if self._coming else []
            self._on(min(at for at in events if at > self._tick))
        return self._tick

    def _on(self, tick: int) -> None:
        """Move on to a tick, the next at which anything happens, and let it happen."""
        self._motion = _move(
            self._motion, self._tick, tick, self._command, self._limits, self._outline, self._reach,
            self._world, self._discs, self._step,
        )  # fmt: skip
        self._tick = tick
        self._arrive()
        if tick >= self._commanded_at + self._timeout:
            self._command = Twist(0.0, 0.0)
        if tick >= self._next_odometry:
            self._measure(tick)
        for scanner in self._scanners:
            if scanner.next <= tick:
                self._look(tick, scanner)

    def _arrive(self) -> None:
        """Commands whose delay is over reach the wheels; without a delay, as they are sent."""
        while self._coming and self._coming[0][0] <= self._tick:
            self._command = self._coming.popleft()[1]

    def _measure(self, tick: int) -> None:
        m, rate = self._motion, self._model.odometry.rate_hz
        dt = (tick - round(self._odometry.stamp / self._step)) * self._step
        self._odometry = self._odometer.reading(tick * self._step, dt, m.left, m.right, m.yaw)
        self._motion = m._replace(left=0.0, right=0.0, yaw=0.0)
        self._next_odometry = next_reading_tick(tick, rate, self._step)

    def _look(self, tick: int, scanner: SimulatedLidar) -> None:
        ranges = np.empty(len(scanner.lidar.beams))
        place(self._discs, self._world, tick * self._step)
        scan(
            self._motion.pose, scanner.lidar, self._discs, self._seen_walls, self._grid,
            scanner.seed, scanner.number, ranges,
        )  # fmt: skip
        scanner.measured(ranges, tick, tick, self._step)


@jit
def _move(
    motion: KinematicState, first: int, last: int, command: Twist, limits: Limits, outline: Floats,
    reach: float, obstacles: World, discs: Floats, step: float,
) -> KinematicState:  # fmt: skip
    """From tick to tick under one command; what wheels and gyro went is added up."""
    pose, twist = motion.pose, motion.twist
    left, right, yaw = motion.left, motion.right, motion.yaw
    least, least_moving = motion.least, motion.least_moving
    for k in range(first + 1, last + 1):
        twist = achievable(command, twist, limits, step)
        pose = arc(pose, twist, step)
        turn = 0.5 * limits.track * twist.omega
        left += (twist.v - turn) * step
        right += (twist.v + turn) * step
        yaw += twist.omega * step
        if k % _LOOKS == 0:
            place(discs, obstacles, k * step)
            least = outline_clearance(pose, outline, reach, discs, obstacles.walls, least)
            if abs(twist.v) > _MOVING or abs(twist.omega) > _MOVING:
                least_moving = outline_clearance(
                    pose, outline, reach, discs, obstacles.walls, least_moving
                )
    return KinematicState(pose, twist, left, right, yaw, least, least_moving)
