"""Covariance of a pose predicted by odometry, and estimation of the odometry's systematic errors.

Kalman filter state: x, y, psi, and of the odometry the scale of distances and the curvature of
straight lines (bend), from unequal wheels or a gyro bias.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.types import Floats, Pose

SCALE = 0.02  # prior standard deviation of the scale error
BEND = 0.003  # and of the bend, as of wheels 0.1 % unequal [rad/m]
_DRIFT = np.array([2e-5, 1e-5])  # process noise of these per scan
_LIMIT = np.array([0.1, 0.1])  # largest errors of an odometry that is not broken


class OdometryErrors(NamedTuple):
    """Estimated scale error of distances, as a share, and bend [rad/m]."""

    scale: float = 0.0
    bend: float = 0.0

    def corrected(self, step: Pose) -> Pose:
        """An odometry step corrected by the estimated errors."""
        longer = 1.0 + self.scale
        return Pose(longer * step.x, longer * step.y, step.psi + self.bend * step.x)

    def updated_by(self, joint: Floats, off: Floats) -> OdometryErrors:
        """After the innovation (x, y, psi) of a match, for a predicted pose of that covariance."""
        gain = joint[3:, :3] @ np.linalg.solve(joint[:3, :3], off)
        scale, bend = np.clip(np.array(self) + gain, -_LIMIT, _LIMIT).tolist()
        return OdometryErrors(scale, bend)


UNKNOWN = np.diag([SCALE, BEND]) ** 2
"""(2, 2) prior covariance of the errors."""


def predict(pose: Pose, joint: Floats, step: Pose, mount: float = 0.0) -> tuple[Pose, Floats]:
    """A pose after an odometry step in its own frame, and the (5, 5) covariance.

    mount: uncertainty of the LiDAR's position on the robot, which swings round in a turn [m].
    """
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    jacobian = np.eye(5)
    jacobian[0, 2], jacobian[1, 2] = -s * step.x - c * step.y, c * step.x - s * step.y
    jacobian[0, 3], jacobian[1, 3] = c * step.x - s * step.y, s * step.x + c * step.y
    # the bend turns the end point by half of what it turns the heading
    jacobian[0, 4], jacobian[1, 4] = -0.5 * s * step.x**2, 0.5 * c * step.x**2
    jacobian[2, 4] = step.x
    distance, swing = math.hypot(step.x, step.y), mount * step.psi
    noise = np.diag([
        (0.002 + 0.01 * distance) ** 2 + swing**2, (0.002 + 0.02 * distance) ** 2 + swing**2,
        (0.001 + 0.01 * distance + 0.03 * abs(step.psi)) ** 2, *_DRIFT**2,
    ])  # fmt: skip
    turn = np.eye(5)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = c, -s, s, c
    return compose(pose, step), jacobian @ joint @ jacobian.T + turn @ noise @ turn.T


def joined(covariance: Floats, errors: Floats) -> Floats:
    """Covariance (3, 3) of a pose and (2, 2) of the errors, independent of each other: (5, 5)."""
    joint = np.zeros((5, 5))
    joint[:3, :3], joint[3:, 3:] = covariance, errors
    return joint


_FLOOR = np.diag([0.002, 0.002, 0.0005, 0.0, 0.0]) ** 2  # lower bound, by the map


def updated(joint: Floats, information: Floats) -> Floats:
    """The covariance after a match; the errors are observed through their effect on the pose."""
    gained = np.zeros((5, 5))
    gained[:3, :3] = information
    return inverted(inverted(joint) + gained) + _FLOOR


def inverted(matrix: Floats) -> Floats:
    """The inverse; information of a covariance, and the other way round."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
