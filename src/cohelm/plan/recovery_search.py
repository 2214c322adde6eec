"""Searches a sequence of small arcs and turns out of a tight place, by Dijkstra over poses."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints, Pose, Twist
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.heap import pop, push
from cohelm.plan.recovery import GAIN, RecoveryMove, RecoveryParams, is_clear, kind, turns, within
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.kinematics import arc

_STEP = 0.04  # along an arc [m]
_TURN = 0.08  # and on the spot [rad]
_CELL, _SECTOR = 0.02, 0.04  # poses of one cell count as one [m, rad]
_FINENESS = (1.0, 0.25)  # of all these, tried in this order
_PLACES = 3000  # expanded at most, of each fineness
_RADIUS = 1.0  # within which the search keeps [m]
_SWITCH = 0.5  # cost of going on otherwise, in steps: few long moves are better
_TABLE = 1 << 13  # slots of the hash table of visited cells
_PARAMS = RecoveryParams()


def search_recovery(
    pose: Pose, heading: float, points: Floats, outline: Floats, params: RecoveryParams = _PARAMS,
    refused: int = 0,
) -> RecoveryMove | None:  # fmt: skip
    """The first move of the shortest sequence after which the robot can turn to `heading`; if there
    is none, of that to most clearance; None if none has more. For where no single move leads out.

    The clearance is at least `params.least`, or what it is now. heading: world frame [rad].
    points: (p, 2), dense enough for such a clearance [m]. outline: (k, 2), convex,
    counter-clockwise. refused: kinds of moves not to begin with.
    """
    reach = farthest_corner(outline)
    near = within(points, pose, _RADIUS + 2.0 * reach)
    clearance_now = float(swept_clearances(near, outline, np.array([pose]))[0])
    least = min(params.least, clearance_now - 1e-6)
    curvatures = np.array(params.curvatures)
    best, most = None, clearance_now + GAIN
    for scale in _FINENESS:
        clearance, move = _search(
            pose, heading, near, outline, reach, least, scale, curvatures, refused
        )
        if clearance > most:
            best, most = move, clearance
        if most == math.inf:  # nothing finer leads farther
            break
    return best


@jit
def _search(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, least: float,
    scale: float, curvatures: Floats, refused: int,
) -> tuple[float, RecoveryMove]:  # fmt: skip
    """The first move of the best sequence of steps of one size, and the clearance to which it
    leads; inf if the robot can turn there."""
    steps = np.zeros((2 * len(curvatures) + 2, 3))  # distance, curvature, turn
    for i in range(len(curvatures)):
        steps[2 * i, 0], steps[2 * i + 1, 0] = scale * _STEP, -scale * _STEP
        steps[2 * i, 1] = steps[2 * i + 1, 1] = curvatures[i]
    steps[-1, 2], steps[-2, 2] = scale * _TURN, -scale * _TURN
    room = _PLACES * len(steps) + 1
    poses, costs = np.empty((room, 3)), np.zeros(room)
    before, by = np.full(room, -1), np.full(room, -1)  # the pose before, and the step from there
    keys, queue, visited = np.empty(room), np.empty(room, np.int64), np.full(_TABLE, -1)
    poses[0, 0], poses[0, 1], poses[0, 2] = pose.x, pose.y, pose.psi
    expanded = np.empty(_PLACES, np.int64)
    n, m, size = 1, 0, push(keys, queue, 0, 0.0, 0)
    while size > 0 and m < _PLACES:
        k = queue[0]
        size = pop(keys, queue, size)
        at = Pose(poses[k, 0], poses[k, 1], poses[k, 2])
        if _was_visited(visited, at, scale):
            continue
        expanded[m] = k
        m += 1
        beside = within(points, at, reach + least + 2.0 * scale * _STEP)  # of its steps too
        short = wrap(heading - at.psi)
        for angle in (short, short - math.copysign(2.0 * math.pi, short)):
            allowed = k > 0 or not kind(RecoveryMove(0.0, 0.0, angle)) & refused
            if allowed and turns(at, angle, beside, outline, reach, least):
                return math.inf, _first_move(steps, before, by, k, angle)
        for i in range(len(steps)):
            step = RecoveryMove(steps[i, 0], steps[i, 1], steps[i, 2])
            if k == 0 and kind(step) & refused:
                continue
            there = _stepped(at, step, 1.0)
            if (
                math.hypot(there.x - pose.x, there.y - pose.y) > _RADIUS
                or not is_clear(beside, outline, reach, _stepped(at, step, 0.5), least)
                or not is_clear(beside, outline, reach, there, least)
            ):
                continue
            poses[n, 0], poses[n, 1], poses[n, 2] = there.x, there.y, there.psi
            costs[n] = costs[k] + 1.0 + (_SWITCH if k > 0 and by[k] != i else 0.0)
            before[n], by[n] = k, i
            size = push(keys, queue, size, costs[n], n)
            n += 1
    clearances = swept_clearances(points, outline, poses[expanded[:m]])
    best = int(np.argmax(clearances))
    return clearances[best], _first_move(steps, before, by, expanded[best], 0.0)


@jit
def _stepped(pose: Pose, step: RecoveryMove, share: float) -> Pose:
    """The pose after a share of a small arc or turn."""
    if step.distance == 0.0:
        return Pose(pose.x, pose.y, pose.psi + share * step.turn)
    return arc(pose, Twist(step.distance, step.distance * step.curvature), share)


@jit
def _first_move(steps: Floats, before: Ints, by: Ints, last: int, angle: float) -> RecoveryMove:
    """All equal steps that a sequence begins with as one move, with the turn that follows an arc.

    angle: turn at the end of the sequence [rad].
    """
    n, k = 0, last
    while before[k] >= 0:
        n, k = n + 1, before[k]
    order, k = np.empty(n, np.int64), last
    for i in range(n):
        order[n - 1 - i], k = by[k], before[k]
    i, distance, curvature, turn = 0, 0.0, 0.0, 0.0
    while i < n and order[i] == order[0] and steps[order[0], 0] != 0.0:
        distance, curvature = distance + steps[order[i], 0], steps[order[i], 1]
        i += 1
    begin = i
    while i < n and order[i] == order[begin] and steps[order[i], 0] == 0.0:
        turn += steps[order[i], 2]
        i += 1
    if i == n:
        turn += angle
    return RecoveryMove(distance, curvature, turn)


@jit
def _was_visited(table: Ints, pose: Pose, scale: float) -> bool:
    """Whether a pose of its cell was asked for before."""
    i, j = round(pose.x / (scale * _CELL)), round(pose.y / (scale * _CELL))
    m = round(pose.psi / (scale * _SECTOR))
    key = ((i & 0xFFFFF) << 40) | ((j & 0xFFFFF) << 20) | (m & 0xFFFFF)
    slot = (key * 0x1E3779B97F4A7C15 >> 20) & (len(table) - 1)
    while table[slot] != -1:
        if table[slot] == key:
            return True
        slot = (slot + 1) & (len(table) - 1)
    table[slot] = key
    return False
