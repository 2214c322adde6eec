"""Plain values that the law, the robot and the simulator exchange.

World frame: x and y in metres, heading counter-clockwise from x (REP-103; erratum E1: the
paper says north-east-down, but its signs only steer right of an obstacle in this frame).
Body frame: x forward, y left. All angles in radians, all times in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Progress = Callable[[str, float], None]
"""Progress callback: what is being done, and the share that is done [0, 1]."""

X, Y, VX, VY, RADIUS, SAFE = range(6)
"""Columns of a disc array, shape (n, 6): centre [m], velocity [m/s] in the world frame,
radius of the body itself [m], and the paper's r_i, the safe distance between the robot's
centre and the disc's centre [m] (19)."""


class Pose(NamedTuple):
    """eta = (x, y, psi) in the world frame (3) [m, m, rad].

        >>> import cohelm
        >>> cohelm.Pose(x=1.0, y=0.0, psi=0.5).psi
        0.5

    A tuple: `x, y, psi = pose`.
    """

    x: float
    """[m]"""
    y: float
    """[m]"""
    psi: float
    """Heading, counter-clockwise from x [rad]."""


class Twist(NamedTuple):
    """Surge speed u and yaw rate r of (4), the two control inputs [m/s, rad/s].

        >>> import cohelm
        >>> cohelm.Twist(v=0.5, omega=-0.2).v  # forward, and to the right
        0.5

    A tuple: `v, omega = twist`.
    """

    v: float
    """Forward [m/s]."""
    omega: float
    """Yaw rate, counter-clockwise: positive turns left [rad/s]."""


class Stick(NamedTuple):
    """Deflections of the spring-centred stick, scaled to [-1, 1].

    `x` is fore-aft (forward positive), `psi` left-right (left positive, as the yaw rate).
    """

    x: float
    psi: float


CENTRED = Stick(0.0, 0.0)


class StickRecording(NamedTuple):
    """A recorded or scripted stick. times (n,) [s], never decreasing; x fore-aft and psi left-right
    (n,), in [-1, 1].

    A deflection holds until the next event.
    """

    times: Floats
    x: Floats
    psi: Floats


class Desired(NamedTuple):
    """Desired pose, surge speed and yaw rate at one instant (7)(10) [m, m, rad, m/s, rad/s]."""

    x: float
    y: float
    psi: float
    u: float
    r: float


def disc(
    x: float, y: float, radius: float, safe: float = 0.2, vx: float = 0.0, vy: float = 0.0
) -> tuple[float, float, float, float, float, float]:
    """One row of a disc array; `safe` is the paper's r_i (Table II: 0.2 m)."""
    return (x, y, vx, vy, radius, safe)


def discs(*rows: tuple[float, float, float, float, float, float]) -> Floats:
    """A disc array, shape (n, 6), from rows made with `disc`; n may be 0."""
    return np.array(rows, dtype=np.float64).reshape(-1, 6)
