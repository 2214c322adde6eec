"""The twin as a robot behind the port: MuJoCo's physics, sensors with their errors, delays."""

from __future__ import annotations

import math
import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.clock import RobotClock, SteppedClock
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Frame, Health
from cohelm.sim.grid import NO_GRID, Grid
from cohelm.sim.lidar import measure
from cohelm.sim.odometer import next_reading_tick
from cohelm.sim.simulated import SimulatedLidar, SimulatedRobot
from cohelm.sim.twin.camera import OUTSIDE, Eye, Kind, Shot, camera
from cohelm.sim.twin.engine import mujoco
from cohelm.sim.twin.mjcf import mjcf, rolling_torque, servo_gain, torque_limit
from cohelm.sim.twin.movers import MovingDiscs, Pursuers, Pursuit
from cohelm.sim.twin.physics import STATE, PhysicsHistory, WheelDrives, advance, views
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.twin.sweep import sweep
from cohelm.sim.world import NOWHERE, World, ever_moving, outline_clearance, place

STEP = 0.005
"""Physics moves on in steps of this, or a little less: a whole number of them make 10 ms [s]."""
_SETTLING = 100  # steps in which the robot sinks onto its wheels before time begins
_CHUNK = 64  # steps that are made in one go at most
_TIPPED = math.radians(20.0)
_ORIGIN, _DEFAULT = Pose(0.0, 0.0, 0.0), TwinModel()


class TwinTruth(NamedTuple):
    """Ground truth, for scores and tests, never for the loop."""

    stamp: float
    pose: Pose
    """In the world frame; the heading is not wrapped."""
    twist: Twist
    side: float
    """Speed to the left: the wheels slip sideways [m/s]."""
    clearance: float
    """Real outline to the nearest disc or wall, now; from geometry [m]."""
    least: float
    """The smallest there was so far [m]."""
    least_moving: float
    """The smallest there was while the robot moved: below 0 it drove into something [m]."""
    touched: int
    """Contacts that began, as physics felt them."""
    touching: bool
    """Whether there is one now."""
    standing: bool
    """Whether it came to rest and its drives rest since; a nudge does not change that."""
    force: float
    """The largest force of a contact so far [N]."""
    energy: float
    """What the drives have put in; braking gives nothing back [J]."""


class Twin(SimulatedRobot):
    """A differential-drive robot simulated in MuJoCo.

    What it hits holds it back. Movers of `obstacles` go with the robot's clock; one that bumps into
    it goes round it, and is never pushed aside. Runs are equal to the last bit for equal seeds and
    calls, with the clock `SteppedClock`.
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
        settings: TwinModel = _DEFAULT,
        camera: Kind = "auto",
        pursuers: Pursuers | None = None,
    ) -> None:
        """timeout: without a new command for so long the robot stops by itself [s].

        camera: the renderer, if the robot has one. In real time it renders in a thread of its own.
        pursuers: those of the moving discs that pursue the robot.
        """
        model = settings.fitted(model)
        super().__init__(model, obstacles, grid, seed, clock, timeout, STEP, sweeps=True)
        obstacles = self._world
        place(self._discs, obstacles, 0.0)
        which = np.flatnonzero(ever_moving(obstacles))
        pursuers = pursuers or Pursuers(np.zeros(len(self._discs)), 0.0, 0)
        hunt = Pursuit(
            pursuers.max_acceleration[which], pursuers.fastest, pursuers.seed,
            np.zeros((len(which), 2)),
        )  # fmt: skip
        self._movers = MovingDiscs(which, obstacles, np.zeros((len(which), 5)), hunt)
        text = mjcf(model, settings, STEP, self._discs, which.tolist(), obstacles.walls, grid)
        try:
            self.mujoco: Any = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            raise CohelmError(f"MuJoCo can not build the twin's world: {error}") from error
        self.data: Any = mujoco.MjData(self.mujoco)
        self._settle(start)
        self._views = views(self.mujoco, self.data)
        self._wheels = WheelDrives(
            model.wheel_radius_m, rolling_torque(model, settings) / servo_gain(model, settings),
            servo_gain(model, settings),
            torque_limit(model, settings),
        )  # fmt: skip
        self._state = np.zeros(1, dtype=STATE)
        s = self._state[0]
        s["x"], s["y"], s["psi"] = start
        s["clearance"], s["since"] = -NOWHERE, 0.0  # look at once
        s["least"] = s["least_moving"] = NOWHERE
        longest = max((scanner.sweep for scanner in self._scanners), default=0)
        size = longest + 2 + _CHUNK  # steps: a sweep ends within the two after it
        self._trail = PhysicsHistory(np.empty((size, 3)), np.empty((size, len(which), 2)))
        self._trail.poses[:] = start
        self._trail.places[:] = self._discs[which, :2]
        self._eye: Eye | None = None
        self._frames, self._next_frame, self._frame_rate = 0, 0, 0.0
        if model.camera is not None and camera != "none":
            size, self._frame_rate = (model.camera.width, model.camera.height), model.camera.rate_hz
            self._eye = Eye(self.mujoco, *size, camera, not isinstance(self._clock, SteppedClock))
        self._happen()

    def close(self) -> None:
        """Ends it; no calls afterwards."""
        if self._eye is not None and not self._closed:
            self._eye.close()
        super().close()

    def truth(self) -> TwinTruth:
        """How it really is."""
        self._catch_up()
        s = self._state[0]
        pose = Pose(float(s["x"]), float(s["y"]), float(s["psi"]))
        clearance = outline_clearance(
            pose, self._outline, self._reach, self._discs, self._walls, NOWHERE
        )
        return TwinTruth(
            int(s["step"]) * self._step, pose, Twist(float(s["v"]), float(s["omega"])),
            float(s["side"]), clearance, float(s["least"]), float(s["least_moving"]),
            int(s["touched"]), bool(s["touching"]), bool(s["standing"]),
            float(s["force"]), float(s["energy"]),
        )  # fmt: skip

    def discs(self) -> Floats:
        """All discs as they are now, (n, 6)."""
        self._catch_up()
        return self._discs.copy()

    def picture(
        self, width: int, height: int, view: str = "above", kind: Kind = "auto"
    ) -> NDArray[np.uint8]:
        """Robot and world from outside, `above` or `behind`, (height, width, 3) RGB."""
        self._catch_up()
        artist = camera(self.mujoco, width, height, kind, view, OUTSIDE)
        try:
            mujoco.mj_kinematics(self.mujoco, self.data)
            mujoco.mj_camlight(self.mujoco, self.data)
            return artist.draw(self.data)
        finally:
            artist.close()

    def draw_at(self, rate: float) -> None:
        """As in `DrawnCamera`; at most at the camera's own rate, with which it begins."""
        self._catch_up()
        camera = self._model.camera
        self._frame_rate = 0.0 if camera is None else min(rate, camera.rate_hz)
        if self._eye is not None and self._frame_rate == 0.0:
            self._eye.forget()
        self._next_frame = self._frame_due(int(self._state[0]["step"]))

    def push(self, x: float, y: float, psi: float) -> None:
        """Displaces the robot by so much [m, m, rad], in the world frame, as if carried; wheels and
        gyro notice nothing."""
        self._catch_up()
        s, q = self._state[0], self.data.qpos
        s["x"], s["y"], s["psi"] = s["x"] + x, s["y"] + y, s["psi"] + psi
        q[0], q[1] = s["x"], s["y"]
        c, h = math.cos(psi), math.sin(psi)
        v = self.data.qvel
        v[0], v[1] = c * v[0] - h * v[1], h * v[0] + c * v[1]
        _turn(q, float(s["psi"]))
        s["clearance"], s["since"] = -NOWHERE, 0.0

    def _settle(self, start: Pose) -> None:
        """Put the robot down, far from everything in time, and let it sink onto its wheels."""
        d = self.data
        d.qpos[0], d.qpos[1] = start.x, start.y
        _turn(d.qpos, start.psi)
        mujoco.mj_step(self.mujoco, d, _SETTLING)
        d.qpos[0], d.qpos[1] = start.x, start.y
        _turn(d.qpos, start.psi)
        d.qpos[7:9] = 0.0
        d.qvel[:] = 0.0
        d.time = 0.0
        mujoco.mj_forward(self.mujoco, d)

    def _catch_up(self) -> int:
        """Move the world on to now; the step that it is at then."""
        self._open()
        due = math.floor(self._clock.due() / self._step + 1e-6)
        step = int(self._state[0]["step"])
        while step < due:
            last = min(due, self._next_odometry, step + _CHUNK)
            last = min([last, *(scanner.next for scanner in self._scanners)])
            if self._eye is not None:
                last = min(last, self._next_frame)
            orders = np.array([(at, *twist) for at, twist in self._coming], dtype=np.float64)
            advance(
                last, self._commanded_at + self._timeout, self._step, self._views, self._state,
                orders.reshape(-1, 3), self._limits, self._wheels, self._outline, self._reach,
                self._discs, self._walls, self._movers, self._trail,
            )  # fmt: skip
            step = last
            while self._coming and self._coming[0][0] < step:
                self._coming.popleft()
            self._happen()
        return step

    def _happen(self) -> None:
        """What the sensors do at this step."""
        step, s = int(self._state[0]["step"]), self._state[0]
        if step >= self._next_odometry:
            rate = self._model.odometry.rate_hz
            dt = step * self._step - self._odometry.stamp
            self._odometry = self._odometer.reading(
                step * self._step, dt, float(s["left"]), float(s["right"]), float(s["yaw"])
            )
            s["left"] = s["right"] = s["yaw"] = 0.0
            self._next_odometry = next_reading_tick(step, rate, self._step)
        for scanner in self._scanners:
            if step >= scanner.next:
                self._scan(step, scanner)
        if self._eye is not None and step >= self._next_frame:
            self._eye.offer(self._shot())
            self._frames += 1
            self._next_frame = self._frame_due(step)

    def _scan(self, step: int, scanner: SimulatedLidar) -> None:
        """The scan whose last beam is measured at this step."""
        ranges = np.empty(len(scanner.lidar.beams))
        began = step - scanner.sweep
        sweep(
            began, scanner.sweep, self._trail, scanner.lidar, self._discs.copy(), self._movers,
            self._seen_walls, self._grid, ranges,
        )  # fmt: skip
        measure(scanner.lidar, scanner.seed, scanner.number, ranges)
        readable = step + self._steps(scanner.model.latency_s)
        scanner.measured(ranges, began, readable, self._step)

    def _frame(self) -> Frame | None:
        """The newest picture, of a camera that is used."""
        return self._eye.newest() if self._eye is not None and self._frame_rate > 0.0 else None

    def _frame_due(self, step: int) -> int:
        """The step of the next picture after this one."""
        rate = self._frame_rate
        return next_reading_tick(step, rate, self._step) if rate > 0.0 else sys.maxsize

    def _shot(self) -> Shot:
        return Shot(
            int(self._state[0]["step"]) * self._step, self._frames, self.data.qpos.copy(),
            self.data.mocap_pos.copy(),
        )  # fmt: skip

    def _health(self) -> Health:
        """Whether physics is still sound, and it upright."""
        s = self._state[0]
        stamp = int(s["step"]) * self._step
        if not math.isfinite(s["x"] + s["y"] + s["psi"]):
            return Health(stamp, math.nan, ("physics came to a pose that is not finite",))
        if s["tilt"] > _TIPPED:
            return Health(stamp, math.nan, ("the robot has tipped over: set it upright",))
        return Health(stamp, math.nan, ())


def _turn(qpos: Any, psi: float) -> None:
    """Set the heading of a free joint, upright."""
    qpos[3:7] = math.cos(0.5 * psi), 0.0, 0.0, math.sin(0.5 * psi)
