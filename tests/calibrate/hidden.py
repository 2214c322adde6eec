"""Robots whose numbers are hidden: a twin of one model that says it is another."""

import math

import numpy as np

from cohelm.calibrate.excitation import excitation
from cohelm.calibrate.ride import PERIOD, ride
from cohelm.core.scalars import wrap
from cohelm.core.types import Pose, Twist
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.port import Odometry
from cohelm.scenario.load import load_robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.world import Body, world

WALLS = np.array([
    [-3.2, -2.9, 5.1, -2.9], [5.1, -2.9, 5.1, 3.3], [5.1, 3.3, -3.2, 3.3], [-3.2, 3.3, -3.2, -2.9],
    [1.0, 3.3, 1.0, 2.5], [1.0, 2.5, 2.2, 2.5], [-3.2, 0.5, -2.6, 1.0],
])  # fmt: skip


class Hidden:
    """A simulated robot whose base believes in another wheel radius and track than it has."""

    gyro = False
    """Whether a gyro tells the heading, and not the wheels."""

    def __init__(self, model, true, seed, kind, scale=1.0, lag=0.02):
        around = world(([Body((-2.0, -2.0, 0.0, 0.0, 0.25, 0.2))], WALLS))
        if kind == "twin":
            self.inside = Twin(true, Pose(0, 0, 0), around, seed=seed, camera="none",
                               settings=TwinModel(wheel_lag_s=lag))  # fmt: skip
        else:
            self.inside = Kinematic(true, Pose(0, 0, 0), around, seed=seed)
        self.model, self.scale = model, scale
        self.turns = scale * model.track_m / true.track_m
        self._pose, self._last = Pose(0.0, 0.0, 0.0), None

    def __getattr__(self, name):
        return getattr(self.inside, name)

    def turning(self):
        """How many times as long the wheels lag in a turn as in a straight: by what they move."""
        if not isinstance(self.inside, Twin):
            return 1.0
        bodies, name = self.inside.mujoco, self.inside.mujoco.body
        robot, wheels = name("robot").id, [name("left").id, name("right").id]
        half, radius = 0.5 * self.inside.model.track_m, self.inside.model.wheel_radius_m
        rim = bodies.body_inertia[wheels[0]].max() / radius**2  # a wheel that spins
        mass = bodies.body_mass[[robot, *wheels]].sum()
        yaw = bodies.body_inertia[robot, 2] + half**2 * bodies.body_mass[wheels].sum()
        return (0.5 * yaw / half**2 + rim) / (0.5 * mass + rim)

    def send(self, twist):
        done = self.inside.send(Twist(self.scale * twist.v, self.turns * twist.omega))
        return Twist(done.v / self.scale, done.omega / self.turns)

    def read(self):
        readings = self.inside.read()
        o = readings.odometry
        told = 1.0 if self.gyro else self.turns
        if self._last is None:
            self._last = o
        if o.stamp > self._last.stamp:
            dt = o.stamp - self._last.stamp
            way, turn = o.twist.v * dt / self.scale, o.twist.omega * dt / told
            x, y, psi = self._pose
            self._pose = Pose(x + way * math.cos(psi + 0.5 * turn),
                              y + way * math.sin(psi + 0.5 * turn), wrap(psi + turn))  # fmt: skip
            self._last = o
        twist = Twist(o.twist.v / self.scale, o.twist.omega / told)
        return readings._replace(odometry=Odometry(o.stamp, self._pose, twist))


def drawn(seed, kind, name="sally"):
    """A model, and the robot that it is believed to be: delay, lag, limits, wheels, mount."""
    random = np.random.default_rng(seed)
    model = load_robot(name)
    pick = lambda low, high: float(random.uniform(low, high))  # noqa: E731
    scale, lag = pick(0.96, 1.04), pick(0.01, 0.06)
    limits = model.limits.model_copy(
        update={"wheel_acceleration_mps2": model.limits.wheel_acceleration_mps2 * pick(0.6, 1.4),
                "wheel_speed_mps": 3.0, "speed_mps": 2.0, "yaw_rate_radps": 5.0}
    )  # fmt: skip
    lidar = model.lidar.model_copy(
        update={"mount_x_m": model.lidar.mount_x_m + pick(-0.04, 0.04),
                "mount_y_m": pick(-0.04, 0.04), "mount_yaw_deg": pick(-3.0, 3.0)}
    )  # fmt: skip
    odometry = model.odometry.model_copy(update={"distance_error": 0.0})
    true = model.model_copy(
        update={"delay_s": 0.005 * round(pick(0.02, 0.2) / 0.005), "limits": limits,
                "track_m": model.track_m * pick(0.94, 1.06), "lidar": lidar, "odometry": odometry}
    )  # fmt: skip
    return model, true, scale, (lag if kind == "twin" else 0.0)


class Gyro(Hidden):
    """Its heading is a gyro's."""

    gyro = True


def made(seed, kind, of=Hidden):
    """A robot, and the model that it is believed to be, the true one, the odometry's scale and the
    lag of what answers later."""
    model, true, scale, lag = drawn(seed, kind)
    robot = of(model, true, seed, kind, scale, max(lag, 0.005))
    return robot, (model, true, scale, lag * max(robot.turning(), 1.0))


def ridden(seed, kind, of=Hidden, plan=lambda plan: plan):
    robot, truth = made(seed, kind, of)
    gated = LocalGatedRobot(robot, rules(robot.model, PERIOD))
    return ride(gated, plan(excitation(robot.model))), truth, gated
