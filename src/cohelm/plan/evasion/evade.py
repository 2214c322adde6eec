"""Evades moving obstacles: goes round, lets pass, backs off or steps aside, a few seconds ahead.

The safety filter promises that the robot hits nothing while it moves, and stands where it can not
promise that; so it can be walked into. Here the command that the filter is given is chosen such
that this rarely comes to pass. First the course is foretold as it would be driven. Only if somebody
would come near on it, motions of two pieces are sampled over forward, backward, turning and waiting
(the dynamic window approach of Fox, Burgard and Thrun 1997, with time). Each is held against where
everybody will be: with the acceleration that was seen to last, and with doubt that grows. The best
one whose first step the filter certifies is asked for. It is a nominal command as any other: the
filter has the last word.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, govern, governed
from cohelm.law.guard.certify import CLEAR, in_the_way, manoeuvre
from cohelm.law.guard.step import Rules, farthest
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.track import track
from cohelm.plan.course import Course
from cohelm.plan.evasion.candidates import candidates, fees_of, floors_of, twist_now
from cohelm.plan.evasion.case import Case, case_at
from cohelm.plan.evasion.foretold import Foretold, leg, whole
from cohelm.plan.evasion.movers import foreseen, noted
from cohelm.plan.evasion.params import STEP, Evasion, EvasionParams
from cohelm.plan.evasion.risk import clearance_at, spare_at, trajectories
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

_TRIES = 8  # so many of the best are tried for one that is certified
_NEARLY = 0.4  # what is so much worse than the best is not looked at to its end [m]


@jit
def evade(
    was: Evasion, pose: Pose, twist: Twist, around: Surroundings, course: Course,
    clock: CourseClock, outline: Floats, limits: Limits, gains: Gains, rules: Rules,
    pace: PaceParams, e: EvasionParams,
    watched: Floats,
) -> Evasion:  # fmt: skip
    """What to do about moving obstacles, from now on for `e.period`.

    pose, twist: when the next command takes effect; around: as of then. watched: from
    `nobody_watched`, written into.
    """
    if was.left > 0:
        return Evasion(was.on, was.v, was.omega, was.then, was.turns, was.after, was.left - 1)
    reach = farthest(outline)
    seen = noted(watched, around, e.period)
    watched[: len(seen)] = seen
    watched[len(seen) :] = math.nan
    movers, who = foreseen(around, seen, pose, reach, limits, e)
    ahead = trajectories(movers, reach, e)
    they, go = movers[:who], ahead[:, :who]
    if who == 0 or _follows(
        go, they, pose, twist, course, clock, outline, reach, limits, gains, pace, e
    ):
        return Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, _steps(e, rules) - 1)
    case = case_at(ahead, movers, around, pose, course, clock, outline, reach, limits, e)
    return _best(was, case, pose, twist, around, limits, rules, e)


@jit
def _steps(e: EvasionParams, rules: Rules) -> int:
    """Control steps from one look to the next."""
    return max(int(e.period / rules.dt + 0.5), 1)


@jit
def _follows(
    ahead: Floats, movers: Floats, pose: Pose, twist: Twist, course: Course, clock: CourseClock,
    outline: Floats, reach: float, limits: Limits, gains: Gains, pace: PaceParams, e: EvasionParams,
) -> bool:  # fmt: skip
    """Whether following the course as it is meets nobody who moves within the horizon."""
    t, k = 0.0, 0
    while t < e.horizon:
        near = clearance_at(ahead[k], movers, outline, reach, pose, t, 9.0, 1.0, 0.0)
        if near < e.social_clearance:
            return False
        if t <= e.certified_for:
            spare = spare_at(ahead[k], movers, outline, reach, pose, twist, t, limits, e)
            if spare <= e.static_clearance:
                return False
        clock = govern(clock, pose, course.reference, course.paced, False, pace, STEP)
        nominal = track(pose, governed(course.reference, clock, pose, pace), gains)
        twist = achievable(nominal, twist, limits, STEP)
        pose = arc(pose, twist, STEP)
        t, k = t + STEP, k + 1
    return True


@jit
def _best(
    was: Evasion, case: Case, pose: Pose, twist: Twist, around: Surroundings,
    limits: Limits, rules: Rules, e: EvasionParams,
) -> Evasion:  # fmt: skip
    """The cheapest motion that the filter lets begin.

    Those that promise most are looked at first; what can not come near the best so far is not
    looked at at all.
    """
    motions, firsts = candidates(was, limits, e)
    fees = fees_of(motions, was.on, e)
    floors = floors_of(case, pose, twist, motions, firsts, was.on, limits, e) + fees
    costs = np.full(len(motions), math.inf)
    start = Foretold(pose, twist, 0.0, 0.0, -1.0)
    ways: list[Foretold] = [start] * len(motions)
    known, best = np.zeros(len(motions), dtype=np.bool_), math.inf
    order: Ints = np.argsort(floors)
    for j in range(len(order)):
        i = int(order[j])
        most, k, m = best + _NEARLY - floors[i], int(firsts[i]), motions[i]
        if most < 0.0:
            break
        if not known[k]:
            ways[k] = leg(case, start, Twist(m[0], m[1]), m[4], limits, e, most)
            known[k] = True
        costs[i] = whole(case, ways[k], Twist(m[2], m[3]), limits, e, most) + fees[i]
        best = min(best, costs[i])
    chosen = _certified(costs, motions, pose, twist, case, around, limits, rules)
    now, row = twist_now(motions[chosen]), motions[chosen]
    return Evasion(True, now.v, now.omega, row[3], row[4], row[2], _steps(e, rules) - 1)


@jit
def _certified(
    costs: Floats, motions: Floats, pose: Pose, twist: Twist, case: Case, around: Surroundings,
    limits: Limits, rules: Rules,
) -> int:  # fmt: skip
    """The cheapest motion of the best few whose first step the filter lets pass; where there is
    none, the cheapest of all. Overwrites the costs."""
    first = int(np.argmin(costs))
    for _ in range(_TRIES):
        i = int(np.argmin(costs))
        command = achievable(twist_now(motions[i]), twist, limits, rules.dt)
        m = manoeuvre(pose, command, limits, rules.dt, case.reach)
        if in_the_way(m, case.outline, case.reach, around, rules.hard_margin) == CLEAR:
            return i
        costs[i] = math.inf
    return first
