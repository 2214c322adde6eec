"""Evades moving obstacles: goes round, lets pass, backs off or steps aside, a few seconds ahead.

The safety filter guarantees that a moving robot hits nothing, and stands where it can not certify
a motion; then it can be walked into. This chooses the nominal command such that this is rare. First
path following is rolled out. Only if a mover comes near on it, motions of two pieces are sampled
over forward, backward, turning and waiting (the dynamic window approach of Fox, Burgard and Thrun
1997, with time). Each is evaluated against the predicted movers, with their estimated accelerations
and growing uncertainty. The cheapest whose first step the filter certifies becomes the nominal
command; the filter has the last word.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, govern, governed
from cohelm.law.guard.certify import CLEAR, blocking_obstacle, manoeuvre
from cohelm.law.guard.rules import Rules
from cohelm.law.track import track
from cohelm.plan.course import Course
from cohelm.plan.evasion.candidates import (
    AFTER,
    OMEGA,
    THEN,
    TURNS,
    V,
    candidates,
    extra_costs,
    first_twist,
    lower_bounds,
)
from cohelm.plan.evasion.context import EvasionContext, context_at
from cohelm.plan.evasion.movers import relevant_movers, updated_history
from cohelm.plan.evasion.params import LONG, PATIENT, STEP, Evasion, EvasionParams
from cohelm.plan.evasion.predicted_motion import PredictedMotion, motion_cost, roll_out_piece
from cohelm.plan.evasion.risk import clearance_at, spare_at, trajectories
from cohelm.plan.recovery import begins
from cohelm.robot.achievable import achievable
from cohelm.robot.clearance import circumscribed_radius
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_SOONEST, _LATEST = 0.6, 1.3  # periods after a scan, with the next one and without
_TRIES = 8  # of the cheapest motions, until one is certified
_COST_GAP = 0.4  # a motion worse than the best by this is not among the cheapest ones [m]


@jit
def evade(
    last: Evasion, pose: Pose, twist: Twist, obstacles: Surroundings, course: Course,
    clock: CourseClock, outline: Floats, limits: Limits, gains: Gains, rules: Rules,
    pace: PaceParams, params: EvasionParams, history: Floats, velocity_error: Floats, barred: int,
    fresh: bool,
) -> Evasion:  # fmt: skip
    """The evasion until the next evaluation.

    pose, twist: when the next command takes effect; obstacles: as of then. history: from
    `empty_mover_history`, written into. velocity_error: (n,), that of the discs as they were seen,
    before they were predicted to then [m/s]. barred: kinds of motion that are not chosen, see
    `plan.recovery`. fresh: whether a new scan has updated the movers since the step before.
    """
    since = last.since + rules.dt
    if not is_due(since, fresh, last.fresh, params.period, rules.dt):
        return Evasion(
            last.on, last.v, last.omega, last.then, last.turns, last.after, since, last.fresh,
            last.lasted,
        )  # fmt: skip
    reach = circumscribed_radius(outline)
    updated = updated_history(history, obstacles.discs, velocity_error, since)
    history[: len(updated)] = updated
    history[len(updated) :] = math.nan
    wary = min((LONG - last.lasted) / (LONG - PATIENT), 1.0)
    movers, count = relevant_movers(obstacles, updated, pose, reach, limits, params, wary)
    ahead = trajectories(movers, reach, params)
    moving, moving_ahead = movers[:count], ahead[:, :count]
    if count == 0 or _path_is_clear(
        moving_ahead, moving, pose, twist, course, clock, outline, reach, limits, gains, pace,
        params,
    ):  # fmt: skip
        lasted = max(last.lasted - since, 0.0)
        return _off(0.0, fresh, lasted)
    context = context_at(
        ahead, movers, obstacles, pose, course, clock, outline, reach, limits, params
    )
    return _cheapest(
        last, context, pose, twist, obstacles, limits, rules, params, barred, since, fresh
    )


@jit_no_refcount
def not_evading(last: Evasion, dt: float) -> Evasion:
    """None, a control step after the last one: the operator leads, or it is switched off."""
    return _off(last.since + dt, last.fresh, 0.0)


@jit_no_refcount
def _off(since: float, fresh: bool, lasted: float) -> Evasion:
    """No evasion, as `NO_EVASION`."""
    return Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, since, fresh, lasted)


@jit_no_refcount
def is_due(since: float, fresh: bool, after_scan: bool, period: float, dt: float) -> bool:
    """Whether movers are evaluated in this step, `since` [s] after the last time.

    How soon a mover is known to set off decides whether the robot gets out of its way (docs:
    measured, "With each scan"). So an evaluation comes with a new scan, and waits a little for one
    that is late; without scans they are a period apart. fresh: whether this step has a new scan.
    after_scan: whether the last evaluation had one.
    """
    if fresh and (not after_scan or since > _SOONEST * period - 0.5 * dt):
        return True
    return since > (_LATEST if after_scan else 1.0) * period - 0.5 * dt


@jit_no_refcount
def _path_is_clear(
    ahead: Floats, movers: Floats, pose: Pose, twist: Twist, course: Course, clock: CourseClock,
    outline: Floats, reach: float, limits: Limits, gains: Gains, pace: PaceParams,
    params: EvasionParams,
) -> bool:  # fmt: skip
    """Whether following the path keeps clear of all movers within the horizon."""
    t, k = 0.0, 0
    while t < params.horizon:
        clearance = clearance_at(ahead[k], movers, outline, reach, pose, t, 9.0, 1.0, 0.0)
        if clearance < params.social_clearance:
            return False
        if t <= params.certified_for:
            slack = spare_at(ahead[k], movers, outline, reach, pose, twist, t, limits, params)
            if slack <= params.static_clearance:
                return False
        clock = govern(clock, pose, course.reference, course.paced, False, pace, STEP)
        nominal = track(pose, governed(course.reference, clock, pose, pace), gains)
        twist = achievable(nominal, twist, limits, STEP)
        pose = arc(pose, twist, STEP)
        t, k = t + STEP, k + 1
    return True


@jit
def _cheapest(
    last: Evasion, context: EvasionContext, pose: Pose, twist: Twist, obstacles: Surroundings,
    limits: Limits, rules: Rules, params: EvasionParams, barred: int, since: float, fresh: bool,
) -> Evasion:  # fmt: skip
    """The cheapest motion whose first step the filter passes, without barred ones. since: time
    since the last evaluation [s]. fresh: whether this one has a new scan."""
    motions, firsts = candidates(last, since, limits, params)
    extras = extra_costs(motions, last.on, params)
    bounds = lower_bounds(context, pose, twist, motions, firsts, last.on, limits, params) + extras
    for i in range(len(motions)):
        kinds = begins(motions[i, V], motions[i, OMEGA]) | begins(motions[i, AFTER], 0.0)
        if kinds & barred:
            bounds[i] = math.inf
    costs = _costs(context, pose, twist, motions, firsts, extras, bounds, limits, params, 0.0)
    chosen = int(np.argmin(costs))
    if not _certified(motions[chosen], pose, twist, context, obstacles, limits, rules):
        # Hardly ever; so the next best ones are computed only now.
        costs = _costs(
            context, pose, twist, motions, firsts, extras, bounds, limits, params, _COST_GAP
        )
        chosen = _cheapest_certified(costs, motions, pose, twist, context, obstacles, limits, rules)
    motion = motions[chosen]
    command = first_twist(motion)
    return Evasion(
        True, command.v, command.omega, motion[THEN], motion[TURNS], motion[AFTER], 0.0, fresh,
        min(last.lasted + min(since, params.period), LONG),
    )  # fmt: skip


@jit
def _costs(
    context: EvasionContext, pose: Pose, twist: Twist, motions: Floats, firsts: Ints,
    extras: Floats, bounds: Floats, limits: Limits, params: EvasionParams, gap: float,
) -> Floats:  # fmt: skip
    """The cost of each motion that is at most `gap` worse than the best, others perhaps inf [m].

    In order of their lower bounds; motions that can not come so near the best so far are skipped.
    One that the filter would slow down may cost less than its bound: with a gap of 0, in a
    thousandth of all evaluations the best is one that is 0.1 m worse.
    """
    costs = np.full(len(motions), math.inf)
    start = PredictedMotion(pose, twist, 0.0, 0.0, -1.0)
    first_motions: list[PredictedMotion] = [start] * len(motions)
    computed, best = np.zeros(len(motions), dtype=np.bool_), math.inf
    order: Ints = np.argsort(bounds)
    for j in range(len(order)):
        i = int(order[j])
        cost_limit, k, m = best + gap - bounds[i], int(firsts[i]), motions[i]
        if cost_limit < 0.0:
            break
        if not computed[k]:
            first_motions[k] = roll_out_piece(
                context, start, Twist(m[V], m[OMEGA]), m[TURNS], limits, params, cost_limit
            )
            computed[k] = True
        costs[i] = (
            motion_cost(
                context, first_motions[k], Twist(m[AFTER], m[THEN]), limits, params, cost_limit
            )
            + extras[i]
        )
        best = min(best, costs[i])
    return costs


@jit
def _cheapest_certified(
    costs: Floats, motions: Floats, pose: Pose, twist: Twist, context: EvasionContext,
    obstacles: Surroundings, limits: Limits, rules: Rules,
) -> int:  # fmt: skip
    """The cheapest of the best few motions whose first step the filter certifies, else the
    cheapest of all. Overwrites the costs."""
    first = int(np.argmin(costs))
    for _ in range(_TRIES):
        i = int(np.argmin(costs))
        if _certified(motions[i], pose, twist, context, obstacles, limits, rules):
            return i
        costs[i] = math.inf
    return first


@jit
def _certified(
    motion: Floats, pose: Pose, twist: Twist, context: EvasionContext, obstacles: Surroundings,
    limits: Limits, rules: Rules,
) -> bool:  # fmt: skip
    """Whether the filter certifies the first step of a motion."""
    command = achievable(first_twist(motion), twist, limits, rules.dt)
    m = manoeuvre(pose, command, limits, rules.dt, context.reach)
    blocking = blocking_obstacle(m, context.outline, context.reach, obstacles, rules.hard_margin)
    return blocking == CLEAR
