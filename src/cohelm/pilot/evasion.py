"""Evades moving obstacles: goes round, lets pass, backs off or steps aside, a few seconds ahead.

The safety filter promises that the robot hits nothing while it moves, and stands where it can not
promise that; so it can be walked into. Here the command that the filter is given is chosen such
that this rarely comes to pass. First the course is foretold as it would be driven. Only if somebody
would be met on it, arcs of two pieces are sampled over forward, backward, turning and waiting (the
dynamic window approach of Fox, Burgard and Thrun 1997, with time), and each is held against where
everybody will be, at constant velocity and with growing doubt. The best one whose first step the
filter certifies is asked for. It is a nominal command as any other: the filter has the last word.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.gains import Gains
from cohelm.law.govern import Clock, Pace, govern, governed
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.certify import CLEAR, in_the_way, manoeuvre
from cohelm.law.guard.contact import gap
from cohelm.law.guard.step import Rules, farthest
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.track import track
from cohelm.pilot.course import Course, window
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, achievable

_H = 0.1  # from one look along a foretold motion to the next [s]
_CELL = 0.06  # of the grid of what stands [m]
_FARTHEST = 6.0  # what stands farther away than this is not looked at [m]
_EDGE = 0.08  # between two points of the outline that are held against it [m]
_TRIES = 6  # so many of the best are tried for one that is certified
_SPEEDS = (1.0, 0.75, 0.5, 0.25, 0.0, -0.5, -1.0)
_TURNINGS = (0.0, 0.15, -0.15, 0.35, -0.35, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0)
"""Shares of the largest speed and yaw rate that are tried."""
_NEARLY = 0.4  # what is so much worse than the best is not looked at to its end [m]
_TURNS = 1.0  # the first piece of an arc [s]


class EvasionParams(NamedTuple):
    """How moving obstacles are evaded."""

    horizon: float = 0.0
    """How far ahead is looked, say 3; 0: nobody is evaded [s]."""
    period: float = 0.1
    """From one look to the next [s]."""
    speed: float = 0.8
    """Largest speed of an evasion [m/s]."""
    yaw_rate: float = 1.6
    """Largest yaw rate of one [rad/s]."""
    clearance: float = 0.1
    """Least clearance to where a moving obstacle may be [m]."""
    standing_growth: float = 0.05
    growth_per_speed: float = 0.25
    most_growth: float = 0.3
    """Doubt of where it will be grows by the first, and by the second for each m/s of its speed,
    but by no more than the third [m/s]: who stands, sways; who walks, turns."""
    social_clearance: float = 0.4
    """Clearance below which the course is not simply followed [m]."""
    comfortable: float = 0.6
    """Clearance from which more is not better [m]."""
    clearance_weight: float = 0.8
    """How far the robot goes out of its way for each metre of that."""
    hysteresis: float = 0.15
    """How much better than what is being done something else has to be [m]."""
    static_clearance: float = 0.03
    """Clearance to what stands [m]."""
    certified_for: float = 3.0
    """For so long the filter must find a way to stop at every moment of a motion [s]."""
    pass_right: float = 0.0
    """How much wider movers are taken to be on the robot's left, so that it passes them on the
    right, as the paper's k_CBF does [m]."""


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
    left: int
    """Steps until the next look."""


NO_EVASION = Evasion(False, 0.0, 0.0, 0.0, 0.0, 0)


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
    """(m, 7): x, y, vx, vy, radius, the acceleration that the filter takes it to be capable of, and
    how fast doubt of where it is grows."""
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
    outline: Floats, limits: Limits, gains: Gains, rules: Rules, pace: Pace, e: EvasionParams,
) -> Evasion:  # fmt: skip
    """What to do about moving obstacles, from now on for `e.period`.

    pose, twist: when the next command takes effect; around: as of then.
    """
    if was.left > 0:
        return Evasion(was.on, was.v, was.omega, was.then, was.turns, was.left - 1)
    reach = farthest(outline)
    movers = _movers(around, pose, reach, e)
    if len(movers) == 0:
        return Evasion(False, 0.0, 0.0, 0.0, 0.0, _steps(e, rules) - 1)
    if _follows(movers, pose, twist, course, clock, outline, reach, limits, gains, pace, e):
        return Evasion(False, 0.0, 0.0, 0.0, 0.0, _steps(e, rules) - 1)
    case = _case(movers, around, pose, course, clock, outline, reach, e)
    return _best(was, case, pose, twist, around, limits, rules, e)


@jit
def _steps(e: EvasionParams, rules: Rules) -> int:
    """Control steps from one look to the next."""
    return max(int(e.period / rules.dt + 0.5), 1)


@jit
def _movers(around: Surroundings, pose: Pose, reach: float, e: EvasionParams) -> Floats:
    """Those that could matter within the horizon."""
    found = np.empty((2 * len(around.discs), 7))
    n = 0
    for i in range(len(around.discs)):
        d = around.discs[i]
        vx, vy = d[VX], d[VY]
        if vx == 0.0 and vy == 0.0 and around.agility[i] == 0.0:
            continue
        far = math.hypot(d[X] - pose.x, d[Y] - pose.y) - d[RADIUS] - reach
        if not far < (math.hypot(vx, vy) + e.speed) * e.horizon + e.comfortable:
            continue
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = d[X], d[Y], vx, vy
        found[n, 4], found[n, 5] = d[RADIUS], around.agility[i]
        found[n, 6] = min(
            e.standing_growth + e.growth_per_speed * math.hypot(vx, vy), e.most_growth
        )
        n += 1
        if e.pass_right > 0.0 and far < math.inf:
            found[n] = found[n - 1]
            away = math.hypot(d[X] - pose.x, d[Y] - pose.y)
            share = e.pass_right / max(away, 1e-9)
            found[n, 0] -= share * (d[Y] - pose.y)
            found[n, 1] += share * (d[X] - pose.x)
            n += 1
    return found[:n]


@jit
def _clearance(
    movers: Floats, outline: Floats, reach: float, pose: Pose, t: float, most: float,
    agile: float = 0.0,
) -> float:  # fmt: skip
    """Least clearance of the outline to where the movers may be after t, at most `most` [m].

    agile: for so long they may have done anything that they are capable of [s].
    """
    least = most
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    for i in range(len(movers)):
        dx = movers[i, 0] + movers[i, 2] * t - pose.x
        dy = movers[i, 1] + movers[i, 3] * t - pose.y
        r = movers[i, 4] + 0.5 * movers[i, 5] * agile * agile + movers[i, 6] * t
        far = least + reach + r
        if dx * dx + dy * dy < far * far:
            least = min(least, gap(outline, c * dx + s * dy, -s * dx + c * dy) - r)
    return least


@jit
def _follows(
    movers: Floats, pose: Pose, twist: Twist, course: Course, clock: Clock, outline: Floats,
    reach: float, limits: Limits, gains: Gains, pace: Pace, e: EvasionParams,
) -> bool:  # fmt: skip
    """Whether following the course as it is meets nobody within the horizon."""
    t = 0.0
    while t < e.horizon:
        if _clearance(movers, outline, reach, pose, t, 9.0) < e.social_clearance:
            return False
        if t <= e.certified_for and not _certified(
            movers, outline, reach, pose, twist, t, limits, e
        ):
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


@jit
def _rolled(
    case: _Case, pose: Pose, twist: Twist, first: Twist, then: Twist, turns: float,
    limits: Limits, e: EvasionParams, bound: float,
) -> float:  # fmt: skip
    """The cost of asking for one twist for a while and then for another, at least `bound` if
    it is not the best."""
    t, near, look = 0.0, e.comfortable, 0.8
    fee = 0.03 * abs(first.omega) + (0.1 if first.v < 0.0 else 0.0)
    while t < e.horizon:
        twist = achievable(first if t < turns else then, twist, limits, _H)
        here, pose = pose, arc(pose, twist, _H)
        t += _H
        if _blocked(case, pose):  # it stops before, and is stood there when others come
            return _waiting(case, here, t - _H, e) + 0.5 + fee
        g = _clearance(case.movers, case.outline, case.reach, pose, t, 2.0)
        g -= e.clearance
        if g < 0.0:
            return 100.0 * (e.horizon - t) + 10.0 * abs(twist.v) + 0.05 * _to_go(case, pose) + fee
        if t <= e.certified_for and not _certified(
            case.movers, case.outline, case.reach, pose, twist, t, limits, e
        ):  # the filter would brake from here on
            return _waiting(case, pose, t, e) + 0.5 + fee
        near = min(near, g + e.most_growth * t)
        if e.clearance_weight * (e.comfortable - near) + fee > bound:
            return math.inf
        if t >= look:  # however it goes on, it will not be as good
            look += 0.7
            if _to_go(case, pose) - 1.2 * abs(first.v) * (e.horizon - t) + fee > bound:
                return math.inf
    return _to_go(case, pose) + e.clearance_weight * (e.comfortable - near) + fee


@jit
def _certified(
    movers: Floats, outline: Floats, reach: float, pose: Pose, twist: Twist, t: float,
    limits: Limits, e: EvasionParams,
) -> bool:  # fmt: skip
    """Whether the filter will find a way to stop there that is clear of the movers."""
    takes = brake_steps(twist, limits, _H) * _H
    there = arc(pose, twist, coasting(twist, limits, _H))
    return _clearance(movers, outline, reach, there, t + takes, 1.0, takes) > e.static_clearance


@jit
def _waiting(case: _Case, pose: Pose, since: float, e: EvasionParams) -> float:
    """The cost of standing from then on."""
    t = since
    while t < e.horizon:
        t += _H
        g = _clearance(case.movers, case.outline, case.reach, pose, t, 2.0)
        if g < e.clearance:
            return 100.0 * (e.horizon - t)
    return _to_go(case, pose)


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
    was: Evasion, case: _Case, pose: Pose, twist: Twist, around: Surroundings, limits: Limits,
    rules: Rules, e: EvasionParams,
) -> Evasion:  # fmt: skip
    speed, turn = min(e.speed, limits.speed), min(e.yaw_rate, limits.yaw_rate)
    most = len(_SPEEDS) * len(_TURNINGS) * 2 + 1
    costs, sets = np.empty(most), np.empty((most, 4))
    n = 0
    if was.on:
        _put(sets, n, was.v, was.omega, was.then, max(was.turns - e.period, 0.0))
        n += 1
    for a in _SPEEDS:
        for b in _TURNINGS:
            v, omega = a * speed, b * turn
            _put(sets, n, v, omega, omega, _TURNS)
            n += 1
            if b != 0.0:
                _put(sets, n, v, omega, 0.0, _TURNS)
                n += 1
    best = math.inf
    for i in range(n):
        v, omega, after, turns = sets[i, 0], sets[i, 1], sets[i, 2], sets[i, 3]
        costs[i] = _rolled(
            case, pose, twist, Twist(v, omega), Twist(v, after), turns, limits, e, best + _NEARLY
        )
        if i == 0 and was.on:
            costs[i] -= e.hysteresis
        best = min(best, costs[i])
    first = int(np.argmin(costs[:n]))
    chosen = first
    for _ in range(_TRIES):
        i = int(np.argmin(costs[:n]))
        command = achievable(_now(sets[i]), twist, limits, rules.dt)
        m = manoeuvre(pose, command, limits, rules.dt, case.reach)
        if in_the_way(m, case.outline, case.reach, around, rules.clear) == CLEAR:
            chosen = i
            break
        costs[i] = math.inf
    now, after, turns = _now(sets[chosen]), sets[chosen, 2], sets[chosen, 3]
    return Evasion(True, now.v, now.omega, after, turns, _steps(e, rules) - 1)


@jit
def _put(sets: Floats, n: int, v: float, omega: float, then: float, turns: float) -> None:
    sets[n, 0], sets[n, 1], sets[n, 2], sets[n, 3] = v, omega, then, turns


@jit
def _now(row: Floats) -> Twist:
    return Twist(row[0], row[1] if row[3] > 0.0 else row[2])
