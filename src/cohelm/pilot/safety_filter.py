"""The safety filter for a caller in Python: delay, lag, margins and sent commands kept inside."""

from __future__ import annotations

import math
from types import NoneType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.errors import CohelmError
from cohelm.core.flat import numbers, read
from cohelm.core.jit import jit
from cohelm.core.obstacles import Obstacles, Surroundings
from cohelm.core.scalars import is_finite
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.law.guard.rules import Rules, checked_rules
from cohelm.law.guard.step import NOTHING, guard
from cohelm.law.verdict import Verdict
from cohelm.pilot.delay_compensation import periods, predict_obstacles
from cohelm.pilot.margin_inflation import SLOP, inflated_rules, noise
from cohelm.robot.achievable import achievable
from cohelm.robot.footprint import convex_outline
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, checked_braking, checked_limits, speeds
from cohelm.robot.model import RobotModel

_OFF_V, _OFF_OMEGA, _OFF_FOR = 0.2, 0.4, 0.16
"""Deviation of the measured twist from the command [m/s, rad/s], and its duration [s], after which
the measurement is used: more than odometry noise, longer than the step response of a drive."""
_LONGEST = 1.0  # period [s]
_RULES = Rules()


class _FilterSettings(NamedTuple):
    """What is constant between calls, beside the outline."""

    limits: Limits
    rules: Rules
    horizon: float
    """From a command to what it does [s]."""
    patience: float
    """So long the wheels may do something else before it is believed [s]."""
    fastest: Twist
    """A faster measured twist is not the robot's [m/s, rad/s]."""


class LimitingObstacle(NamedTuple):
    """What held the nominal command back."""

    kind: str
    """disc, segment or point."""
    row: int
    """Of that array of the obstacles: `obstacles.points[row]` and so on. `from_ranges` keeps beams
    that hit something only, so a row is no beam's number."""


class FilterResult(NamedTuple):
    """The command that the safety filter passes, and why.

    >>> import cohelm
    >>> safe = cohelm.SafetyFilter(cohelm.load_robot("sally"), period=0.02)
    >>> still, slow = cohelm.Twist(0, 0), cohelm.Twist(0.02, 0)
    >>> out = safe(cohelm.Pose(0, 0, 0), still, slow, cohelm.Obstacles())
    >>> (out.verdict.name, out.twist.v, out.limiting)
    ('UNTOUCHED', 0.02, None)
    """

    twist: Twist
    """To be sent now [m/s, rad/s]; always finite."""
    verdict: Verdict
    """What became of the nominal command."""
    limiting: LimitingObstacle | None
    """What held it back; None: nothing, or the wheels' own limits."""
    clearance: float
    """From the outline to the nearest obstacle when the command takes effect [m]; inf: none near
    enough to matter."""
    change: float
    """Distance from the nominal command, sqrt(dv^2 + (steer_weight domega)^2) [m/s]."""


class SafetyFilter:
    """The least change of any command after which the robot can still stop clear of everything.

        >>> import cohelm
        >>> safe = cohelm.SafetyFilter(cohelm.load_robot("sally"), period=0.02)
        >>> seen = cohelm.Obstacles(points=[[0.45, 0.0]])  # 9 cm before the bow
        >>> safe(cohelm.Pose(0, 0, 0), cohelm.Twist(0, 0), cohelm.Twist(1, 0), seen).verdict.name
        'SHAPED'

    Call it once per control period, and send `result.twist`. It remembers the commands that it
    passed, so one filter belongs to one robot; not to be called from two threads. What is promised,
    and under which assumptions: docs/guard.md."""

    def __init__(
        self, robot: RobotModel, period: float, *, delay: float | None = None, lag: float = 0.0,
        position_error: float | None = None, hard_margin: float = _RULES.hard_margin,
        soft_margin: float = _RULES.soft_margin,
        deceleration_fraction: float = _RULES.deceleration_fraction,
        steer_weight: float = _RULES.steer_weight, limits: Limits | None = None,
    ) -> None:  # fmt: skip
        """Checks everything, and compiles: seconds the first time ever, else tenths.

        robot: footprint, limits, delay, sensors. period: between two calls [s]. delay: from
        sending a command to its first effect [s]; by default the robot's. lag: time constant with
        which the drives follow [s]. position_error: error bound of the positions of
        obstacles and robot [m]; by default 8 mm and the standard deviation of the LiDAR's ranges;
        both margins grow by twice that. hard_margin: clearance that every certified stop keeps, of
        which half is the promise. soft_margin: clearance that commands are shaped to keep [m].
        deceleration_fraction: of the full deceleration, that shaping counts on. steer_weight:
        large keeps steering and slows down, small the reverse [m]. limits: instead of the robot's,
        say for a floor on which it brakes worse.

        Raises CohelmError for what nothing could be promised for.
        """
        if not isinstance(robot, RobotModel):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise CohelmError(
                f"the robot must be a cohelm.RobotModel, got {robot!r}: cohelm.load_robot makes one"
            )
        self.robot = robot
        self.limits = checked_braking(checked_limits(robot.bounds() if limits is None else limits))
        self.period = _within("period", period, 0.001, _LONGEST, "s")
        delay = _within("delay", robot.delay_s if delay is None else delay, 0.0, 2.0, "s")
        lag = _within("lag", lag, 0.0, 1.0, "s")
        error = SLOP + noise(robot) if position_error is None else position_error
        rules = checked_rules(
            Rules(self.period, soft_margin, hard_margin, deceleration_fraction, steer_weight)
        )
        if rules.soft_margin < rules.hard_margin:
            raise CohelmError(
                f"hard_margin must not exceed soft_margin, {soft_margin:g} m, got {hard_margin:g}"
            )
        self._rules = inflated_rules(rules, _within("position_error", error, 0.0, 1.0, "m"))
        self.horizon = delay + lag + 0.5 * self.period
        """How far ahead a command is worked out [s]: a drive follows on a straight line through a
        period, at whose beginning the certificate takes the speed to be reached, hence the half."""
        whole, _ = periods(self.horizon, self.period)
        patience = (max(round(_OFF_FOR / self.period), 1) - 0.5) * self.period
        self._outline = robot.outline
        speed, yaw_rate = speeds(self.limits)
        self._fastest = Twist(speed + _OFF_V, yaw_rate + _OFF_OMEGA)
        self._settings = numbers(
            _FilterSettings(self.limits, self._rules, self.horizon, patience, self._fastest)
        )
        self._sent = np.zeros((2 * whole + 3, 3))
        self._count, self._off = np.zeros(1, dtype=np.int64), np.zeros(1)
        nan = math.nan
        self(Pose(nan, nan, nan), Twist(nan, nan), Twist(nan, nan), Obstacles())  # compiles
        self.reset()

    def __call__(
        self, pose: Pose, twist: Twist, nominal: Twist, obstacles: Obstacles | Surroundings,
        after: float | None = None,
    ) -> FilterResult:  # fmt: skip
        """The command for now. pose: where the robot is now, in the obstacles' frame [m, m, rad].
        twist: measured now [m/s, rad/s]. nominal: what a person or controller wants. obstacles: as
        of now, `Obstacles()` where there are none. after: since the last call [s]; by default the
        period, and never more; twice as many calls as periods are counted with.

        Numbers that are not finite give a braking or standing twist and the verdict INVALID. Raises
        CohelmError only for what is no pose, twist or Obstacles at all.
        """
        try:
            x, y, psi = pose
            now_v, now_omega = twist
            want_v, want_omega = nominal
            lasted = self.period if after is None else float(after)
            v, omega, verdict, change, clearance, row = _filtered(
                float(x), float(y), float(psi), float(now_v), float(now_omega),
                float(want_v), float(want_omega), obstacles.discs, obstacles.max_acceleration,
                obstacles.velocity_error, obstacles.segments, obstacles.points, self._outline,
                self._settings, lasted, self._sent, self._count, self._off,
            )  # fmt: skip
        except (TypeError, ValueError, OverflowError, AttributeError) as error:
            raise CohelmError(_meant(pose, twist, nominal, obstacles, after)) from error
        limiting = None if row == NOTHING else _limiting(row, obstacles)
        return FilterResult(Twist(v, omega), _VERDICTS[verdict], limiting, clearance, change)

    def sent(self, twist: Twist) -> None:
        """Another twist than the last result's was sent: a gate or a brake had the last word."""
        try:
            v, omega = map(float, twist)
        except (TypeError, ValueError) as error:
            raise CohelmError(f"a twist is (v, omega), got {twist!r}") from error
        if not (math.isfinite(v) and math.isfinite(omega)):
            raise CohelmError("a twist that was sent must be finite: a robot can not do NaN")
        if abs(v) > self._fastest.v or abs(omega) > self._fastest.omega:
            raise CohelmError(
                f"a twist that was sent is in m/s and rad/s, got ({v:g}, {omega:g}), which is "
                "beyond the robot's limits"
            )
        self._sent[(self._count[0] - 1) % len(self._sent), :2] = v, omega

    def reshape(self, outline: ArrayLike) -> None:
        """Another outline of the robot counts from the next call on. Where something is nearer to
        it than the margin, or in it, the robot may only leave that: bring it to rest before.

        outline: corners [x, y] in the body frame, convex [m]. Raises CohelmError for what is none.
        """
        self._outline = convex_outline(outline)

    def reset(self) -> None:
        """Forget what was sent, as when driving begins: the measured twist is believed at first."""
        self._sent[:], self._count[:], self._off[:] = 0.0, 0, 0.0
        self._sent[:, 2] = self.period


@jit
def _filtered(
    x: float, y: float, psi: float, now_v: float, now_omega: float, v: float, omega: float,
    discs: Floats, max_acceleration: Floats, velocity_error: Floats, segments: Floats,
    points: Floats, outline: Floats, s: Floats, after: float, sent: Floats, count: Ints,
    away: Floats,
) -> tuple[float, float, int, float, float, int]:  # fmt: skip
    """One call. after: since the last one [s]. sent: (d, 3), the command in effect now and those
    under way, each with the time until the next; the newest in row (count - 1) % d. away: for how
    long the wheels have done something else [s]."""
    limits, rules, horizon, patience, fastest = read(_FilterSettings, s, 0)
    d, k = len(sent), count[0]
    known = is_finite(now_v) and is_finite(now_omega)
    known = known and abs(now_v) <= fastest.v and abs(now_omega) <= fastest.omega
    if not after >= 0.0:  # nor for NaN
        known, after = False, rules.dt
    dt = max(rules.dt, min(after, _LONGEST))
    horizon += 0.5 * (dt - rules.dt)
    rules = Rules(
        dt, rules.soft_margin, rules.hard_margin, rules.deceleration_fraction, rules.steer_weight
    )
    if k == 0 and known:
        for j in range(d):
            sent[j, 0], sent[j, 1] = now_v, now_omega
    elif k > 0:
        sent[(k - 1) % d, 2] = after
    ahead, under_way = 0.0, 0  # of those under way
    while under_way < d - 1:
        lasted = sent[(k - 1 - under_way) % d, 2]
        if ahead + lasted > horizon + 1e-6 * rules.dt:
            break
        ahead += lasted
        under_way += 1
    now = (k - 1 - under_way) % d
    before = Twist(sent[now, 0], sent[now, 1])
    off = abs(now_v - before.v) > _OFF_V or abs(now_omega - before.omega) > _OFF_OMEGA
    away[0] = away[0] + after if known and off else 0.0
    if away[0] > patience:
        before = Twist(now_v, now_omega)
    rest = horizon - ahead
    if rest > 1e-6 * rules.dt:
        pose = arc(Pose(x, y, psi), before, rest)
    else:
        pose = Pose(x, y, psi)
    for j in range(k - under_way, k):
        lasted = sent[j % d, 2]
        before = achievable(Twist(sent[j % d, 0], sent[j % d, 1]), before, limits, lasted)
        pose = arc(pose, before, lasted)
    obstacles = Surroundings(discs, max_acceleration, velocity_error, segments, points)
    if len(discs) > 0:
        obstacles = predict_obstacles(obstacles, horizon)
    nominal = Twist(v, omega) if known else Twist(math.nan, math.nan)
    g = guard(pose, before, nominal, obstacles, outline, limits, rules, False)
    sent[k % d, 0], sent[k % d, 1] = g.twist.v, g.twist.omega
    count[0] = k + 1
    return g.twist.v, g.twist.omega, g.verdict, g.change, g.clearance, g.limiting


_VERDICTS = tuple(Verdict)


def _limiting(row: int, seen: Obstacles | Surroundings) -> LimitingObstacle:
    discs, segments = len(seen.discs), len(seen.segments)
    if row < discs:
        return LimitingObstacle("disc", row)
    if row < discs + segments:
        return LimitingObstacle("segment", row - discs)
    return LimitingObstacle("point", row - discs - segments)


def _meant(pose: object, twist: object, nominal: object, seen: object, after: object) -> str:
    """Which argument is not what it should be."""
    if not isinstance(seen, Obstacles):
        return (
            "obstacles must be cohelm.Obstacles(points=...), or cohelm.Obstacles() where there are "
            f"none, got {type(seen).__name__}"
        )
    if not isinstance(after, (NoneType, float, int, np.number)):
        return f"after is the time since the last call in seconds, got {after!r}"
    return (
        "the filter takes pose (x, y, psi), twist (v, omega) and nominal (v, omega), each of "
        f"numbers, got {pose!r}, {twist!r} and {nominal!r}"
    )


def _within(name: str, value: float, low: float, high: float, unit: str) -> float:
    try:
        if isinstance(value, (bool, str, bytes)):
            raise TypeError
        made = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise CohelmError(f"{name} must be a number, got {value!r}") from error
    if not low <= made <= high:  # nor for NaN
        raise CohelmError(f"{name} must be from {low:g} to {high:g} {unit}, got {made:g}")
    return made
