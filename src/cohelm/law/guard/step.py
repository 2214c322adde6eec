"""One step of the guard: bounds, least change, certificate; else brake."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.flat import numbers, read
from cohelm.core.jit import jit
from cohelm.core.scalars import is_finite
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.approach import approach_rows, most_rows
from cohelm.law.guard.bounds import WHEEL_ROWS, braked, wheel_rows
from cohelm.law.guard.certify import CLEAR, in_the_way, manoeuvre
from cohelm.law.guard.project import project
from cohelm.law.guard.rules import Rules, checked_outline, checked_rules
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.verdict import BRAKING, INVALID, SHAPED, STANDING, UNTOUCHED
from cohelm.robot.achievable import achievable
from cohelm.robot.limits import Limits, checked_limits

NOTHING = -1
"""`limiting` when no obstacle changed the nominal command; the wheels' own limits may have."""

_TRIES = 4  # the projected command, then a half, a quarter and an eighth of it from full braking


class Guarded(NamedTuple):
    """What the guard lets through, and why."""

    v: float
    omega: float
    """The command [m/s, rad/s]; within the limits, one step after `before`."""
    verdict: int
    """UNTOUCHED: the nominal command passed. SHAPED: the nearest nominal command that is allowed
    passed. BRAKING: nothing near the nominal command could be certified; the stop certified one
    step ago goes on. STANDING: the same, and the robot stands. INVALID: the nominal command or the
    state is not a finite number; braking from a known speed, else a zero command."""
    change: float
    """Distance from the nominal command in the metric of the least change [m/s]."""
    clearance: float
    """Smallest clearance of the outline now, to what is near enough to matter; or infinite [m]."""
    limiting: int
    """What held the nominal command back: discs first, then segments, then points, by row; or
    NOTHING."""


@jit
def guard(
    pose: Pose, before: Twist, nominal: Twist, around: Surroundings, outline: Floats,
    limits: Limits, rules: Rules, planned: bool,
) -> Guarded:  # fmt: skip
    """The command nearest to `nominal` after which the robot can still stop clear of everything.

    pose: where the robot will be when the command takes effect, after any delay, in the frame of
    `around`, which is as of then too. before: the twist it will have then. outline: (k, 2),
    convex, counter-clockwise.

    1. *Bounds.* Wheel and body limits around `before`; for each thing nearer than the stopping
       distance, the contact point must not approach it faster than it can stop,
       n . (v - omega q_y, omega q_x) >= n . v_o - alpha(clearance - margin),
       alpha(h) = sqrt(a^2 T^2 + 2 a h) - a T, but it need not flee.
    2. *Least change* of the nominal command within them, exactly.
    3. *Certificate*: hold that for T, then brake; see `certify`. If it fails, the same for parts
       of the way from full braking to it.
    4. Otherwise full braking, which the certificate of the step before has covered.

    planned: a nominal command that can be certified as it is passes without the bounds. They slow
    down who comes near others and has not looked ahead. Who has planned against where everybody
    will be, as an evasion, would be slowed down by them in somebody's way. The certificate, which
    is what the promise rests on, is the same.
    """
    moving = is_finite(before.v) and is_finite(before.omega)
    stop = braked(before, limits, rules.dt) if moving else Twist(0.0, 0.0)
    sound = moving and is_finite(pose.x) and is_finite(pose.y) and is_finite(pose.psi)
    if not (sound and is_finite(nominal.v) and is_finite(nominal.omega)):
        return Guarded(stop.v, stop.omega, INVALID, 0.0, math.inf, NOTHING)
    rows = np.empty((WHEEL_ROWS + most_rows(around, outline), 4))
    n = wheel_rows(rows, before, limits, rules.dt)
    reach = farthest(outline)
    n, least = approach_rows(
        rows, n, pose, before, around, outline, reach, limits,
        rules.dt, rules.soft_margin, rules.deceleration_fraction,
    )  # fmt: skip
    if n < 0:
        return Guarded(stop.v, stop.omega, INVALID, 0.0, math.inf, NOTHING)
    asked = Twist(_sane(nominal.v), _sane(nominal.omega))
    if planned:
        goal = achievable(asked, before, limits, rules.dt)
        m = manoeuvre(pose, goal, limits, rules.dt, reach)
        if in_the_way(m, outline, reach, around, rules.hard_margin) == CLEAR:
            return _passed(goal, asked, rules.steer_weight, least, NOTHING)
    nearest = project(asked, rows, n, rules.steer_weight)
    limiting = nearest.owner
    if nearest.feasible and is_finite(nearest.twist.v) and is_finite(nearest.twist.omega):
        goal = achievable(nearest.twist, before, limits, rules.dt)
        share = 1.0
        for _ in range(_TRIES):
            part = Twist(
                stop.v + share * (goal.v - stop.v), stop.omega + share * (goal.omega - stop.omega)
            )
            part = goal if share == 1.0 else achievable(part, before, limits, rules.dt)
            m = manoeuvre(pose, part, limits, rules.dt, reach)
            thing = in_the_way(m, outline, reach, around, rules.hard_margin)
            if thing == CLEAR:
                return _passed(part, asked, rules.steer_weight, least, limiting)
            limiting = thing
            share *= 0.5
    verdict = STANDING if stop.v == 0.0 and stop.omega == 0.0 else BRAKING
    change = _distance(stop, asked, rules.steer_weight)
    return Guarded(stop.v, stop.omega, verdict, change, least, limiting)


@jit
def _sane(speed: float) -> float:
    """A speed that arithmetic with it can not make infinite."""
    return min(max(speed, -1e9), 1e9)


@jit
def _passed(
    command: Twist, nominal: Twist, steer_weight: float, least: float, limiting: int
) -> Guarded:
    change = _distance(command, nominal, steer_weight)
    if change <= 1e-9:
        return Guarded(command.v, command.omega, UNTOUCHED, change, least, NOTHING)
    return Guarded(command.v, command.omega, SHAPED, change, least, limiting)


@jit
def _distance(a: Twist, b: Twist, steer_weight: float) -> float:
    dv, domega = a.v - b.v, (a.omega - b.omega) * steer_weight
    return math.sqrt(dv * dv + domega * domega)


@jit
def farthest(outline: Floats) -> float:
    """Distance from the body origin to the outline's farthest corner [m]."""
    square = 0.0
    for i in range(outline.shape[0]):
        square = max(square, outline[i, 0] * outline[i, 0] + outline[i, 1] * outline[i, 1])
    return math.sqrt(square)


GuardStep = Callable[[Pose, Twist, Twist, Surroundings], Guarded]
"""The guard of one robot: pose, before, wish, around -> what it lets through."""

_RULES = Rules()


class _GuardSettings(NamedTuple):
    """What stays the same from step to step, beside the outline."""

    limits: Limits
    rules: Rules


def prepared(outline: ArrayLike, limits: Limits, rules: Rules = _RULES) -> GuardStep:
    """`guard` from Python, with what stays the same taken in once.

    Raises CohelmError here for an outline, limits or rules that nothing could be promised for. What
    is made never raises on numbers, and never answers with one that is not finite but for
    `clearance`, which is infinite with nothing near.

    Arguments are spread on the way in and the answer is made here: numba takes 0.8 us for a named
    tuple either way.
    """
    corners, limits, rules = checked_outline(outline), checked_limits(limits), checked_rules(rules)
    row = numbers(_GuardSettings(limits, rules))

    def step(pose: Pose, before: Twist, nominal: Twist, around: Surroundings) -> Guarded:
        return Guarded._make(_flat(*pose, *before, *nominal, *around, corners, row))

    return step


@jit
def _flat(
    x: float, y: float, psi: float, v0: float, omega0: float, v: float, omega: float,
    discs: Floats, max_acceleration: Floats, velocity_error: Floats, segments: Floats,
    points: Floats, outline: Floats, row: Floats,
) -> tuple[float, float, int, float, float, int]:  # fmt: skip
    s = read(_GuardSettings, row, 0)
    g = guard(
        Pose(x, y, psi), Twist(v0, omega0), Twist(v, omega),
        Surroundings(discs, max_acceleration, velocity_error, segments, points), outline, s.limits,
        s.rules, False,
    )  # fmt: skip
    return g.v, g.omega, g.verdict, g.change, g.clearance, g.limiting
