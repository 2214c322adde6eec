"""Checks odometry against itself and against the commands sent to the wheels."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Twist
from cohelm.robot.model import RobotModel
from cohelm.robot.plausibility.finding import Finding, fault, hold
from cohelm.robot.plausibility.trail import Trail

# Largest differences within odometry, and between it and the commands.

_STEP = 0.03
"""Pose and twist over one reading [m, rad]: a filter's small correction."""
_DRIFT, _WINDOWS = 0.05, (0.5, 2.0)
"""Pose and twist [m, rad] over each of these times, for fast and for slow errors [s]; a filtered
twist lags by some 0.1 s."""
_SHARE = 0.25
"""... plus this share of the way: a twist is an average, or an instant."""
_LAG = 0.3
"""Lag of the drives behind a command beyond the robot's `delay_s` [s]: on a slope, with a load, by
a controller of their own."""
_SPEED, _YAW_RATE = 0.12, 0.25
"""Measured and commanded speed [m/s, rad/s]; a wheel that spins or is held back shows more."""
_RATIO = 0.15  # ... plus this share of the command
_PATIENCE = 0.15  # time they have to differ before it counts [s]


def consistent(trail: Trail) -> Finding | None:
    """Pose against twist: the way between two poses is the integral of the speeds between them."""
    rows = trail.rows
    if len(rows) < 2:
        return None
    last, before = rows[-1], rows[-2]
    step, limits = _travel(before, last)
    owed = (0.0, 0.0)
    if len(rows) > 2:  # stamped late, its way was short, and the next one's is longer by as much
        was, least = _travel(rows[-3], before, min)
        owed = (max(least[0] - was[0], 0.0), max(least[1] - was[1], 0.0))
    for went, most, more, unit in zip(step, limits, owed, ("m", "rad"), strict=True):
        if went > (1.0 + _SHARE) * most + _STEP + more:
            return fault(f"the odometry jumped by {went:.2f} {unit} against its speed")
    for window in _WINDOWS:
        gone, turned, *sums = added_up(rows, trail.newest - window)
        for what, went, (one, other) in (("speed", gone, sums[:2]), ("yaw rate", turned, sums[2:])):
            low, high = min(one, other), max(one, other)
            room = _DRIFT + _SHARE * max(abs(low), abs(high), abs(went))
            if not low - room <= went <= high + room:
                text = f"{went:.2f} against {0.5 * (low + high):.2f} in {window} s"
                return fault(f"the odometry's pose and {what} disagree: {text}")
    return None


def _travel(
    before: Floats, after: Floats, which: Callable[[float, float], float] = max
) -> tuple[tuple[float, float], tuple[float, float]]:
    """From one row to the next: the way and the turn between the poses, and those at the larger (or
    smaller) of both speeds [m, rad]."""
    dt = float(after[0] - before[0])
    went = math.hypot(after[1] - before[1], after[2] - before[2]), abs(float(after[3] - before[3]))
    speed, rate = (which(abs(float(before[i])), abs(float(after[i]))) for i in (4, 5))
    return went, (speed * dt, rate * dt)


@jit
def added_up(rows: Floats, since: float) -> tuple[float, float, float, float, float, float]:
    """Of the newest rows: the way along the headings and the turn [m, rad]; and the integrals of
    speed and yaw rate, each taken as the mean since the last row, and as of the instant."""
    gone = turned = way = way_before = turn = turn_before = 0.0
    for i in range(len(rows) - 1, 0, -1):
        if rows[i - 1, 0] < since:
            break
        a, b = rows[i - 1], rows[i]
        dt = b[0] - a[0]
        middle = 0.5 * (b[3] + a[3])
        gone += math.cos(middle) * (b[1] - a[1]) + math.sin(middle) * (b[2] - a[2])
        turned = rows[-1, 3] - a[3]
        way += b[4] * dt
        way_before += a[4] * dt
        turn += b[5] * dt
        turn_before += a[5] * dt
    return gone, turned, way, way_before, turn, turn_before


class Following:
    """Whether the wheels follow the commands: measured twist against the range of the commands over
    the time in which a command may take effect."""

    def __init__(self, model: RobotModel) -> None:
        self._late = model.delay_s + _LAG
        self._apart = math.nan

    def watch(
        self, now: float, twist: Twist, commands: Trail, stopped: bool = False
    ) -> Finding | None:
        """A finding when they have differed for long enough. stopped: the robot was sent a stop,
        and brakes as hard as it can: any speed between standing and the commands is allowed."""
        sent = commanded(commands.rows, now - self._late)
        if stopped:
            sent = sent._replace(
                low_v=min(sent.low_v, 0.0), high_v=max(sent.high_v, 0.0),
                low_omega=min(sent.low_omega, 0.0), high_omega=max(sent.high_omega, 0.0),
            )  # fmt: skip
        if not sent.rows or now - commands.rows[0, 0] < self._late:
            self._apart = math.nan
            return None
        reason = self._wrong(twist, sent)
        if not reason:
            self._apart = math.nan
            return None
        if math.isnan(self._apart):
            self._apart = now
        if now - self._apart < _PATIENCE:
            return None
        return fault(reason) if sent.least > 0.02 else hold(reason)

    def _wrong(self, twist: Twist, sent: Commanded) -> str:
        if outside(twist.v, sent.low_v, sent.high_v, _SPEED, _RATIO):
            return f"the odometry reports {twist.v:.2f} m/s where {sent.v:.2f} m/s is commanded"
        if outside(twist.omega, sent.low_omega, sent.high_omega, _YAW_RATE, _RATIO):
            is_ = f"{sent.omega:.2f} rad/s"
            return f"the odometry reports {twist.omega:.2f} rad/s where {is_} is commanded"
        return ""


class Commanded(NamedTuple):
    """The range and mean of the commands over some time."""

    rows: int
    """Number of commands."""
    low_v: float
    high_v: float
    v: float
    """The mean [m/s]."""
    low_omega: float
    high_omega: float
    omega: float
    """The mean [rad/s]."""
    least: float
    """Least over the rows of the larger of |v| and |omega|."""


@jit
def commanded(rows: Floats, since: float) -> Commanded:
    """Of rows of time, v and omega, those not older than `since`."""
    n = 0
    low_v, high_v, v = math.inf, -math.inf, 0.0
    low_omega, high_omega, omega = math.inf, -math.inf, 0.0
    least = math.inf
    for i in range(len(rows) - 1, -1, -1):
        if rows[i, 0] < since:
            break
        n += 1
        v += rows[i, 1]
        omega += rows[i, 2]
        low_v, high_v = min(low_v, rows[i, 1]), max(high_v, rows[i, 1])
        low_omega, high_omega = min(low_omega, rows[i, 2]), max(high_omega, rows[i, 2])
        least = min(least, max(abs(rows[i, 1]), abs(rows[i, 2])))
    some = max(n, 1)
    return Commanded(n, low_v, high_v, v / some, low_omega, high_omega, omega / some, least)


def outside(measured: float, low: float, high: float, room: float, ratio: float) -> bool:
    """Whether a measurement is beyond the range of the commands, with tolerance."""
    slack = room + ratio * max(abs(low), abs(high))
    return not low - slack <= measured <= high + slack
