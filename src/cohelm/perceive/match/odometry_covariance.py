"""Covariance of a pose that odometry carries on, and what the wheels are learnt to measure wrongly.

A Kalman filter's state of five: x, y, psi, and of the odometry the scale of its ways and the bend
of its straight lines, which unequal wheels or a gyro's bias make.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.types import Floats, Pose

SCALE = 0.02  # the wheels may measure this share too much or too little, one sigma
BEND = 0.003  # and a straight line be bent by this, as by wheels 0.1 % unequal [rad/m]
_WANDER = np.array([2e-5, 1e-5])  # by which those change from scan to scan
_MOST = np.array([0.1, 0.1])  # that is believed of an odometry that is not broken


class Wheels(NamedTuple):
    """What ways are to be lengthened by, as a share, and turned by [rad/m]."""

    scale: float = 0.0
    bend: float = 0.0

    def corrected(self, step: Pose) -> Pose:
        """An odometry step as it was, by what has been learnt."""
        longer = 1.0 + self.scale
        return Pose(longer * step.x, longer * step.y, step.psi + self.bend * step.x)

    def learnt(self, joint: Floats, off: Floats) -> Wheels:
        """From how far (x, y, psi) a match has moved a foretold pose of that covariance."""
        gain = joint[3:, :3] @ np.linalg.solve(joint[:3, :3], off)
        scale, bend = np.clip(np.array(self) + gain, -_MOST, _MOST).tolist()
        return Wheels(scale, bend)


UNKNOWN = np.diag([SCALE, BEND]) ** 2
"""(2, 2) covariance of wheels of which nothing has been learnt."""


def moved(pose: Pose, joint: Floats, step: Pose, mount: float = 0.0) -> tuple[Pose, Floats]:
    """A pose after an odometry step in its own frame, and the (5, 5) covariance.

    mount: the LiDAR's place on the robot is unsure by so much, and swings round in a turn [m].
    """
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    jacobian = np.eye(5)
    jacobian[0, 2], jacobian[1, 2] = -s * step.x - c * step.y, c * step.x - s * step.y
    jacobian[0, 3], jacobian[1, 3] = c * step.x - s * step.y, s * step.x + c * step.y
    # the bend turns the way's end by half of what it turns the heading
    jacobian[0, 4], jacobian[1, 4] = -0.5 * s * step.x**2, 0.5 * c * step.x**2
    jacobian[2, 4] = step.x
    way, swing = math.hypot(step.x, step.y), mount * step.psi
    own = np.diag([
        (0.002 + 0.01 * way) ** 2 + swing**2, (0.002 + 0.02 * way) ** 2 + swing**2,
        (0.001 + 0.01 * way + 0.03 * abs(step.psi)) ** 2, *_WANDER**2,
    ])  # fmt: skip
    turn = np.eye(5)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = c, -s, s, c
    return compose(pose, step), jacobian @ joint @ jacobian.T + turn @ own @ turn.T


def joined(covariance: Floats, wheels: Floats) -> Floats:
    """Covariance (3, 3) of a pose and (2, 2) of the wheels, independent of each other: (5, 5)."""
    joint = np.zeros((5, 5))
    joint[:3, :3], joint[3:, 3:] = covariance, wheels
    return joint


_FLOOR = np.diag([0.002, 0.002, 0.0005, 0.0, 0.0]) ** 2  # the map is no better than this


def updated(joint: Floats, information: Floats) -> Floats:
    """The covariance after a match; the wheels are learnt through what they did to the pose."""
    gained = np.zeros((5, 5))
    gained[:3, :3] = information
    return inverted(inverted(joint) + gained) + _FLOOR


def inverted(matrix: Floats) -> Floats:
    """The inverse; information of a covariance, and the other way round."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
