"""People in the twin's world: on their way, or held up and finding theirs round what is in it.

They are as solid as all else: nobody walks through the robot, a wall, or anybody else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.robot.footprint import disc_clearance
from cohelm.sim.duel import choose, walk_on
from cohelm.sim.world import World, place

STROLL = 0.4
"""Speed at which a mover goes round what is in its way [m/s]."""
AGILITY = 1.0
"""Largest acceleration of a mover that was held up, but for the bump itself [m/s^2]."""
_HURRY = 1.25  # a mover that was held up goes so many times as fast until it is back on its way
_PULL = 1.0  # how strongly it wants back [1/s]
_BESIDE = 0.02  # gap with which it goes round a thing [m]
_NEAR = 0.15  # nearer than this, it does not walk towards a thing [m]
_BACK = 0.005  # nearer to where it should be than this [m], it is back on its way


_KEEPS = 0.2  # for which an attacker keeps what it does [s]


class Movers(NamedTuple):
    """Discs that move. One that bumps into the robot, a wall or another disc stops, finds its way
    round it, slowly and with no more acceleration than AGILITY, and then makes up for the time it
    lost."""

    which: Ints
    """(m,) rows of the discs."""
    paths: World
    """Every disc as a world of its own."""
    held: Floats
    """(m, 4): whether it is off its way (1) or not (0), on which side it goes round a thing
    (1 left, -1 right, 0 does not), and its velocity [m/s]."""
    hunt: Hunt


class Hunt(NamedTuple):
    """Movers that have no way of their own: attackers, as in `sim.duel`. One that bumps into
    something stops, until it turns to go elsewhere."""

    agility: Floats
    """(m,), the acceleration that each uses; 0 for one that goes its way [m/s^2]."""
    fastest: float
    """[m/s]"""
    seed: int
    push: Floats
    """(m, 2), how each accelerates at the moment [m/s^2]."""


class Hunters(NamedTuple):
    """Who of a world's discs is after the robot."""

    agility: Floats
    """(n,) of all discs, 0 for those that are not [m/s^2]."""
    fastest: float
    """[m/s]"""
    seed: int


_OFF, _SIDE, _VX, _VY = range(4)


@jit
def walk(
    step: float, time: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats,
    movers: Movers, mocap: Floats,
) -> float:  # fmt: skip
    """Movers on to `time`, one step; the farthest way of any [m]. Written to discs and mocap."""
    farthest = 0.0
    for m in range(len(movers.which)):
        i = movers.which[m]
        after = discs[i : i + 1].copy()
        if movers.hunt.agility[m] > 0.0:
            _hunt(step, time, pose, outline, discs, walls, i, m, movers.hunt, after[0])
        else:
            place(after, i, movers.paths, time)
            _go(step, pose, outline, discs, walls, i, movers.held[m], after[0])
        way = math.hypot(after[0, X] - discs[i, X], after[0, Y] - discs[i, Y])
        farthest = max(farthest, way)
        discs[i] = after[0]
        mocap[m, 0], mocap[m, 1] = discs[i, X], discs[i, Y]
    return farthest


@jit
def _hunt(
    step: float, time: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int,
    m: int, hunt: Hunt, after: Floats,
) -> None:  # fmt: skip
    """One step of attacker m, disc i, written to `after`."""
    k = int(time / _KEEPS + 1e-6)
    if k != int((time - step) / _KEEPS + 1e-6) or time < 1.5 * step:
        choose(hunt.push, m, hunt.agility[m], pose, discs[i], hunt.seed, k)
    walk_on(after, discs[i], hunt.push[m, 0], hunt.push[m, 1], hunt.fastest, step)
    was = disc_clearance(pose, outline, discs[i, X], discs[i, Y], discs[i, RADIUS])
    gap = disc_clearance(pose, outline, after[X], after[Y], discs[i, RADIUS])
    into = gap <= 0.0 and gap < was
    if into or _bumps(pose, outline, discs, walls, i, after[X], after[Y]):
        after[:] = discs[i]
        after[VX] = after[VY] = 0.0


@jit
def _go(
    step: float, pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, held: Floats,
    after: Floats,
) -> None:  # fmt: skip
    """One step of disc i; `after` holds where it should be then, and where it is."""
    bumps = _bumps(pose, outline, discs, walls, i, after[X], after[Y])
    if held[_OFF] == 0.0:
        if not bumps:
            return
        held[_OFF], held[_SIDE], held[_VX], held[_VY] = 1.0, 0.0, 0.0, 0.0
    x, y = discs[i, X], discs[i, Y]
    dx, dy = after[X] - x, after[Y] - y
    wx, wy = after[VX] + _PULL * dx, after[VY] + _PULL * dy
    most = _HURRY * max(math.hypot(after[VX], after[VY]), STROLL)
    speed = math.hypot(wx, wy)
    if speed > most:
        wx, wy = wx * most / speed, wy * most / speed
    gap, nx, ny = _nearest(pose, outline, discs, walls, i)
    if gap < _NEAR and nx * wx + ny * wy < 0.0:
        if held[_SIDE] == 0.0:  # chosen once: behind a flat front both sides look the same
            held[_SIDE] = 1.0 if nx * wy - ny * wx >= 0.0 else -1.0
        out = min(max(2.0 * (_BESIDE - gap), -0.2), 0.2)
        wx = -ny * held[_SIDE] * STROLL + nx * out
        wy = nx * held[_SIDE] * STROLL + ny * out
    else:
        held[_SIDE] = 0.0
    ax, ay = wx - held[_VX], wy - held[_VY]
    change = math.hypot(ax, ay)
    share = min(AGILITY * step / change, 1.0) if change > 0.0 else 0.0
    vx, vy = held[_VX] + share * ax, held[_VY] + share * ay
    into = nx * vx + ny * vy
    if gap <= 0.0 and into < 0.0:  # it bumps again
        vx, vy = vx - into * nx, vy - into * ny
    near = math.hypot(dx, dy) < _BACK
    if near and not bumps and math.hypot(after[VX] - vx, after[VY] - vy) < AGILITY * 0.1:
        held[_OFF] = 0.0
    else:
        if _bumps(pose, outline, discs, walls, i, x + vx * step, y + vy * step):
            vx, vy = 0.0, 0.0  # between two things
            held[_SIDE] = -held[_SIDE]
        after[X], after[Y], after[VX], after[VY] = x + vx * step, y + vy * step, vx, vy
    held[_VX], held[_VY] = vx, vy


@jit
def _bumps(
    pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int, x: float, y: float
) -> bool:
    """Whether disc i, on its way to there, comes deeper into the robot, which it may touch, or into
    a wall or another disc."""
    was_x, was_y, radius = discs[i, X], discs[i, Y], discs[i, RADIUS]
    gap = disc_clearance(pose, outline, was_x, was_y, radius)
    if gap <= 0.0 and disc_clearance(pose, outline, x, y, radius) < gap:
        return True
    for j in range(len(discs)):
        if j != i:
            gap = math.hypot(x - discs[j, X], y - discs[j, Y])
            before = math.hypot(was_x - discs[j, X], was_y - discs[j, Y])
            if gap <= radius + discs[j, RADIUS] and gap < before:
                return True
    for w in range(len(walls)):
        gap = _from_wall(walls[w], x, y)[0]
        if gap <= radius and gap < _from_wall(walls[w], was_x, was_y)[0]:
            return True
    return False


@jit
def _nearest(
    pose: Pose, outline: Floats, discs: Floats, walls: Floats, i: int
) -> tuple[float, float, float]:
    """Gap of disc i to what is nearest [m], and the direction away from that, a unit vector."""
    x, y, radius = discs[i, X], discs[i, Y], discs[i, RADIUS]
    gap = disc_clearance(pose, outline, x, y, radius)
    tiny = 1e-6
    nx = disc_clearance(pose, outline, x + tiny, y, radius) - gap
    ny = disc_clearance(pose, outline, x, y + tiny, radius) - gap
    for j in range(len(discs)):
        if j != i:
            wx, wy = x - discs[j, X], y - discs[j, Y]
            other = math.hypot(wx, wy) - radius - discs[j, RADIUS]
            if other < gap:
                gap, nx, ny = other, wx, wy
    for w in range(len(walls)):
        far, wx, wy = _from_wall(walls[w], x, y)
        if far - radius < gap:
            gap, nx, ny = far - radius, wx, wy
    norm = math.hypot(nx, ny)
    return (gap, nx / norm, ny / norm) if norm > 0.0 else (gap, 1.0, 0.0)


@jit_inline
def _from_wall(wall: Floats, x: float, y: float) -> tuple[float, float, float]:
    """Distance of a point from a wall [m], and the vector from its nearest point."""
    ex, ey = wall[2] - wall[0], wall[3] - wall[1]
    wx, wy = x - wall[0], y - wall[1]
    length = ex * ex + ey * ey
    s = min(max((wx * ex + wy * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
    wx, wy = wx - s * ex, wy - s * ey
    return math.hypot(wx, wy), wx, wy
