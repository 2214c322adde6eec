"""People in the twin's world: on their way, or held up by the robot and finding theirs round it."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.robot.footprint import disc_clearance
from cohelm.sim.duel import choose, walk_on
from cohelm.sim.world import World, place

STROLL = 0.4
"""Speed at which a mover goes round the robot [m/s]."""
AGILITY = 1.0
"""Largest acceleration of a mover that was held up, but for the bump itself [m/s^2]."""
_HURRY = 1.25  # a mover that was held up goes so many times as fast until it is back on its way
_PULL = 1.0  # how strongly it wants back [1/s]
_BESIDE = 0.02  # gap with which it goes round the robot [m]
_NEAR = 0.15  # nearer than this, it does not walk towards the robot [m]
_BACK = 0.005  # nearer to where it should be than this [m], it is back on its way


_KEEPS = 0.2  # for which an attacker keeps what it does [s]


class Movers(NamedTuple):
    """Discs that move. One that bumps into the robot stops, finds its way round it, slowly and
    with no more acceleration than AGILITY, and then makes up for the time it lost."""

    which: Ints
    """(m,) rows of the discs."""
    paths: World
    """Every disc as a world of its own."""
    held: Floats
    """(m, 4): whether it is off its way (1) or not (0), on which side it goes round the robot
    (1 left, -1 right, 0 does not), and its velocity [m/s]."""
    hunt: Hunt


class Hunt(NamedTuple):
    """Movers that have no way of their own: attackers, as in `sim.duel`. One that bumps into the
    robot stops, until it turns to go elsewhere."""

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
    step: float, time: float, pose: Pose, outline: Floats, discs: Floats, movers: Movers,
    mocap: Floats,
) -> float:  # fmt: skip
    """Movers on to `time`, one step; the farthest way of any [m]. Written to discs and mocap."""
    farthest = 0.0
    for m in range(len(movers.which)):
        i, held = movers.which[m], movers.held[m]
        x, y, radius = discs[i, X], discs[i, Y], discs[i, RADIUS]
        if movers.hunt.agility[m] > 0.0:
            _hunt(step, time, pose, outline, m, discs[i], movers.hunt)
            farthest = max(farthest, math.hypot(discs[i, X] - x, discs[i, Y] - y))
            mocap[m, 0], mocap[m, 1] = discs[i, X], discs[i, Y]
            continue
        place(discs[i : i + 1], i, movers.paths, time)
        gap = disc_clearance(pose, outline, x, y, radius)
        if held[_OFF] == 0.0 and gap <= 0.0:
            deeper = disc_clearance(pose, outline, discs[i, X], discs[i, Y], radius) < gap
            if deeper:
                held[_OFF], held[_SIDE], held[_VX], held[_VY] = 1.0, 0.0, 0.0, 0.0
        if held[_OFF] != 0.0:
            _find(step, pose, outline, x, y, gap, discs[i], held)
        farthest = max(farthest, math.hypot(discs[i, X] - x, discs[i, Y] - y))
        mocap[m, 0], mocap[m, 1] = discs[i, X], discs[i, Y]
    return farthest


@jit
def _hunt(
    step: float, time: float, pose: Pose, outline: Floats, m: int, disc: Floats, hunt: Hunt
) -> None:
    """One step of an attacker."""
    k = int(time / _KEEPS + 1e-6)
    if k != int((time - step) / _KEEPS + 1e-6) or time < 1.5 * step:
        choose(hunt.push, m, hunt.agility[m], pose, disc, hunt.seed, k)
    after = disc.copy()
    walk_on(after, disc, hunt.push[m, 0], hunt.push[m, 1], hunt.fastest, step)
    gap = disc_clearance(pose, outline, after[X], after[Y], disc[RADIUS])
    if gap <= 0.0 and gap < disc_clearance(pose, outline, disc[X], disc[Y], disc[RADIUS]):
        disc[VX], disc[VY] = 0.0, 0.0
    else:
        disc[:] = after


@jit
def _find(
    step: float, pose: Pose, outline: Floats, x: float, y: float, gap: float, disc: Floats,
    held: Floats,
) -> None:  # fmt: skip
    """One step of a mover that is off its way; the disc holds where it should be, and then is."""
    dx, dy = disc[X] - x, disc[Y] - y
    wx, wy = disc[VX] + _PULL * dx, disc[VY] + _PULL * dy
    most = _HURRY * max(math.hypot(disc[VX], disc[VY]), STROLL)
    speed = math.hypot(wx, wy)
    if speed > most:
        wx, wy = wx * most / speed, wy * most / speed
    nx, ny = _away(pose, outline, x, y, disc[RADIUS], gap)
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
    back = math.hypot(dx, dy) < _BACK and math.hypot(disc[VX] - vx, disc[VY] - vy) < AGILITY * 0.1
    if back:
        held[_OFF] = 0.0
    else:
        disc[X], disc[Y], disc[VX], disc[VY] = x + vx * step, y + vy * step, vx, vy
    held[_VX], held[_VY] = vx, vy


@jit
def _away(
    pose: Pose, outline: Floats, x: float, y: float, radius: float, gap: float
) -> tuple[float, float]:
    """The direction, a unit vector, in which a disc gets away from the outline fastest."""
    tiny = 1e-6
    nx = disc_clearance(pose, outline, x + tiny, y, radius) - gap
    ny = disc_clearance(pose, outline, x, y + tiny, radius) - gap
    norm = math.hypot(nx, ny)
    return (nx / norm, ny / norm) if norm > 0.0 else (1.0, 0.0)
