"""Odometry from wheels and a gyro: the truth, with the errors of `OdometryModel`."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.types import Pose, Twist
from cohelm.robot.port import Odometry
from cohelm.robot.sensors import OdometryModel


class Odometer:
    """Adds up readings into a pose that drifts, in a frame that starts at (0, 0, 0).

    Distance comes from the wheels: each has a scale error that stays, and slips at random with
    the way it goes. Heading comes from the gyro: an error that stays, and noise. The same seed
    makes the same errors.
    """

    def __init__(self, model: OdometryModel, seed: int) -> None:
        self._model = model
        self._random = np.random.default_rng((seed, 0x0D0))
        scale = 1.0 + model.distance_error * self._random.standard_normal(2)
        self._left, self._right = float(scale[0]), float(scale[1])
        self._drift = math.radians(model.gyro_drift_degps) * float(self._random.standard_normal())
        self._pose = Pose(0.0, 0.0, 0.0)

    def start(self, stamp: float) -> Odometry:
        """The reading of a robot that has not moved yet."""
        return Odometry(stamp, self._pose, Twist(0.0, 0.0))

    def reading(self, stamp: float, dt: float, left: float, right: float, yaw: float) -> Odometry:
        """The next one, after `dt` [s] in which the rims went `left` and `right` [m] and the
        body turned by `yaw` [rad], truly."""
        model = self._model
        noise = self._random.standard_normal(3)
        distance_left = left * self._left + model.slip * math.sqrt(abs(left)) * float(noise[0])
        distance_right = right * self._right + model.slip * math.sqrt(abs(right)) * float(noise[1])
        rate = yaw / dt + self._drift + math.radians(model.gyro_noise_degps) * float(noise[2])
        way, turned = 0.5 * (distance_left + distance_right), rate * dt
        half = 0.5 * turned
        chord = way * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        x, y, psi = self._pose
        self._pose = Pose(
            x + chord * math.cos(psi + half), y + chord * math.sin(psi + half), psi + turned
        )
        return Odometry(stamp, self._pose, Twist(way / dt, rate))


def reading_tick(rate: float, number: int, step: float) -> int:
    """The tick of reading `number` of a sensor of this rate [Hz], number 0 at tick 0. step: of the
    simulated time [s]."""
    return math.ceil(number / (rate * step) - 1e-6)


def next_reading_tick(tick: int, rate: float, step: float) -> int:
    """The tick of the first reading after this one."""
    number = math.floor(tick * step * rate + 1e-6) + 1
    return max(reading_tick(rate, number, step), tick + 1)
