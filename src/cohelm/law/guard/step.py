"""One step of the guard: bounds, least change, certificate; else brake."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.scalars import is_finite
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.approach import approach_rows, max_rows
from cohelm.law.guard.bounds import WHEEL_ROWS, braked, wheel_rows
from cohelm.law.guard.certify import CLEAR, blocking_obstacle, manoeuvre
from cohelm.law.guard.project import project
from cohelm.law.guard.rules import Rules
from cohelm.law.verdict import BRAKING, INVALID, SHAPED, STANDING, UNTOUCHED
from cohelm.robot.achievable import achievable
from cohelm.robot.clearance import circumscribed_radius
from cohelm.robot.limits import Limits

NOTHING = -1
"""`limiting` where no obstacle changed the nominal command; the wheels' own limits may have."""

_TRIES = 4  # the projected command, then a half, a quarter and an eighth of it from full braking


class Guarded(NamedTuple):
    """The command that the guard passes, and why."""

    twist: Twist
    """Within the limits, one step after `before`."""
    verdict: int
    """UNTOUCHED: the nominal command passed. SHAPED: the nearest allowed command passed. BRAKING:
    nothing near the nominal command could be certified; the stop certified one step ago goes on.
    STANDING: the same, and the robot stands. INVALID: the nominal command or the state is not a
    finite number; braking from a known speed, else a zero command."""
    change: float
    """Distance from the nominal command in the metric of the least change [m/s]."""
    clearance: float
    """Smallest clearance of the outline now to a relevant obstacle; infinite without any [m]."""
    limiting: int
    """The limiting obstacle: discs, then segments, then points, by row; or NOTHING."""


@jit
def guard(
    pose: Pose, before: Twist, nominal: Twist, obstacles: Surroundings, outline: Floats,
    limits: Limits, rules: Rules, planned: bool,
) -> Guarded:  # fmt: skip
    """The command nearest to `nominal` after which the robot can still stop clear of everything.

    pose: where the robot will be when the command takes effect, after any delay, in the frame of
    `obstacles`, which is as of then too. before: the twist it will have then. outline: (k, 2),
    convex, counter-clockwise.

    1. *Bounds.* Wheel and body limits around `before`; for each obstacle nearer than the stopping
       distance, the contact point must not approach it faster than the robot can stop,
       n . (v - omega q_y, omega q_x) >= n . v_o + e - alpha(clearance - margin),
       alpha(h) = sqrt(a^2 T^2 + 2 a h) - a T, e the error of v_o; the robot does not have to flee.
    2. *Least change* of the nominal command within them, exactly.
    3. *Certificate*: hold that for T, then brake; see `certify`. If it fails, the same for parts
       of the way from full braking to it.
    4. Otherwise full braking, which the certificate of the step before has covered.

    planned: a nominal command that can be certified as it is passes without the bounds. They slow
    the robot near obstacles, as a command that was not planned ahead needs. An evasion is planned
    against predicted movers, and slowing down would leave the robot in their way. The certificate,
    on which the guarantee rests, is the same.
    """
    twist_known = is_finite(before.v) and is_finite(before.omega)
    stop = braked(before, limits, rules.dt) if twist_known else Twist(0.0, 0.0)
    state_known = twist_known and is_finite(pose.x) and is_finite(pose.y) and is_finite(pose.psi)
    if not (state_known and is_finite(nominal.v) and is_finite(nominal.omega)):
        return Guarded(stop, INVALID, 0.0, math.inf, NOTHING)
    rows = np.empty((WHEEL_ROWS + max_rows(obstacles, outline), 4))
    n = wheel_rows(rows, before, limits, rules.dt)
    reach = circumscribed_radius(outline)
    n, min_clearance = approach_rows(
        rows, n, pose, before, obstacles, outline, reach, limits,
        rules.dt, rules.soft_margin, rules.deceleration_fraction,
    )  # fmt: skip
    if n < 0:
        return Guarded(stop, INVALID, 0.0, math.inf, NOTHING)
    wanted = Twist(_bounded(nominal.v), _bounded(nominal.omega))
    if planned:
        goal = achievable(wanted, before, limits, rules.dt)
        m = manoeuvre(pose, goal, limits, rules.dt, reach)
        if blocking_obstacle(m, outline, reach, obstacles, rules.hard_margin) == CLEAR:
            return _accepted(goal, wanted, rules.steer_weight, min_clearance, NOTHING)
    nearest = project(wanted, rows, n, rules.steer_weight)
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
            blocking = blocking_obstacle(m, outline, reach, obstacles, rules.hard_margin)
            if blocking == CLEAR:
                return _accepted(part, wanted, rules.steer_weight, min_clearance, limiting)
            limiting = blocking
            share *= 0.5
    verdict = STANDING if stop.v == 0.0 and stop.omega == 0.0 else BRAKING
    change = _metric_distance(stop, wanted, rules.steer_weight)
    return Guarded(stop, verdict, change, min_clearance, limiting)


@jit_no_refcount
def _bounded(speed: float) -> float:
    """A speed clipped so that arithmetic with it stays finite."""
    return min(max(speed, -1e9), 1e9)


@jit_no_refcount
def _accepted(
    command: Twist, nominal: Twist, steer_weight: float, min_clearance: float, limiting: int
) -> Guarded:
    change = _metric_distance(command, nominal, steer_weight)
    if change <= 1e-9:
        return Guarded(command, UNTOUCHED, change, min_clearance, NOTHING)
    return Guarded(command, SHAPED, change, min_clearance, limiting)


@jit_no_refcount
def _metric_distance(a: Twist, b: Twist, steer_weight: float) -> float:
    dv, domega = a.v - b.v, (a.omega - b.omega) * steer_weight
    return math.sqrt(dv * dv + domega * domega)
