"""Recovery moves (back up, spin): the shortest after which the robot can face its path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.plan.distance_field import swept_clearances
from cohelm.robot.clearance import point_gap
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.kinematics import arc

_SPACING = 0.02  # of checked poses, along the travel of the outline's farthest corner [m]
_NEAR_ENOUGH = 0.01  # tolerance of the end of a move [m, rad]
GAIN = 0.005
"""In clearance, that makes a move worthwhile [m]."""


class RecoveryMove(NamedTuple):
    """Drive an arc, then turn on the spot."""

    distance: float
    """Along the arc, negative backwards, 0 to turn at once [m]."""
    curvature: float
    """Of the arc, positive to the left when driven forwards [1/m]."""
    turn: float
    """On the spot afterwards, positive to the left [rad]."""


BACKWARDS, FORWARDS, LEFT, RIGHT = 1, 2, 4, 8
"""Kinds of moves, by how they begin; `refused` is a bit mask of kinds not to try."""


@jit
def kind(remaining: RecoveryMove) -> int:
    """The kind of the rest of a move; 0 when it is over."""
    return begins(remaining.distance, remaining.turn)


@jit
def begins(along: float, turn: float) -> int:
    """The kind of a motion that goes along, or turns on the spot; 0: it stands."""
    if along != 0.0:
        return FORWARDS if along > 0.0 else BACKWARDS
    if turn != 0.0:
        return LEFT if turn > 0.0 else RIGHT
    return 0


class RecoveryParams(NamedTuple):
    """Parameters of recovery moves."""

    clearances: tuple[float, ...] = (0.1, 0.06, 0.04)
    """Clearances of the outline during a move, tried in this order; the last not less than the
    guard's margin, or the guard stops the move half-way [m]."""
    back: float = 1.0
    """Longest move backwards; no longer than the observed ground there [m]."""
    forward: float = 0.5
    """Longest move forwards [m]."""
    curvatures: tuple[float, ...] = (0.0, 1.5, -1.5, 4.0, -4.0)
    """Of the arcs [1/m]."""
    gentle: tuple[float, ...] = (0.9, -0.9, 0.5, -0.5, 0.25, -0.25)
    """Of gentle arcs that lead off a wall, as shares of the largest that the clearance allows."""
    least: float = 0.018
    """Smallest clearance on those, a little more than the guard's hard margin [m]."""
    off: float = 0.3
    """Length of a move away from an unknown obstacle [m]."""


_PARAMS = RecoveryParams()


def back_off(
    pose: Pose, points: Floats, outline: Floats, params: RecoveryParams = _PARAMS, refused: int = 0
) -> RecoveryMove | None:
    """A move away from an unknown obstacle that holds the robot up: straight back, or along the
    longest arc; where backwards is refused, forwards; None if none is possible.

    Its clearance is at least `params.least`, or what it is now.
    """
    reach = farthest_corner(outline)
    clearance_now = float(swept_clearances(points, outline, np.array([pose]))[0]) - 1e-6
    clearance = min(params.least, clearance_now)
    for sign in (-1.0, 1.0):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        best = 0.0, 0.0
        for k in params.curvatures:  # the straightest first
            far = clear_distance(pose, sign, k, params.off, points, outline, reach, clearance)
            best = max(best, (min(far, params.off), k), key=lambda way: way[0])
        if best[0] > 2.0 * _SPACING:
            return RecoveryMove(sign * best[0], best[1], 0.0)
    return None


def recovery_move(
    pose: Pose, heading: float, points: Floats, outline: Floats, params: RecoveryParams = _PARAMS,
    refused: int = 0,
) -> RecoveryMove | None:  # fmt: skip
    """The shortest move after which the robot can turn to `heading`; if there is none, one after
    which it has more clearance; else None.

    With the largest clearance for which there is one: a turn on the spot, the short way round, else
    the long way; or an arc backwards or forwards, followed by such a turn. pose: world frame.
    heading: world frame [rad]. points: (p, 2) [m]. outline: (k, 2), convex, counter-clockwise.
    Where the robot is nearer to an obstacle already, it comes no nearer. refused: kinds of moves
    not to begin with.

    Flush along a wall, the robot can not turn away, on the spot or sharply, without a corner coming
    nearer: then a gentle arc leads off, with a clearance of at least `params.least`.
    """
    reach = farthest_corner(outline)
    far = params.back + params.forward + 2.0 * reach
    off = points - np.array(pose[:2])
    near = points[np.hypot(off[:, 0], off[:, 1]) < far]
    clearance_now = float(swept_clearances(near, outline, np.array([pose]))[0]) - 1e-6
    for clearance in params.clearances:
        found = _shortest(
            pose, heading, near, outline, reach, clearance, min(clearance, clearance_now), params,
            refused,
        )  # fmt: skip
        if found is not None:
            return found
    return _gentle_arc(pose, near, outline, reach, params, refused)


def _gentle_arc(
    pose: Pose, points: Floats, outline: Floats, reach: float, params: RecoveryParams, refused: int
) -> RecoveryMove | None:
    """The gentle arc that ends with the largest clearance; None if none gains any.

    On an arc of curvature k a corner that is d before or behind the axle first comes nearer to a
    wall, by k d^2 / 2.
    """
    clearance_now = float(swept_clearances(points, outline, np.array([pose]))[0])
    least, most, best = min(params.least, clearance_now), clearance_now + GAIN, None
    sharpest = 2.0 * (clearance_now - least) / float(np.abs(outline[:, 0]).max()) ** 2
    for sign, far in ((-1.0, params.back), (1.0, 2.0 * params.forward)):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        for share in params.gentle:
            curvature = share * sharpest
            clearances, distances = _along(pose, sign, curvature, far, points, outline, reach)
            tight = clearances < least
            end = int(np.argmax(tight)) if tight.any() else len(clearances)
            k = int(np.argmax(clearances[:end])) if end else 0
            if end and clearances[k] > most:
                most, best = float(clearances[k]), RecoveryMove(float(distances[k]), curvature, 0.0)
    return best


def _shortest(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, clearance: float,
    start_clearance: float, params: RecoveryParams, refused: int,
) -> RecoveryMove | None:  # fmt: skip
    """The shortest move with `start_clearance` on the arc, and `clearance` in the turn at its
    end."""
    turn = turn_to(pose, heading, points, outline, reach, start_clearance, refused)
    if turn is not None:
        return RecoveryMove(0.0, 0.0, turn)
    tried: list[tuple[float, float]] = []
    for sign, far in ((-1.0, params.back), (1.0, params.forward)):
        if kind(RecoveryMove(sign, 0.0, 0.0)) & refused:
            continue
        for curvature in params.curvatures:
            clear = clear_distance(
                pose, sign, curvature, far, points, outline, reach, start_clearance
            )
            steps = np.arange(1, int(clear / (2.0 * _SPACING)) + 1) * 2.0 * _SPACING
            tried += [(sign * float(d), curvature) for d in steps]
    for distance, curvature in sorted(tried, key=lambda move: abs(move[0])):
        there = arc(pose, Twist(distance, distance * curvature), 1.0)
        turn = turn_to(there, heading, points, outline, reach, clearance, 0)
        if turn is not None:
            return RecoveryMove(distance, curvature, turn)
    return None


def turn_to(
    pose: Pose, heading: float, points: Floats, outline: Floats, reach: float, clearance: float,
    refused: int,
) -> float | None:  # fmt: skip
    """The angle to turn on the spot, the short way or else the long way, if either is clear."""
    short = math.remainder(heading - pose.psi, 2.0 * math.pi)
    for angle in (short, short - math.copysign(2.0 * math.pi, short)):
        if kind(RecoveryMove(0.0, 0.0, angle)) & refused:
            continue
        if turns(pose, angle, points, outline, reach, clearance):
            return angle
    return None


@jit
def within(points: Floats, pose: Pose, radius: float) -> Floats:
    """The points within a radius of a pose [m]."""
    dx, dy = points[:, 0] - pose.x, points[:, 1] - pose.y
    return points[dx * dx + dy * dy < radius * radius]


@jit
def is_clear(points: Floats, outline: Floats, reach: float, pose: Pose, clearance: float) -> bool:
    """Whether the outline at a pose keeps `clearance` to all points."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    far = (reach + clearance) * (reach + clearance)
    for p in range(len(points)):
        dx, dy = points[p, 0] - pose.x, points[p, 1] - pose.y
        if (
            dx * dx + dy * dy < far
            and not max(point_gap(outline, c * dx + s * dy, -s * dx + c * dy), 0.0) >= clearance
        ):
            return False
    return True


@jit
def turns(
    pose: Pose, angle: float, points: Floats, outline: Floats, reach: float, clearance: float
) -> bool:
    """Whether the outline keeps `clearance` during a turn on the spot."""
    n = max(math.ceil(abs(angle) * reach / _SPACING), 1)
    near = within(points, pose, reach + clearance)
    for i in range(n + 1):
        psi = pose.psi + (angle if i == n else i * (angle / n))
        if not is_clear(near, outline, reach, Pose(pose.x, pose.y, psi), clearance):
            return False
    return True


def clear_distance(
    pose: Pose, sign: float, curvature: float, far: float, points: Floats, outline: Floats,
    reach: float, clearance: float,
) -> float:  # fmt: skip
    """How far along an arc the outline keeps `clearance` [m]."""
    clearances, distances = _along(pose, sign, curvature, far, points, outline, reach)
    tight = clearances < clearance
    first = int(np.argmax(tight)) if tight.any() else len(clearances)
    return float(abs(distances[0])) * first


def _along(
    pose: Pose, sign: float, curvature: float, far: float, points: Floats, outline: Floats,
    reach: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The clearances of the outline along an arc, and the signed distances there [m]."""
    step = _SPACING / (1.0 + abs(curvature) * reach)
    distances = np.arange(1, math.ceil(far / step) + 1, dtype=np.float64) * (sign * step)
    return swept_clearances(points, outline, _arcs(pose, distances, curvature)), distances


@jit
def _arcs(pose: Pose, distances: Floats, curvature: float) -> Floats:
    """The poses at distances along an arc, (k, 3)."""
    poses = np.empty((len(distances), 3))
    for i in range(len(distances)):
        there = arc(pose, Twist(distances[i], distances[i] * curvature), 1.0)
        poses[i, 0], poses[i, 1], poses[i, 2] = there.x, there.y, there.psi
    return poses


def after(move: RecoveryMove, pose: Pose) -> Pose:
    """The pose at the end of a move."""
    there = arc(pose, Twist(move.distance, move.distance * move.curvature), 1.0)
    return Pose(there.x, there.y, there.psi + move.turn)


@jit
def recovery_twist(remaining: RecoveryMove, speed: float, yaw_rate: float, dt: float) -> Twist:
    """The twist that continues a move, at most at these speeds, and ends it without overshoot.

    Zero when it is over. remaining: rest of the move. dt: how long the twist is held [s].
    """
    if abs(remaining.distance) >= _NEAR_ENOUGH:
        fastest = speed / max(1.0, speed * abs(remaining.curvature) / yaw_rate)
        v = min(max(0.2 * remaining.distance / dt, -fastest), fastest)
        return Twist(v, v * remaining.curvature)
    if abs(remaining.turn) >= _NEAR_ENOUGH:
        return Twist(0.0, min(max(0.2 * remaining.turn / dt, -yaw_rate), yaw_rate))
    return Twist(0.0, 0.0)


@jit
def rest(remaining: RecoveryMove, twist: Twist, dt: float) -> RecoveryMove:
    """The rest of a move after `twist` was held for `dt`.

    It is over when distance and turn are 0.
    """
    distance, turn = remaining.distance, remaining.turn
    if abs(distance) >= _NEAR_ENOUGH:
        distance -= twist.v * dt
    else:
        turn -= twist.omega * dt
    if abs(distance) < _NEAR_ENOUGH or distance * remaining.distance < 0.0:
        distance = 0.0
    if abs(turn) < _NEAR_ENOUGH or turn * remaining.turn < 0.0:
        turn = 0.0
    return RecoveryMove(distance, remaining.curvature, turn)
