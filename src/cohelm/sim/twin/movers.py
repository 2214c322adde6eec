"""Movers in the twin's world: on their paths, or held up and going round what is in the way.

They are as solid as all else: none walks through the robot, a wall, or another mover.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.robot.clearance import disc_clearance
from cohelm.sim.adversarial import choose, walk_on
from cohelm.sim.world import World, from_wall, place_one

STROLL = 0.4
"""Speed at which a mover goes round what is in its way [m/s]."""
MAX_ACCELERATION = 1.0
"""Largest acceleration of a mover that is held up, but for a bump [m/s^2]."""
_HURRY = 1.25  # a mover that was held up goes so many times as fast until it is back on its way
_PULL = 1.0  # how strongly it wants back [1/s]
_REACTION = 0.05  # it brakes for another disc so much earlier than it has to [s]
_BERTH = 0.15  # nearer than this to another disc, half the gap counts as touched: both may turn [m]
_BESIDE = 0.02  # gap with which it goes round a thing [m]
_NEAR = 0.15  # nearer than this, it does not walk towards a thing [m]
_INSIDE = 0.02  # one that starts deeper within a thing than this comes out of it unhindered [m]
_BACK = 0.005  # nearer to where it should be than this [m],
_STEADY = 0.02  # and as fast but for this [m/s], it is back on its way


_KEEPS = 0.2  # for which an attacker keeps what it does [s]
_LOOKS = 0.1  # apart an attacker looks along its way to where it would stop, [m]
_GRAZES = 0.005  # and so near is too near: between two looks it may come nearer by half of that [m]


class MovingDiscs(NamedTuple):
    """Discs that move. One brakes for another disc; into the robot or a wall it bumps, and stops
    dead. Then it finds its way round, slowly, and makes up for the time it lost: all but the bump
    with no more than MAX_ACCELERATION."""

    which: Ints
    """(m,) rows of the discs."""
    paths: World
    """Every disc as a world of its own."""
    held: Floats
    """(m, 5): whether it is off its way (1) or not (0), on which side it goes round things
    (1 left, -1 right, 0 does not), its velocity [m/s], and what it goes round."""
    hunt: Pursuit


class Pursuit(NamedTuple):
    """Movers without a path of their own: attackers, as in `sim.adversarial`. They go for the
    robot, and brake before all else, within the motion assumed of them. Only two that run into each
    other, or into the robot, stop dead."""

    max_acceleration: Floats
    """(m,), the acceleration that each uses; 0 for one that goes its way [m/s^2]."""
    fastest: float
    """[m/s]"""
    seed: int
    push: Floats
    """(m, 2), how each accelerates at the moment [m/s^2]."""


class Pursuers(NamedTuple):
    """Which of a world's discs pursue the robot."""

    max_acceleration: Floats
    """(n,) of all discs, 0 for those that are not [m/s^2]."""
    fastest: float
    """[m/s]"""
    seed: int


_OFF, _SIDE, _VX, _VY, _ROUND = range(5)
_NOTHING, _ROBOT = -1, 0  # things by number: then discs, then walls


@jit
def walk(
    step: float, time: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats,
    movers: MovingDiscs, mocap: Floats,
) -> float:  # fmt: skip
    """Movers on to `time`, one step; the farthest way of any [m]. Written to discs and mocap."""
    farthest = 0.0
    for m in range(len(movers.which)):
        i = movers.which[m]
        after = discs[i : i + 1].copy()
        if movers.hunt.max_acceleration[m] > 0.0:
            _hunt(step, time, pose, outline, discs, walls, i, m, movers.hunt, after[0])
        else:
            place_one(after[0], i, movers.paths, time)
            _go(step, pose, outline, discs, walls, i, movers.held[m], after[0])
        way = math.hypot(after[0, X] - discs[i, X], after[0, Y] - discs[i, Y])
        farthest = max(farthest, way)
        discs[i] = after[0]
        mocap[m, 0], mocap[m, 1] = discs[i, X], discs[i, Y]
    return farthest


@jit
def _hunt(
    step: float, time: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int,
    m: int, hunt: Pursuit, after: Floats,
) -> None:  # fmt: skip
    """One step of attacker m, disc i, written to `after`."""
    k = int(time / _KEEPS + 1e-6)
    if k != int((time - step) / _KEEPS + 1e-6) or time < 1.5 * step:
        choose(hunt.push, m, hunt.max_acceleration[m], pose, discs[i], hunt.seed, k)
    most = hunt.max_acceleration[m]
    walk_on(after, discs[i], hunt.push[m, 0], hunt.push[m, 1], hunt.fastest, step)
    if not _stops_before(pose, outline, discs, walls, i, after, most):
        speed = math.hypot(discs[i, VX], discs[i, VY])
        push = -min(most, speed / step) / max(speed, 1e-9)
        walk_on(after, discs[i], push * discs[i, VX], push * discs[i, VY], hunt.fastest, step)
    if _bumps(pose, outline, discs, walls, i, after[X], after[Y]) != _NOTHING:
        after[:] = discs[i]
        after[VX] = after[VY] = 0.0


@jit
def _stops_before(
    pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, after: Floats, most: float
) -> bool:  # fmt: skip
    """Whether disc i, as it is `after` a step, can stop before all that is not the robot, slowing
    down by at most so much [m/s^2]."""
    speed = math.hypot(after[VX], after[VY])
    n = math.ceil(speed * speed / (2.0 * most) / _LOOKS) + 1
    for k in range(n):
        time = (k + 1) / n * speed / (2.0 * most)
        x, y = after[X] + time * after[VX], after[Y] + time * after[VY]
        if _bumps(pose, outline, discs, walls, i, x, y, _ROBOT + 1, _GRAZES) != _NOTHING:
            return False
    return True


@jit
def _go(
    step: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, held: Floats,
    after: Floats,
) -> None:  # fmt: skip
    """One step of disc i; `after` holds where it should be then, and where it is."""
    x, y = discs[i, X], discs[i, Y]
    bumps = _bumps(pose, outline, discs, walls, i, after[X], after[Y])
    if held[_OFF] == 0.0:
        touches = (
            bumps == _ROBOT and _clearance(pose, outline, discs, walls, i, x, y, _ROBOT)[0] > 0.0
        )
        goes_on = bumps == _NOTHING or touches
        meets = _meets(discs, i, discs[i, VX], discs[i, VY])
        if goes_on and meets == _NOTHING:
            return
        held[:] = 0.0
        held[_OFF], held[_ROUND] = 1.0, bumps
        if goes_on:
            held[_ROUND], held[_VX], held[_VY] = meets, discs[i, VX], discs[i, VY]
    dx, dy = after[X] - x, after[Y] - y
    wx, wy = after[VX] + _PULL * dx, after[VY] + _PULL * dy
    most = _HURRY * max(math.hypot(after[VX], after[VY]), STROLL)
    speed = math.hypot(wx, wy)
    if speed > most:
        wx, wy = wx * most / speed, wy * most / speed
    clearance, nx, ny = _clearance(pose, outline, discs, walls, i, x, y, int(held[_ROUND]))
    if clearance >= _NEAR or nx * wx + ny * wy >= 0.0:  # that one is no longer in the way
        held[_SIDE], held[_ROUND] = 0.0, _nearest(pose, outline, discs, walls, i)
        clearance, nx, ny = _clearance(pose, outline, discs, walls, i, x, y, int(held[_ROUND]))
    if clearance < _NEAR and nx * wx + ny * wy < 0.0:
        if held[_SIDE] == 0.0:  # chosen once: behind a flat front both sides look the same
            held[_SIDE] = 1.0 if nx * wy - ny * wx >= 0.0 else -1.0
        out = min(max(2.0 * (_BESIDE - clearance), -0.2), 0.2)
        wx = -ny * held[_SIDE] * STROLL + nx * out
        wy = nx * held[_SIDE] * STROLL + ny * out
    ax, ay = wx - held[_VX], wy - held[_VY]
    change = math.hypot(ax, ay)
    share = min(MAX_ACCELERATION * step / change, 1.0) if change > 0.0 else 0.0
    vx, vy = held[_VX] + share * ax, held[_VY] + share * ay
    meets = _meets(discs, i, vx, vy)
    if meets != _NOTHING:
        speed = math.hypot(held[_VX], held[_VY])
        share = max(1.0 - MAX_ACCELERATION * step / max(speed, 1e-9), 0.0)
        vx, vy = share * held[_VX], share * held[_VY]
        if held[_SIDE] == 0.0:
            held[_ROUND] = meets
        elif share == 0.0 and meets != held[_ROUND]:  # no way through there
            held[_SIDE] = -held[_SIDE]
    into = nx * vx + ny * vy
    if clearance <= 0.0 and into < 0.0:  # it bumps again
        vx, vy = vx - into * nx, vy - into * ny
    steady = math.hypot(after[VX] - vx, after[VY] - vy) < _STEADY
    if max(bumps, meets) == _NOTHING and steady and math.hypot(dx, dy) < _BACK:
        held[_OFF] = 0.0
    else:
        other = _bumps(pose, outline, discs, walls, i, x + vx * step, y + vy * step)
        if other != _NOTHING:
            vx, vy = 0.0, 0.0
            if other != held[_ROUND]:  # no way through there: round on the other side
                held[_SIDE] = -held[_SIDE]
        after[X], after[Y], after[VX], after[VY] = x + vx * step, y + vy * step, vx, vy
    held[_VX], held[_VY] = vx, vy


@jit
def _meets(discs: Floats, i: int, vx: float, vy: float) -> int:
    """Another disc for which disc i, with this velocity, has to brake now: one that it would touch,
    if both went straight on, before it could stop; else none."""
    time = 0.5 * math.hypot(vx, vy) / MAX_ACCELERATION + _REACTION
    for j in range(len(discs)):
        wx, wy = discs[j, X] - discs[i, X], discs[j, Y] - discs[i, Y]
        ux, uy = vx - discs[j, VX], vy - discs[j, VY]
        reach = discs[i, RADIUS] + discs[j, RADIUS]
        gap = math.hypot(wx, wy) - reach
        reach += 0.5 * min(max(gap, 0.0), _BERTH)
        closing, square = wx * ux + wy * uy, ux * ux + uy * uy
        apart = wx * wx + wy * wy - reach * reach
        room = closing * closing - square * apart
        nears = j != i and gap > 0.0 and closing > 0.0 and room > 0.0
        if nears and apart < time * (closing + math.sqrt(room)):  # of two roots the earlier
            return j + 1
    return _NOTHING


@jit
def _bumps(
    pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, x: float, y: float,
    first: int = _ROBOT, gap: float = 0.0,
) -> int:  # fmt: skip
    """What disc i comes into if it goes there: what it is nearer to then than now, and touches.

    first: the first of the things that count. gap: so near is as good as touched [m].
    """
    was_x, was_y = discs[i, X], discs[i, Y]
    for obstacle in range(first, 1 + len(discs) + len(walls)):
        clearance = _clearance(pose, outline, discs, walls, i, x, y, obstacle)[0]
        if clearance <= gap:
            before = _clearance(pose, outline, discs, walls, i, was_x, was_y, obstacle)[0]
            if before > max(clearance, -_INSIDE):
                return obstacle
    return _NOTHING


@jit
def _nearest(pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int) -> int:
    best, least = _ROBOT, math.inf
    x, y = discs[i, X], discs[i, Y]
    for obstacle in range(1 + len(discs) + len(walls)):
        clearance = _clearance(pose, outline, discs, walls, i, x, y, obstacle)[0]
        if -_INSIDE < clearance < least:
            best, least = obstacle, clearance
    return best


@jit
def _clearance(
    pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, x: float, y: float,
    obstacle: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Gap of disc i, at a place, to a thing [m], and the unit vector that leads away from it."""
    radius = discs[i, RADIUS]
    if obstacle == _ROBOT:
        clearance, tiny = disc_clearance(pose, outline, x, y, radius), 1e-6
        wx = disc_clearance(pose, outline, x + tiny, y, radius) - clearance
        wy = disc_clearance(pose, outline, x, y + tiny, radius) - clearance
        far = math.hypot(wx, wy)
    elif obstacle <= len(discs):
        other = discs[obstacle - 1]
        wx, wy = x - other[X], y - other[Y]
        far = math.hypot(wx, wy)
        clearance = far - radius - other[RADIUS] if obstacle - 1 != i else math.inf
    else:
        wx, wy = from_wall(Pose(x, y, 0.0), walls, obstacle - 1 - len(discs))
        far = math.hypot(wx, wy)
        clearance = far - radius
    return (clearance, wx / far, wy / far) if far > 0.0 else (clearance, 1.0, 0.0)
