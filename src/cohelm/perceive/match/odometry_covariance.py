"""Covariance of a pose that odometry carries on: x, y, psi and the odometry's scale."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.frames import compose
from cohelm.core.types import Floats, Pose

SCALE = 0.02  # the wheels may measure this share too much or too little, one sigma
_WANDER = 2e-5  # by which that changes from scan to scan


def moved(pose: Pose, joint: Floats, step: Pose) -> tuple[Pose, Floats]:
    """A pose after an odometry step in its own frame, and the covariance of x, y, psi, scale."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    jacobian = np.eye(4)
    jacobian[0, 2], jacobian[1, 2] = -s * step.x - c * step.y, c * step.x - s * step.y
    jacobian[0, 3], jacobian[1, 3] = c * step.x - s * step.y, s * step.x + c * step.y
    way = math.hypot(step.x, step.y)
    own = np.diag([
        (0.002 + 0.01 * way) ** 2, (0.002 + 0.02 * way) ** 2,
        (0.001 + 0.01 * way + 0.03 * abs(step.psi)) ** 2, _WANDER**2,
    ])  # fmt: skip
    turn = np.eye(4)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = c, -s, s, c
    return compose(pose, step), jacobian @ joint @ jacobian.T + turn @ own @ turn.T


def joined(covariance: Floats, scale: float) -> Floats:
    """Covariance of a pose and of the odometry's scale, independent of each other."""
    joint = np.zeros((4, 4))
    joint[:3, :3], joint[3, 3] = covariance, scale
    return joint


_FLOOR = np.diag([0.002, 0.002, 0.0005, 0.0]) ** 2  # the map is no better than this


def updated(joint: Floats, information: Floats) -> Floats:
    """The covariance after a match; the scale is learnt through what it did to the pose."""
    gained = np.zeros((4, 4))
    gained[:3, :3] = information
    return inverted(inverted(joint) + gained) + _FLOOR


def inverted(matrix: Floats) -> Floats:
    """The inverse; information of a covariance, and the other way round."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
