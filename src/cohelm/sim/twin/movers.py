"""People in the twin's world: on their way, or held up by the robot and finding theirs round it."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.robot.footprint import disc_clearance
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
