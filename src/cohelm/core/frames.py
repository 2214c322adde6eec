"""SE(2) poses, compiled: compose, inverse, and points from one frame to another."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit_inline
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose


@jit_inline
def compose(a: Pose, b: Pose) -> Pose:
    """a * b: the pose b, given relative to a, in the frame of a; heading wrapped."""
    c, s = math.cos(a.psi), math.sin(a.psi)
    return Pose(a.x + c * b.x - s * b.y, a.y + s * b.x + c * b.y, wrap(a.psi + b.psi))


@jit_inline
def inverse(a: Pose) -> Pose:
    """a^-1: the frame of a, relative to a."""
    c, s = math.cos(a.psi), math.sin(a.psi)
    return Pose(-c * a.x - s * a.y, s * a.x - c * a.y, wrap(-a.psi))


@jit_inline
def between(a: Pose, b: Pose) -> Pose:
    """a^-1 * b, b relative to a: compose(a, between(a, b)) = b."""
    c, s = math.cos(a.psi), math.sin(a.psi)
    dx, dy = b.x - a.x, b.y - a.y
    return Pose(c * dx + s * dy, -s * dx + c * dy, wrap(b.psi - a.psi))


@jit_inline
def eye(body: Pose, mount: Pose) -> tuple[float, float, float, float]:
    """Where a sensor at this mount is by the pose of its body; cosine and sine of its heading."""
    c, s = math.cos(body.psi), math.sin(body.psi)
    x = body.x + c * mount.x - s * mount.y
    y = body.y + s * mount.x + c * mount.y
    return x, y, math.cos(body.psi + mount.psi), math.sin(body.psi + mount.psi)


def turned(points: Floats, psi: float) -> Floats:
    """Points or directions (p, 2), rotated by an angle [rad]."""
    c, s = math.cos(psi), math.sin(psi)
    return points @ np.array([[c, s], [-s, c]])


def placed(points: Floats, pose: Pose) -> Floats:
    """Points (p, 2) of the frame at this pose, in the frame of the pose."""
    return turned(points, pose.psi) + pose[:2]
