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
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, Twist, X, Y
from cohelm.law.gains import Gains
from cohelm.law.govern import Clock, PaceParams, govern, governed
from cohelm.law.guard.bounds import brake_steps, braked, coasting
from cohelm.law.guard.certify import CLEAR, in_the_way, manoeuvre
from cohelm.law.guard.contact import gap
from cohelm.law.guard.step import Rules, farthest
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.track import track
from cohelm.plan.course import Course, window
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, achievable

_H = 0.1  # from one look along a foretold motion to the next [s]
_CELL = 0.06  # of the grid of what stands [m]
_FARTHEST = 6.0  # what stands farther away than this is not looked at [m]
_EDGE = 0.08  # between two points of the outline that are held against it [m]
_TRIES = 8  # so many of the best are tried for one that is certified
_SPEEDS = (1.0, 0.75, 0.5, 0.25, 0.0, -0.5, -1.0)
_TURNINGS = (0.0, 0.15, -0.15, 0.35, -0.35, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0)
"""Shares of the largest speed and yaw rate that are tried."""
_NEARLY = 0.4  # what is so much worse than the best is not looked at to its end [m]
_TURNS = 1.0  # the first piece of a motion [s]
_TOUCH = 100.0  # cost of a touch for each second that it comes before the horizon [m/s]
_WATCHED = 64  # movers are watched at most
_SLOW = 0.05  # nobody makes way for who is slower; as in `plan.prediction` [m/s]
_SAME = 0.5  # who is farther from where he should be by now is somebody else [m]
_STRIDE = 0.5  # with which is foretold about where a motion leads [s]
_ABOUT = 0.25  # by so much less it may then cost [m]
_LASTS = 0.5  # of a change of velocity, share that is taken from the newest look
_WALKS, _LATELY = 0.3, 1.0  # who was faster so lately may set off again at any moment [m/s, s]
_KNOWN = 0.5  # who has walked for less may be noise, and none of whom to expect it [s]
_BRAKES = 0.5  # of what he is capable of, from which on who slows down is taken to stop
_FASTER = 2.0  # times as fast as he was ever seen is who sets off next
_NOTICED = 0.3  # until it is seen that somebody sets off: three looks [s]

HURRY = 1.6
"""Who gets out of somebody's way may be so much faster than the reference."""


class EvasionParams(NamedTuple):
    """How moving obstacles are evaded."""

    horizon: float = 3.0
    """How far ahead is looked; 0: nobody is evaded, the robot only stands [s]."""
    period: float = 0.1
    """From one look to the next [s]."""
    speed: float = 0.8
    """Largest speed of an evasion [m/s]."""
    yaw_rate: float = 1.6
    """Largest yaw rate of one [rad/s]."""
    clearance: float = 0.25
    """Clearance to a moving obstacle below which a motion is the worse the nearer it comes [m]."""
    standing_growth: float = 0.05
    moving_growth: float = 0.3
    growth_per_speed: float = 0.4
    most_growth: float = 0.6
    """Doubt of where it will be grows by the first if it stands; else by the second, and by the
    third for each m/s of its speed, but by no more than the fourth [m/s]: who stands, sways; who
    walks, turns."""
    social_clearance: float = 0.4
    """Clearance below which the course is not simply followed [m]."""
    risk_weight: float = 3.0
    """How far the robot goes out of its way for a second right beside somebody [m/s]."""
    ahead: float = 0.5
    """Where a mover will be so long afterwards counts as near to him, too [s]."""
    slack: float = 0.1
    slack_growth: float = 0.15
    """A motion is the worse the less the filter has to spare when it looks for a way to stop, below
    the first, which grows by the second [m, m/s]."""
    turning: float = 0.8
    """For so long a mover is taken to go on changing his velocity as he does [s]."""
    hysteresis: float = 0.15
    """How much better than what is being done something else has to be [m]."""
    static_clearance: float = 0.03
    """Clearance to what stands [m]."""
    certified_for: float = 3.0
    """For so long a motion is foretold as the filter will let it be [s]."""
    certified_growth: float = 0.0
    """Share of the doubt that is counted in for that."""
    pass_right: float = 0.0
    """How much wider movers are taken to be on the robot's left, so that it passes them on the
    right, as the paper's k_CBF does [m]."""
    sets_off_weight: float = 180.0
    """How far the robot goes out of its way for a second beside somebody who would be there before
    it got away, if he turned on it [m/s]."""


class Evasion(NamedTuple):
    """What is being done about moving obstacles."""

    on: bool
    v: float
    omega: float
    """The twist asked for while it is on [m/s, rad/s]."""
    then: float
    """The yaw rate after `turns` [rad/s]."""
    turns: float
    """For how long omega is meant to be asked for [s]."""
    after: float
    """The speed after `turns` [m/s]."""
    left: int
    """Steps until the next look."""


NO_EVASION = Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


def nobody_watched() -> Floats:
    """Memory of how movers change their velocities, for `evade`: (64, 10), as many rows of x, y,
    vx, vy, ax, ay, the mean square of what they were taken from (-1: not known yet), the largest
    speed so far, the time since he was last faster than `_WALKS` and for how long he has been, as
    there were movers at the last look, then NaN."""
    return np.full((_WATCHED, 10), math.nan)


class Field(NamedTuple):
    """Distance to what stands, on a grid around the robot."""

    distance: Floats
    """(n, n), row along y [m]."""
    x: float
    y: float
    """Corner of cell (0, 0) [m]."""


class _Case(NamedTuple):
    """All that candidates are held against."""

    movers: Floats
    """(m, 12): x, y, vx, vy, radius, the acceleration that the filter takes it to be capable of,
    how fast doubt of where it is grows, the acceleration that it has and for how long, the speed
    that it may reach, and how long the robot takes to be out of its way."""
    field: Field
    way: Floats
    """(k, 3): x, y, what is left of the course from there [m]."""
    outline: Floats
    edge: Floats
    """(e, 2), points all along the outline, body frame."""
    reach: float
    inner: float
    still: float
    """Clearance to what stands that is asked for: no more than there is now [m]."""


@jit
def evade(
    was: Evasion, pose: Pose, twist: Twist, around: Surroundings, course: Course, clock: Clock,
    outline: Floats, limits: Limits, gains: Gains, rules: Rules, pace: PaceParams, e: EvasionParams,
    watched: Floats,
) -> Evasion:  # fmt: skip
    """What to do about moving obstacles, from now on for `e.period`.

    pose, twist: when the next command takes effect; around: as of then. watched: from
    `nobody_watched`, written into.
    """
    if was.left > 0:
        return Evasion(was.on, was.v, was.omega, was.then, was.turns, was.after, was.left - 1)
    reach = farthest(outline)
    seen = _watched(watched, around, e.period)
    watched[: len(seen)] = seen
    watched[len(seen) :] = math.nan
    movers, who = _movers(around, seen, pose, reach, limits, e)
    if who == 0 or _follows(
        movers, who, pose, twist, course, clock, outline, reach, limits, gains, pace, e
    ):
        return Evasion(False, 0.0, 0.0, 0.0, 0.0, 0.0, _steps(e, rules) - 1)
    case = _case(movers, around, pose, course, clock, outline, reach, e)
    return _best(was, case, pose, twist, around, limits, rules, e)


@jit
def _steps(e: EvasionParams, rules: Rules) -> int:
    """Control steps from one look to the next."""
    return max(int(e.period / rules.dt + 0.5), 1)


@jit
def _watched(seen: Floats, around: Surroundings, period: float) -> Floats:
    """Those that move, and how they change their velocities, as `nobody_watched` says."""
    found = np.empty((min(len(around.discs), _WATCHED), 10))
    n = 0
    for i in range(len(around.discs)):
        d = around.discs[i]
        if n == len(found) or not math.hypot(d[VX], d[VY]) > 0.0:  # nor for NaN
            continue
        one = found[n]
        one[0], one[1], one[2], one[3] = d[X], d[Y], d[VX], d[VY]
        one[4], one[5], one[6], one[7] = 0.0, 0.0, -1.0, math.hypot(d[VX], d[VY])
        walks = one[7] > _WALKS
        one[8], one[9] = (0.0, period) if walks else (math.inf, 0.0)
        best, before = _SAME, -1
        for j in range(len(seen)):
            far = math.hypot(
                seen[j, 0] + period * seen[j, 2] - d[X], seen[j, 1] + period * seen[j, 3] - d[Y]
            )
            if far < best:
                best, before = far, j
        if before >= 0:
            most = max(around.agility[i], 0.0)
            ax, ay = (d[VX] - seen[before, 2]) / period, (d[VY] - seen[before, 3]) / period
            push = math.hypot(ax, ay)
            share = min(1.0, most / push) if push > 0.0 else 1.0
            ax, ay = ax * share, ay * share
            new = 1.0 if seen[before, 6] < 0.0 else _LASTS
            one[4] = seen[before, 4] + new * (ax - seen[before, 4])
            one[5] = seen[before, 5] + new * (ay - seen[before, 5])
            one[6] = max(seen[before, 6], 0.0)
            one[6] += new * (ax * ax + ay * ay - one[6])
            one[7] = max(one[7], seen[before, 7])
            one[8] = min(one[8], seen[before, 8] + period)
            one[9] += seen[before, 9]
        n += 1
    return found[:n]


@jit
def _movers(
    around: Surroundings, seen: Floats, pose: Pose, reach: float, limits: Limits, e: EvasionParams
) -> tuple[Floats, int]:
    """Those that could matter within the horizon, and how many of them come first because they
    move, or did lately; the others may set off."""
    found = np.empty((2 * len(around.discs), 12))
    n = _gathered(found, 0, True, around, seen, pose, reach, limits, e)
    return found[: _gathered(found, n, False, around, seen, pose, reach, limits, e)], n


@jit
def _gathered(
    found: Floats, n: int, moving: bool, around: Surroundings, seen: Floats, pose: Pose,
    reach: float, limits: Limits, e: EvasionParams,
) -> int:  # fmt: skip
    """Write those that move, or those that do not, from row n on; one past the last row."""
    k = 0
    fast = min(e.speed, limits.speed)
    stops = brake_steps(Twist(fast, 0.0), limits, _H) * _H
    for i in range(len(around.discs)):
        d = around.discs[i]
        vx, vy = d[VX], d[VY]
        agility = around.agility[i]
        speed, ax, ay = math.hypot(vx, vy), 0.0, 0.0
        top, lately, turning = 0.0, speed > _SLOW, e.turning
        if speed > 0.0:
            if k < len(seen):
                lasts = 0.0
                if seen[k, 6] > 0.0:  # what does not last was noise
                    lasts = min((seen[k, 4] ** 2 + seen[k, 5] ** 2) / seen[k, 6], 1.0)
                known = seen[k, 9] > _KNOWN
                top = seen[k, 7] if known else 0.0
                lately = lately or (known and seen[k, 8] < _LATELY)
                ax, ay = lasts * seen[k, 4], lasts * seen[k, 5]
            k += 1
        if vx == 0.0 and vy == 0.0 and agility == 0.0:
            continue
        if lately != moving:
            continue
        far = math.hypot(d[X] - pose.x, d[Y] - pose.y) - d[RADIUS] - reach
        if not far < (speed + e.speed) * e.horizon + e.social_clearance:
            continue
        if speed > 0.0:  # who slows down, stops; he does not go back
            brakes = -(ax * vx + ay * vy) / speed
            if brakes > max(_BRAKES * agility, 0.9 * math.hypot(ax, ay)):
                turning = speed / brakes
                ax, ay = -brakes * vx / speed, -brakes * vy / speed
            else:
                back = min(speed / e.turning - brakes, 0.0) / speed
                ax, ay = ax - back * vx, ay - back * vy
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = d[X], d[Y], vx, vy
        found[n, 4], found[n, 5] = d[RADIUS], agility
        found[n, 6] = e.standing_growth
        if moving:
            found[n, 6] = min(e.moving_growth + e.growth_per_speed * speed, e.most_growth)
        found[n, 7], found[n, 8], found[n, 9], found[n, 10] = ax, ay, turning, _FASTER * top
        way = reach + d[RADIUS] + 0.5 * agility * stops * stops
        found[n, 11] = min(_NOTICED + way / max(fast, 1e-3) + 0.5 * stops, e.horizon)
        n += 1
        if e.pass_right > 0.0 and far < math.inf:
            found[n] = found[n - 1]
            away = math.hypot(d[X] - pose.x, d[Y] - pose.y)
            share = e.pass_right / max(away, 1e-9)
            found[n, 0] -= share * (d[Y] - pose.y)
            found[n, 1] += share * (d[X] - pose.x)
            n += 1
    return n


@jit_inline
def _goes(t: float, turning: float) -> float:
    """By how much of its acceleration a mover is displaced after t [s^2]."""
    s = min(t, turning)
    return s * (t - 0.5 * s)


@jit
def _clearance(
    movers: Floats, outline: Floats, reach: float, pose: Pose, t: float, most: float,
    growth: float, agile: float,
) -> float:  # fmt: skip
    """Least clearance of the outline to where the movers will be after t, at most `most` [m].

    growth: share of the doubt that they are larger by; agile: for so long before t they have kept
    their velocity, and may have done anything else that they are capable of [s].
    """
    least = most
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    since = t - agile
    for i in range(len(movers)):
        goes = _goes(since, movers[i, 9]) + agile * min(since, movers[i, 9])
        dx = movers[i, 0] + movers[i, 2] * t + movers[i, 7] * goes - pose.x
        dy = movers[i, 1] + movers[i, 3] * t + movers[i, 8] * goes - pose.y
        r = movers[i, 4] + 0.5 * movers[i, 5] * agile * agile + growth * movers[i, 6] * t
        far = least + reach + r
        if dx * dx + dy * dy < far * far:
            least = min(least, gap(outline, c * dx + s * dy, -s * dx + c * dy) - r)
    return least


@jit_inline
def _comes(
    mover: Floats, t: float, dx: float, dy: float, c: float, s: float, e: EvasionParams
) -> float:
    """How far a mover could come, if it turned on the robot after t, before the robot is away [m].

    dx, dy: where it is then, from the robot [m]; c, s: cosine and sine of the robot's heading. The
    robot gets away to the front or to the back: from who is ahead or behind, after turning by up to
    a radian. Who moves stops first. Nobody is faster than `_FASTER` lets him be; who is not known
    to walk does not count.
    """
    a, until = mover[5], min(t, mover[9])
    if not (a > 0.0 and mover[10] > 0.0):
        return 0.0
    u = math.hypot(mover[2] + mover[7] * until, mover[3] + mover[8] * until)
    beside = abs(c * dy - s * dx) / max(math.hypot(dx, dy), 1e-9)
    left = mover[11] + (1.0 - beside) / e.yaw_rate - u / a
    if not left > 0.0:
        return 0.0
    top = min(mover[10], a * left)
    return top * left - 0.5 * top * top / a


@jit
def _risk(case: _Case, pose: Pose, t: float, e: EvasionParams) -> tuple[float, float]:
    """How uneasy it is to be there after t, and the least clearance to where the movers will be.

    Each counts (1 - clearance / d)^2 below d = `e.clearance` and the doubt of where he is by then;
    of those that stand only the nearest, as they may be many points of one thing. Who has been seen
    to move counts besides by how much nearer he is than `_comes`.
    """
    risk, stands, least = 0.0, 0.0, 9.0
    weight = e.sets_off_weight / e.risk_weight if e.risk_weight > 0.0 else 0.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    movers = case.movers
    for i in range(len(movers)):
        goes = _goes(t, movers[i, 9])
        dx = movers[i, 0] + movers[i, 2] * t + movers[i, 7] * goes - pose.x
        dy = movers[i, 1] + movers[i, 3] * t + movers[i, 8] * goes - pose.y
        near = e.clearance + movers[i, 6] * t
        zone = _comes(movers[i], t, dx, dy, c, s, e) if weight > 0.0 else 0.0
        far = near + e.ahead * math.hypot(movers[i, 2], movers[i, 3])
        far = max(far, zone) + case.reach + movers[i, 4]
        if dx * dx + dy * dy < far * far:
            g = gap(case.outline, c * dx + s * dy, -s * dx + c * dy) - movers[i, 4]
            least = min(least, g)
            if zone > 0.0 and g < zone:
                share = 1.0 - max(g, 0.0) / zone
                risk += weight * share * share
            if e.ahead > 0.0:  # in front of somebody it is worse than behind him
                dx += movers[i, 2] * e.ahead
                dy += movers[i, 3] * e.ahead
                g = min(g, gap(case.outline, c * dx + s * dy, -s * dx + c * dy) - movers[i, 4])
            if g < near:
                share = 1.0 - max(g, 0.0) / near
                if movers[i, 2] == 0.0 and movers[i, 3] == 0.0:
                    stands = max(stands, share * share)
                else:
                    risk += share * share
    return risk + stands, least


@jit
def _follows(
    movers: Floats, who: int, pose: Pose, twist: Twist, course: Course, clock: Clock,
    outline: Floats, reach: float, limits: Limits, gains: Gains, pace: PaceParams, e: EvasionParams,
) -> bool:  # fmt: skip
    """Whether following the course as it is meets nobody who moves within the horizon."""
    movers, t = movers[:who], 0.0
    while t < e.horizon:
        near = _clearance(movers, outline, reach, pose, t, 9.0, 1.0, 0.0)
        if near < e.social_clearance:
            return False
        if t <= e.certified_for:
            spare = _spare(movers, outline, reach, pose, twist, t, limits, e)
            if spare <= e.static_clearance:
                return False
        clock = govern(clock, pose, course.reference, course.paced, False, pace, _H)
        wish = track(pose, governed(course.reference, clock, pose, pace), gains)
        twist = achievable(wish, twist, limits, _H)
        pose = arc(pose, twist, _H)
        t += _H
    return True


@jit
def _case(
    movers: Floats, around: Surroundings, pose: Pose, course: Course, clock: Clock, outline: Floats,
    reach: float, e: EvasionParams,
) -> _Case:  # fmt: skip
    edge = _edge(outline)
    inner = math.inf
    for i in range(len(edge)):
        inner = min(inner, math.hypot(edge[i, 0], edge[i, 1]))
    field = _field(around, pose, min(e.speed * e.horizon, _FARTHEST) + reach + 2.0 * _CELL)
    case = _Case(movers, field, _way(course, clock), outline, edge, reach, inner, 0.0)
    now = _room(case, pose)
    still = min(e.static_clearance + _CELL, now - 0.25 * _CELL)
    return _Case(movers, field, case.way, outline, edge, reach, inner, still)


@jit
def _edge(outline: Floats) -> Floats:
    k = len(outline)
    n = 0
    for i in range(k):
        j = (i + 1) % k
        n += (
            int(math.hypot(outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]) / _EDGE)
            + 1
        )
    points = np.empty((n, 2))
    n = 0
    for i in range(k):
        j = (i + 1) % k
        dx, dy = outline[j, 0] - outline[i, 0], outline[j, 1] - outline[i, 1]
        parts = int(math.hypot(dx, dy) / _EDGE) + 1
        for p in range(parts):
            points[n, 0], points[n, 1] = (
                outline[i, 0] + dx * p / parts,
                outline[i, 1] + dy * p / parts,
            )
            n += 1
    return points


@jit
def _way(course: Course, clock: Clock) -> Floats:
    """The course ahead, every 20 cm for 8 m, and how much of it is left from there."""
    poses = course.poses
    first, end = window(course, clock.tau, 8.0)
    n = (end - 1 - first) // 4 + 1
    way = np.empty((n + 1, 3))
    k = 0
    for i in range(first, end, 4):
        way[k, 0], way[k, 1] = poses[i, 0], poses[i, 1]
        k += 1
    way[k, 0], way[k, 1] = poses[end - 1, 0], poses[end - 1, 1]
    way[k, 2] = 0.0
    for i in range(k - 1, -1, -1):
        way[i, 2] = way[i + 1, 2] + math.hypot(way[i + 1, 0] - way[i, 0], way[i + 1, 1] - way[i, 1])
    return way[: k + 1]


@jit
def _field(around: Surroundings, pose: Pose, half: float) -> Field:
    """Distances to what stands, by two sweeps over the grid (Borgefors 1986)."""
    n = int(2.0 * half / _CELL) + 1
    x0, y0 = pose.x - half, pose.y - half
    d = np.full((n, n), 1e3)
    for i in range(len(around.points)):
        _mark(d, around.points[i, 0] - x0, around.points[i, 1] - y0)
    for i in range(len(around.segments)):
        ax, ay = around.segments[i, 0], around.segments[i, 1]
        bx, by = around.segments[i, 2], around.segments[i, 3]
        length = math.hypot(bx - ax, by - ay)
        if not length < 1e6:
            continue
        along = ((pose.x - ax) * (bx - ax) + (pose.y - ay) * (by - ay)) / max(length, 1e-9)
        low, high = max(along - 1.5 * half, 0.0), min(along + 1.5 * half, length)
        for j in range(int(max(high - low, 0.0) / (0.7 * _CELL)) + 1):
            s = min(low + 0.7 * _CELL * j, length) / max(length, 1e-9)
            _mark(d, ax + s * (bx - ax) - x0, ay + s * (by - ay) - y0)
    for i in range(len(around.discs)):
        disc, r = around.discs[i], around.discs[i, RADIUS]
        rests = disc[VX] == 0.0 and disc[VY] == 0.0 and around.agility[i] == 0.0
        if rests and math.hypot(disc[X] - pose.x, disc[Y] - pose.y) < 1.5 * half + r:
            m = int(2.0 * math.pi * r / (0.7 * _CELL)) + 3
            for j in range(m):
                a = 2.0 * math.pi * j / m
                _mark(d, disc[X] + r * math.cos(a) - x0, disc[Y] + r * math.sin(a) - y0)
    side, across = 0.95 * _CELL, 0.95 * _CELL * math.sqrt(2.0)  # at most 5 % too far, so
    for i in range(n):
        for j in range(n):
            b = d[i, j]
            if i > 0:
                b = min(b, d[i - 1, j] + side)
                if j > 0:
                    b = min(b, d[i - 1, j - 1] + across)
                if j + 1 < n:
                    b = min(b, d[i - 1, j + 1] + across)
            if j > 0:
                b = min(b, d[i, j - 1] + side)
            d[i, j] = b
    for i in range(n - 1, -1, -1):
        for j in range(n - 1, -1, -1):
            b = d[i, j]
            if i + 1 < n:
                b = min(b, d[i + 1, j] + side)
                if j > 0:
                    b = min(b, d[i + 1, j - 1] + across)
                if j + 1 < n:
                    b = min(b, d[i + 1, j + 1] + across)
            if j + 1 < n:
                b = min(b, d[i, j + 1] + side)
            d[i, j] = b
    return Field(d, x0, y0)


@jit
def _mark(d: Floats, x: float, y: float) -> None:
    if x >= 0.0 and y >= 0.0:  # never for NaN
        i, j = int(min(y / _CELL, 1e6)), int(min(x / _CELL, 1e6))
        if i < len(d) and j < len(d):
            d[i, j] = 0.0


@jit
def _distance(f: Field, x: float, y: float) -> float:
    n = len(f.distance)
    i, j = int((y - f.y) / _CELL), int((x - f.x) / _CELL)
    return f.distance[min(max(i, 0), n - 1), min(max(j, 0), n - 1)]


@jit
def _room(case: _Case, pose: Pose) -> float:
    """Clearance of the outline to what stands, by the grid; no more than 1 m is told apart [m]."""
    least = 1.0
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(case.edge)):
        ex, ey = case.edge[i, 0], case.edge[i, 1]
        least = min(
            least, _distance(case.field, pose.x + c * ex - s * ey, pose.y + s * ex + c * ey)
        )
    return least


@jit
def _blocked(case: _Case, pose: Pose) -> bool:
    """Whether something stands in the way of the outline."""
    middle = _distance(case.field, pose.x, pose.y)
    if middle > case.reach + case.still:
        return False
    return middle < 0.9 * case.inner or _room(case, pose) < case.still


class _Way(NamedTuple):
    """A motion as far as it is foretold."""

    pose: Pose
    twist: Twist
    t: float
    """Since now [s]."""
    risk: float
    """So far [m]."""
    cost: float
    """Of the whole, once it has ended; before, -1 [m]."""


@jit
def _leg(
    case: _Case, way: _Way, to: Twist, until: float, limits: Limits, e: EvasionParams, most: float
) -> _Way:  # fmt: skip
    """The motion with a twist asked for until then; it ends with a touch, or where it can not go
    on. What risks more than `most` ends too."""
    pose, twist, t, risk = way.pose, way.twist, way.t, way.risk
    while t < until - 0.5 * _H:
        before, here, spare = twist, pose, 1.0
        twist = achievable(to, before, limits, _H)
        pose = arc(here, twist, _H)
        t += _H
        if t <= e.certified_for:
            spare = _spare(case.movers, case.outline, case.reach, pose, twist, t, limits, e)
            spare -= e.static_clearance
            if spare <= 0.0:  # the filter brakes, for now
                twist = braked(before, limits, _H)
                pose = arc(here, twist, _H)
        if _blocked(case, pose):  # it stops before, and is stood there when others come
            return _Way(here, twist, t, risk, _waiting(case, here, t - _H, risk, e) + 0.5)
        uneasy, g = _risk(case, pose, t, e)
        risk += e.risk_weight * _H * uneasy
        if g <= 0.0:
            cost = _TOUCH * (e.horizon - t + 2.0 * _H) + 10.0 * abs(twist.v) + risk
            return _Way(pose, twist, t, risk, cost + 0.05 * _to_go(case, pose))
        if t <= e.certified_for:
            least = e.slack + e.slack_growth * t
            if spare < least:
                short = 1.0 - max(spare, 0.0) / least
                risk += e.risk_weight * _H * short * short
        if risk > most:
            return _Way(pose, twist, t, risk, math.inf)
    return _Way(pose, twist, t, risk, -1.0)


@jit
def _spare(
    movers: Floats, outline: Floats, reach: float, pose: Pose, twist: Twist, t: float,
    limits: Limits, e: EvasionParams,
) -> float:  # fmt: skip
    """What is left between robot and movers when it has stopped from there, whatever they did of
    what the filter takes them to be capable of [m]."""
    takes = brake_steps(twist, limits, _H) * _H
    there = arc(pose, twist, coasting(twist, limits, _H))
    return _clearance(movers, outline, reach, there, t + takes, 1.0, e.certified_growth, takes)


@jit
def _waiting(case: _Case, pose: Pose, since: float, risk: float, e: EvasionParams) -> float:
    """The cost of standing from then on."""
    t = since
    while t < e.horizon:
        t += _H
        uneasy, g = _risk(case, pose, t, e)
        risk += e.risk_weight * _H * uneasy
        if g <= 0.0:
            return _TOUCH * (e.horizon - t + 2.0 * _H) + risk
    return _to_go(case, pose) + risk


@jit
def _to_go(case: _Case, pose: Pose) -> float:
    """About how far it is from there to the end of the course ahead [m]."""
    least = math.inf
    for i in range(len(case.way)):
        dx, dy = case.way[i, 0] - pose.x, case.way[i, 1] - pose.y
        least = min(least, case.way[i, 2] + 1.2 * math.sqrt(dx * dx + dy * dy))
    return least


@jit
def _best(
    was: Evasion, case: _Case, pose: Pose, twist: Twist, around: Surroundings,
    limits: Limits, rules: Rules, e: EvasionParams,
) -> Evasion:  # fmt: skip
    """The cheapest motion that the filter lets begin.

    Those that promise most are looked at first; what can not come near the best so far is not
    looked at at all.
    """
    motions, firsts = _motions(was, limits, e)
    fees = _fees(motions, was.on, e)
    floors = _floors(case, pose, twist, motions, firsts, was.on, limits, e) + fees
    costs = np.full(len(motions), math.inf)
    start = _Way(pose, twist, 0.0, 0.0, -1.0)
    ways: list[_Way] = [start] * len(motions)
    known, best = np.zeros(len(motions), dtype=np.bool_), math.inf
    order: Ints = np.argsort(floors)
    for j in range(len(order)):
        i = int(order[j])
        most, k, m = best + _NEARLY - floors[i], int(firsts[i]), motions[i]
        if most < 0.0:
            break
        if not known[k]:
            ways[k] = _leg(case, start, Twist(m[0], m[1]), m[4], limits, e, most)
            known[k] = True
        costs[i] = _whole(case, ways[k], Twist(m[2], m[3]), limits, e, most) + fees[i]
        best = min(best, costs[i])
    chosen = _certified(costs, motions, pose, twist, case, around, limits, rules)
    now, row = _now(motions[chosen]), motions[chosen]
    return Evasion(True, now.v, now.omega, row[3], row[4], row[2], _steps(e, rules) - 1)


@jit
def _motions(was: Evasion, limits: Limits, e: EvasionParams) -> tuple[Floats, Ints]:
    """(n, 5): v and omega of the first piece and of the second, and when that begins [s]; what is
    being done already comes first. And for each the first motion that begins with the same piece.
    """
    speed, turn = min(e.speed, limits.speed), min(e.yaw_rate, limits.yaw_rate)
    motions = np.empty((len(_SPEEDS) * len(_TURNINGS) * 3 + 1, 5))
    firsts = np.zeros(len(motions), dtype=np.int64)
    n = 0
    if was.on:
        turns = max(was.turns - e.period, 0.0)
        _put(motions, n, was.v, was.omega, was.after, was.then, turns)
        n = 1
    for a in _SPEEDS:
        for b in _TURNINGS:
            v, omega, first = a * speed, b * turn, n
            for after in range(3):  # goes on, goes straight on, stops
                if (after == 1 and b == 0.0) or (after == 2 and a == 0.0):
                    continue
                v2, omega2 = (v if after < 2 else 0.0), (omega if after == 0 else 0.0)
                _put(motions, n, v, omega, v2, omega2, _TURNS)
                firsts[n] = first
                n += 1
    return motions[:n], firsts[:n]


@jit
def _fees(motions: Floats, keeps: bool, e: EvasionParams) -> Floats:
    """What each motion costs beside where it leads and what it risks [m]."""
    fees = np.empty(len(motions))
    for i in range(len(motions)):
        fees[i] = _fee(motions[i, 0], motions[i, 1])
    if keeps:
        fees[0] -= e.hysteresis
    return fees


@jit
def _floors(
    case: _Case, pose: Pose, twist: Twist, motions: Floats, firsts: Ints, keeps: bool,
    limits: Limits, e: EvasionParams,
) -> Floats:  # fmt: skip
    """What each motion costs at least, if nothing is in its way [m]; that of what is being done is
    -inf, for it is looked at first."""
    floors, there = np.empty(len(motions)), (pose, twist)
    for i in range(len(motions)):
        m = motions[i]
        if firsts[i] == i:
            there = _freely(pose, twist, Twist(m[0], m[1]), m[4], limits)
        end = _freely(there[0], there[1], Twist(m[2], m[3]), e.horizon - m[4], limits)[0]
        floors[i] = _to_go(case, end) - _ABOUT
    if keeps:
        floors[0] = -math.inf
    return floors


@jit
def _freely(
    pose: Pose, twist: Twist, to: Twist, lasts: float, limits: Limits
) -> tuple[Pose, Twist]:
    """About where a twist that is asked for leads."""
    while lasts > 1e-6:
        step = min(lasts, _STRIDE)
        twist = achievable(to, twist, limits, step)
        pose = arc(pose, twist, step)
        lasts -= step
    return pose, twist


@jit
def _certified(
    costs: Floats, motions: Floats, pose: Pose, twist: Twist, case: _Case, around: Surroundings,
    limits: Limits, rules: Rules,
) -> int:  # fmt: skip
    """The cheapest motion of the best few whose first step the filter lets pass; where there is
    none, the cheapest of all. Overwrites the costs."""
    first = int(np.argmin(costs))
    for _ in range(_TRIES):
        i = int(np.argmin(costs))
        command = achievable(_now(motions[i]), twist, limits, rules.dt)
        m = manoeuvre(pose, command, limits, rules.dt, case.reach)
        if in_the_way(m, case.outline, case.reach, around, rules.hard_margin) == CLEAR:
            return i
        costs[i] = math.inf
    return first


@jit_inline
def _fee(v: float, omega: float) -> float:
    """Turning and backing are only for a reason [m]."""
    return 0.03 * abs(omega) + (0.1 if v < 0.0 else 0.0)


@jit
def _whole(
    case: _Case, way: _Way, to: Twist, limits: Limits, e: EvasionParams, most: float
) -> float:  # fmt: skip
    """The cost of a motion that goes on with a twist to the horizon."""
    if way.cost >= 0.0:
        return way.cost
    if way.risk > most:
        return math.inf
    way = _leg(case, way, to, e.horizon, limits, e, most)
    return way.cost if way.cost >= 0.0 else way.risk + _to_go(case, way.pose)


@jit
def _put(
    motions: Floats, n: int, v: float, omega: float, after: float, then: float, turns: float
) -> None:
    motions[n, 0], motions[n, 1] = v, omega
    motions[n, 2], motions[n, 3], motions[n, 4] = after, then, turns


@jit
def _now(row: Floats) -> Twist:
    return Twist(row[0], row[1]) if row[4] > 0.0 else Twist(row[2], row[3])
