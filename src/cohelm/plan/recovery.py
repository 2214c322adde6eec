"""Recovery moves (back up, spin): the shortest after which the robot can turn where it must."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.plan.distance_field import swept
from cohelm.robot.kinematics import arc

_LOOK = 0.02  # how far apart poses are looked at, of the outline's farthest corner [m]
_NEAR_ENOUGH = 0.01  # to the end of a move [m, rad]


class Escape(NamedTuple):
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
def kind(left: Escape) -> int:
    """The kind of what a move goes on with; 0 when it is over."""
    if left.distance != 0.0:
        return FORWARDS if left.distance > 0.0 else BACKWARDS
    if left.turn != 0.0:
        return LEFT if left.turn > 0.0 else RIGHT
    return 0


class Choices(NamedTuple):
    """Which moves are tried."""

    gaps: tuple[float, ...] = (0.1, 0.06, 0.04)
    """Least gap of the outline on the way, from the one wished for, since what is seen only from
    outside a tight spot needs room too, to the least, not less than the guard's margin, or that
    will end the move half-way [m]."""
    back: float = 1.0
    """Farthest move backwards; no farther than what is known there, as LiDARs are blind to the
    rear [m]."""
    forward: float = 0.5
    """Farthest move forwards [m]."""
    curvatures: tuple[float, ...] = (0.0, 1.5, -1.5, 4.0, -4.0)
    """Of the arcs [1/m]."""


_CHOICES = Choices()


def escape(
    pose: Pose, heading: float, points: Floats, outline: Floats, choices: Choices = _CHOICES,
    refused: int = 0,
) -> Escape | None:  # fmt: skip
    """The shortest move after which the robot can look into `heading`; None if none is clear.

    With the largest gap for which there is one: a turn on the spot, the short way round, else
    the long way; or an arc backwards or forwards, followed by such a turn. pose: world frame.
    heading: world frame [rad]. points: (p, 2) [m]. outline: (k, 2), convex, counter-clockwise.
    Where the robot is nearer to something than the gap already, it comes no nearer. refused: kinds
    of moves that are not to be begun with.
    """
    reach = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    far = choices.back + choices.forward + 2.0 * reach
    off = points - np.array(pose[:2])
    near = points[np.hypot(off[:, 0], off[:, 1]) < far]
    now = float(swept(near, outline, np.array([pose]))[0]) - 1e-6
    for gap in choices.gaps:
        found = _shortest(pose, heading, near, outline, reach, gap, min(gap, now), choices, refused)
        if found is not None:
            return found
    return None


def _shortest(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, gap: float,
    leave: float, choices: Choices, refused: int,
) -> Escape | None:  # fmt: skip
    """The shortest move that leaves with a gap `leave` and turns with a gap `gap` where it ends."""
    turn = _turn(pose, heading, points, outline, reach, leave, refused)
    if turn is not None:
        return Escape(0.0, 0.0, turn)
    tried: list[tuple[float, float]] = []
    for sign, far in ((-1.0, choices.back), (1.0, choices.forward)):
        if kind(Escape(sign, 0.0, 0.0)) & refused:
            continue
        for curvature in choices.curvatures:
            clear = _clear_distance(pose, sign, curvature, far, points, outline, reach, leave)
            steps = np.arange(1, int(clear / (2.0 * _LOOK)) + 1) * 2.0 * _LOOK
            tried += [(sign * float(d), curvature) for d in steps]
    for distance, curvature in sorted(tried, key=lambda move: abs(move[0])):
        there = arc(pose, Twist(distance, distance * curvature), 1.0)
        turn = _turn(there, heading, points, outline, reach, gap, 0)
        if turn is not None:
            return Escape(distance, curvature, turn)
    return None


def _turn(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, gap: float,
    refused: int,
) -> float | None:  # fmt: skip
    """The angle to turn on the spot, the short way or else the long way, if either is clear."""
    short = math.remainder(heading - pose.psi, 2.0 * math.pi)
    for angle in (short, short - math.copysign(2.0 * math.pi, short)):
        if kind(Escape(0.0, 0.0, angle)) & refused:
            continue
        n = max(math.ceil(abs(angle) * reach / _LOOK), 1) + 1
        poses = np.column_stack(
            (np.full(n, pose.x), np.full(n, pose.y), pose.psi + np.linspace(0.0, angle, n))
        )
        if swept(points, outline, poses).min() >= gap:
            return angle
    return None


def _clear_distance(
    pose: Pose, sign: float, curvature: float, far: float, points: Floats, outline: Floats,
    reach: float, gap: float,
) -> float:  # fmt: skip
    """How far along an arc the outline stays clear [m]."""
    step = _LOOK / (1.0 + abs(curvature) * reach)
    ways = sign * np.arange(1, math.ceil(far / step) + 1) * step
    poses = np.array([arc(pose, Twist(float(d), float(d) * curvature), 1.0) for d in ways])
    tight = swept(points, outline, poses) < gap
    first = int(np.argmax(tight)) if tight.any() else len(ways)
    return first * step


@jit
def wish(left: Escape, speed: float, yaw_rate: float, dt: float) -> Twist:
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
def rest(left: Escape, twist: Twist, dt: float) -> Escape:
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
    return Escape(distance, left.curvature, turn)
