"""Recovery moves (back up, spin): the shortest after which the robot can turn where it must."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.plan.distance_field import swept
from cohelm.robot.kinematics import arc

_LOOK = 0.02  # how far apart poses are looked at, of the outline's farthest corner [m]
_NEAR_ENOUGH = 0.01  # to the end of a move [m, rad]
_GAIN = 0.01  # in clearance that a move away is worth making for [m]


_STEP = 0.04  # of a search for a way out, along an arc [m]
_TURN = 0.08  # and on the spot [rad]
_CELL, _SECTOR = 0.02, 0.04  # what is nearer to each other is one place [m, rad]
_ROOM = 0.08  # a clearance with which other moves are found again [m]
_PLACES = 1500  # are looked at, at most


class RecoveryMove(NamedTuple):
    """Drive an arc, then turn on the spot."""

    distance: float
    """Along the arc, negative backwards, 0 to turn at once [m]."""
    curvature: float
    """Of the arc, positive to the left when driven forwards [1/m]."""
    turn: float
    """On the spot afterwards, positive to the left [rad]."""


BACKWARDS, FORWARDS, LEFT, RIGHT = 1, 2, 4, 8
"""Kinds of moves, by what they begin with; a sum of some is what is not to be tried."""


@jit
def kind(left: RecoveryMove) -> int:
    """The kind of what a move goes on with; 0 when it is over."""
    if left.distance != 0.0:
        return FORWARDS if left.distance > 0.0 else BACKWARDS
    if left.turn != 0.0:
        return LEFT if left.turn > 0.0 else RIGHT
    return 0


class Choices(NamedTuple):
    """Which moves are tried."""

    clearances: tuple[float, ...] = (0.1, 0.06, 0.04)
    """Least clearance of the outline on the way, from the one wanted, since what is seen only from
    outside a tight spot needs room too, to the least, not less than the guard's margin, or that
    will end the move half-way [m]."""
    back: float = 1.0
    """Farthest move backwards; no farther than what is known there, as LiDARs are blind to the
    rear [m]."""
    forward: float = 0.5
    """Farthest move forwards [m]."""
    curvatures: tuple[float, ...] = (0.0, 1.5, -1.5, 4.0, -4.0)
    """Of the arcs [1/m]."""
    gentle: tuple[float, ...] = (0.08, -0.08, 0.12, -0.12, 0.16, -0.16, 0.3, -0.3, 1.0, -1.0)
    """Of arcs that lead away from what the robot stands along [1/m]."""
    least: float = 0.018
    """Least clearance on those, a little more than the guard's hard margin [m]."""
    off: float = 0.3
    """Away from what holds the robot and is not known, as far as that [m]."""


_CHOICES = Choices()


def back_off(
    pose: Pose, points: Floats, outline: Floats, choices: Choices = _CHOICES, refused: int = 0
) -> RecoveryMove | None:
    """As it came, away from what holds the robot though nothing known is in its way: straight back,
    or along the arc that leads farthest; where backwards is refused, forwards; None if none leads
    anywhere.

    No nearer to anything than `choices.least`, or than it is.
    """
    reach = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    now = float(swept(points, outline, np.array([pose]))[0]) - 1e-6
    clearance = min(choices.least, now)
    for sign in (-1.0, 1.0):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        best = 0.0, 0.0
        for k in choices.curvatures:  # the straightest first
            far = _clear_distance(pose, sign, k, choices.off, points, outline, reach, clearance)
            best = max(best, (min(far, choices.off), k), key=lambda way: way[0])
        if best[0] > 2.0 * _LOOK:
            return RecoveryMove(sign * best[0], best[1], 0.0)
    return None


def recovery_move(
    pose: Pose, heading: float, points: Floats, outline: Floats, choices: Choices = _CHOICES,
    refused: int = 0,
) -> RecoveryMove | None:  # fmt: skip
    """The shortest move after which the robot can look into `heading`; where there is none, one
    after which it has more room, if there is any; None if nothing is clear.

    With the largest clearance for which there is one: a turn on the spot, the short way round, else
    the long way; or an arc backwards or forwards, followed by such a turn. pose: world frame.
    heading: world frame [rad]. points: (p, 2) [m]. outline: (k, 2), convex, counter-clockwise.
    Where the robot is nearer to something than that already, it comes no nearer. refused: kinds
    of moves that are not to be begun with.

    Who stands along a wall with no more than that can not turn away from it, on the spot or
    sharply, without a corner coming nearer: then a gentle arc leads off, on which it may come as
    near as `choices.least`.
    """
    reach = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    far = choices.back + choices.forward + 2.0 * reach
    off = points - np.array(pose[:2])
    near = points[np.hypot(off[:, 0], off[:, 1]) < far]
    now = float(swept(near, outline, np.array([pose]))[0]) - 1e-6
    for clearance in choices.clearances:
        found = _shortest(
            pose, heading, near, outline, reach, clearance, min(clearance, now), choices, refused
        )
        if found is not None:
            return found
    return _away(pose, near, outline, reach, choices, refused)


def _away(
    pose: Pose, points: Floats, outline: Floats, reach: float, choices: Choices, refused: int
) -> RecoveryMove | None:
    """The gentle arc that ends with the largest clearance; None if none of them gains any."""
    now = float(swept(points, outline, np.array([pose]))[0])
    most, best = now + _GAIN, None
    for sign, far in ((-1.0, choices.back), (1.0, 2.0 * choices.forward)):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        for curvature in choices.gentle:
            clearances, ways = _along(pose, sign, curvature, far, points, outline, reach)
            tight = clearances < min(choices.least, now)
            end = int(np.argmax(tight)) if tight.any() else len(clearances)
            k = int(np.argmax(clearances[:end])) if end else 0
            if end and clearances[k] > most:
                most, best = float(clearances[k]), RecoveryMove(float(ways[k]), curvature, 0.0)
    return best


def wriggle(
    pose: Pose, points: Floats, outline: Floats, choices: Choices = _CHOICES, refused: int = 0
) -> RecoveryMove | None:
    """What to begin with where no single move leads out: the first of the fewest small arcs and
    turns after which there is room, by Dijkstra over places a hand's breadth apart; None if there
    are none.

    The clearance on the way is at least `choices.least`, or what it is now. points: dense enough
    to tell such a clearance.
    """
    reach = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    off = points - np.array(pose[:2])
    near = points[np.hypot(off[:, 0], off[:, 1]) < 2.0 * reach + 1.0]
    least = min(choices.least, float(swept(near, outline, np.array([pose]))[0]) - 1e-6)
    steps = [RecoveryMove(s * _STEP, k, 0.0) for s in (-1.0, 1.0) for k in choices.curvatures]
    steps += [RecoveryMove(0.0, 0.0, s * _TURN) for s in (-1.0, 1.0)]
    begin = [step for step in steps if not kind(step) & refused]
    if not begin:
        return None
    queue: list[tuple[float, int, Pose, RecoveryMove | None, bool]] = [(0.0, 0, pose, None, True)]
    seen, number, looked = set[tuple[int, int, int]](), 0, 0
    while queue and looked < _PLACES:
        cost, _, at, first, same = heapq.heappop(queue)
        place = (round(at.x / _CELL), round(at.y / _CELL), round(at.psi / _SECTOR))
        if place in seen:
            continue
        seen.add(place)
        looked += 1
        tried = begin if first is None else steps
        ends = [_stepped(at, step, 1.0) for step in tried]
        half = [_stepped(at, step, 0.5) for step in tried]
        clearances = swept(near, outline, np.array(half + ends))
        for i, (step, end) in enumerate(zip(tried, ends, strict=True)):
            clearance = float(clearances[len(tried) + i])
            if min(clearance, float(clearances[i])) < least:
                continue
            goes_on = same and (first is None or _alike(first, step))
            whole = step if first is None else _longer(first, step) if goes_on else first
            if clearance > _ROOM:
                return whole
            number += 1
            again = 0.0 if goes_on else 0.5  # few long moves rather than many short ones
            heapq.heappush(queue, (cost + 1.0 + again, number, end, whole, goes_on))
    return None


def _stepped(pose: Pose, step: RecoveryMove, share: float) -> Pose:
    """Where a small arc or turn leads, or a share of it."""
    if step.distance == 0.0:
        return Pose(pose.x, pose.y, pose.psi + share * step.turn)
    return arc(pose, Twist(step.distance, step.distance * step.curvature), share)


def _alike(a: RecoveryMove, b: RecoveryMove) -> bool:
    """Whether b is more of the same."""
    return a.curvature == b.curvature and kind(a) == kind(b)


def _longer(a: RecoveryMove, b: RecoveryMove) -> RecoveryMove:
    return RecoveryMove(a.distance + b.distance, a.curvature, a.turn + b.turn)


def _shortest(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, clearance: float,
    leave: float, choices: Choices, refused: int,
) -> RecoveryMove | None:  # fmt: skip
    """The shortest move that keeps `leave` as it leaves, and `clearance` as it turns at its end."""
    turn = _turn(pose, heading, points, outline, reach, leave, refused)
    if turn is not None:
        return RecoveryMove(0.0, 0.0, turn)
    tried: list[tuple[float, float]] = []
    for sign, far in ((-1.0, choices.back), (1.0, choices.forward)):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        for curvature in choices.curvatures:
            clear = _clear_distance(pose, sign, curvature, far, points, outline, reach, leave)
            steps = np.arange(1, int(clear / (2.0 * _LOOK)) + 1) * 2.0 * _LOOK
            tried += [(sign * float(d), curvature) for d in steps]
    for distance, curvature in sorted(tried, key=lambda move: abs(move[0])):
        there = arc(pose, Twist(distance, distance * curvature), 1.0)
        turn = _turn(there, heading, points, outline, reach, clearance, 0)
        if turn is not None:
            return RecoveryMove(distance, curvature, turn)
    return None


def _turn(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, clearance: float,
    refused: int,
) -> float | None:  # fmt: skip
    """The angle to turn on the spot, the short way or else the long way, if either is clear."""
    short = math.remainder(heading - pose.psi, 2.0 * math.pi)
    for angle in (short, short - math.copysign(2.0 * math.pi, short)):
        if kind(RecoveryMove(0.0, 0.0, angle)) & refused:
            continue
        n = max(math.ceil(abs(angle) * reach / _LOOK), 1) + 1
        poses = np.column_stack(
            (np.full(n, pose.x), np.full(n, pose.y), pose.psi + np.linspace(0.0, angle, n))
        )
        if swept(points, outline, poses).min() >= clearance:
            return angle
    return None


def _clear_distance(
    pose: Pose, sign: float, curvature: float, far: float, points: Floats, outline: Floats,
    reach: float, clearance: float,
) -> float:  # fmt: skip
    """How far along an arc the outline stays clear [m]."""
    clearances, ways = _along(pose, sign, curvature, far, points, outline, reach)
    tight = clearances < clearance
    first = int(np.argmax(tight)) if tight.any() else len(clearances)
    return float(abs(ways[0])) * first


def _along(
    pose: Pose, sign: float, curvature: float, far: float, points: Floats, outline: Floats,
    reach: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The clearances of the outline along an arc, and how far it has driven there, signed [m]."""
    step = _LOOK / (1.0 + abs(curvature) * reach)
    ways = np.arange(1, math.ceil(far / step) + 1, dtype=np.float64) * (sign * step)
    return swept(points, outline, _arcs(pose, ways, curvature)), ways


@jit
def _arcs(pose: Pose, ways: Floats, curvature: float) -> Floats:
    """The poses so far along an arc, (k, 3)."""
    poses = np.empty((len(ways), 3))
    for i in range(len(ways)):
        there = arc(pose, Twist(ways[i], ways[i] * curvature), 1.0)
        poses[i, 0], poses[i, 1], poses[i, 2] = there.x, there.y, there.psi
    return poses


@jit
def recovery_twist(left: RecoveryMove, speed: float, yaw_rate: float, dt: float) -> Twist:
    """The twist that goes on with a move, at most at these speeds, and ends it without overshoot.

    Zero when it is over. left: what is left of the move. dt: for how long the twist will hold [s].
    """
    if abs(left.distance) >= _NEAR_ENOUGH:
        fastest = speed / max(1.0, speed * abs(left.curvature) / yaw_rate)
        v = min(max(0.2 * left.distance / dt, -fastest), fastest)
        return Twist(v, v * left.curvature)
    if abs(left.turn) >= _NEAR_ENOUGH:
        return Twist(0.0, min(max(0.2 * left.turn / dt, -yaw_rate), yaw_rate))
    return Twist(0.0, 0.0)


@jit
def rest(left: RecoveryMove, twist: Twist, dt: float) -> RecoveryMove:
    """What is left of a move after `twist` was really held for `dt`.

    It is over when distance and turn are 0.
    """
    distance, turn = left.distance, left.turn
    if abs(distance) >= _NEAR_ENOUGH:
        distance -= twist.v * dt
    else:
        turn -= twist.omega * dt
    if abs(distance) < _NEAR_ENOUGH or distance * left.distance < 0.0:
        distance = 0.0
    if abs(turn) < _NEAR_ENOUGH or turn * left.turn < 0.0:
        turn = 0.0
    return RecoveryMove(distance, left.curvature, turn)
