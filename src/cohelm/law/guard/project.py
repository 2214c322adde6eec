"""Least change of a command that respects any number of linear bounds: exact, in two variables."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_no_refcount
from cohelm.core.types import Floats, Twist

NO_OBSTACLE = -1
"""Owner of a bound that no obstacle sets: the wheels' own limits."""

_SLACK = 1e-12  # relative violation up to which a bound counts as kept
_CONTRADICTION = 1e-9  # tolerance of two bounds that exclude each other


class Projection(NamedTuple):
    """The nearest allowed twist; not feasible where the bounds contradict each other, and the
    twist is meaningless then. owner: the obstacle whose bound is active, or that is part of the
    contradiction; NO_OBSTACLE if it is the wheels alone."""

    twist: Twist
    feasible: bool
    owner: int


@jit_no_refcount
def project(nominal: Twist, rows: Floats, n: int, steer_weight: float) -> Projection:
    """Minimise (v - v_w)^2 + w^2 (omega - omega_w)^2 subject to a_v v + a_omega omega >= b.

    rows: (>= n, 4), the first n are used, and reordered: a_v, a_omega, b, owner. steer_weight:
    w > 0 [m]; large keeps the steering of the nominal command and reduces speed, small the
    reverse. An allowed nominal command is returned bit for bit.

    Seidel's incremental scheme, the most violated bound next: the solution for that bound and all
    before it is the projection of the nominal command onto its line, clipped to the interval that
    those before leave. A handful of passes over the rows in practice.
    """
    v, omega = nominal.v, nominal.omega
    x0, y0 = nominal.v, nominal.omega * steer_weight  # the metric is Euclidean in (v, w omega)
    for m in range(n):
        worst = _most_violated(rows, m, n, v, omega)
        if worst < 0:
            return Projection(Twist(v, omega), True, _active_owner(rows, m, v, omega))
        for column in range(4):
            rows[m, column], rows[worst, column] = rows[worst, column], rows[m, column]
        ax, ay, b = rows[m, 0], rows[m, 1] / steer_weight, rows[m, 2]
        size = math.sqrt(ax * ax + ay * ay)
        if size < 1e-9:
            return Projection(Twist(v, omega), False, _last_owner(rows, m))
        ax, ay, b = ax / size, ay / size, b / size
        # Along the line from its point nearest to rest, so that a huge one costs no digits.
        low, high = _interval(rows, m, ax, ay, b, steer_weight)
        if low > high + _CONTRADICTION:
            return Projection(Twist(v, omega), False, _last_owner(rows, m))
        s = min(max(ax * y0 - ay * x0, low), high)
        v, omega = b * ax - s * ay, (b * ay + s * ax) / steer_weight
    return Projection(Twist(v, omega), True, _active_owner(rows, n, v, omega))


@jit_no_refcount
def _most_violated(rows: Floats, first: int, n: int, v: float, omega: float) -> int:
    """The row from `first` on that (v, omega) violates most, -1 if it satisfies all."""
    worst, largest = -1, 0.0
    for i in range(first, n):
        b = rows[i, 2]
        violation = b - rows[i, 0] * v - rows[i, 1] * omega
        if violation > largest and violation > _SLACK * (1.0 + abs(b)):
            worst, largest = i, violation
    return worst


@jit_no_refcount
def _active_owner(rows: Floats, m: int, v: float, omega: float) -> int:
    """The obstacle among the first m rows whose bound is active."""
    for j in range(m - 1, -1, -1):
        b = rows[j, 2]
        slack = rows[j, 0] * v + rows[j, 1] * omega - b
        if rows[j, 3] != NO_OBSTACLE and slack <= _CONTRADICTION * (1.0 + abs(b)):
            return int(rows[j, 3])
    return NO_OBSTACLE


@jit_no_refcount
def _last_owner(rows: Floats, m: int) -> int:
    """The last obstacle among the rows up to the m-th."""
    for j in range(m, -1, -1):
        if rows[j, 3] != NO_OBSTACLE:
            return int(rows[j, 3])
    return NO_OBSTACLE


@jit_no_refcount
def _interval(
    rows: Floats, m: int, ax: float, ay: float, b: float, steer_weight: float
) -> tuple[float, float]:
    """What the first m rows leave of the line a . (x, y) = b, |a| = 1, along (-ay, ax)."""
    low, high = -math.inf, math.inf
    for j in range(m):
        cx, cy = rows[j, 0], rows[j, 1] / steer_weight
        slope = cy * ax - cx * ay
        violation = rows[j, 2] - b * (cx * ax + cy * ay)
        if abs(slope) <= 1e-12 * (abs(cx) + abs(cy)):  # parallel
            if violation > _CONTRADICTION * (1.0 + abs(rows[j, 2])):
                return math.inf, -math.inf
        elif slope > 0.0:
            low = max(low, violation / slope)
        else:
            high = min(high, violation / slope)
    return low, high
