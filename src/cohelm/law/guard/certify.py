"""The certificate: hold a twist for one step, then brake, and nothing is touched on the way."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.contact import point_clearance, wall_clearance
from cohelm.law.guard.surroundings import Surroundings, rests, strayed
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

CLEAR = -1
"""Nothing is in the way."""

_MOST = 10_000  # looks along one manoeuvre; more is refused


class Manoeuvre(NamedTuple):
    """Holding a twist for `dt` and then braking on its curvature to a stop."""

    pose: Pose
    twist: Twist
    dt: float
    """How long the twist is held [s]."""
    length: float
    """Time for which holding the twist would go as far as the whole manoeuvre [s]."""
    steps: float
    """Control steps that the braking takes."""
    pace: float
    """Largest speed of any point of the outline while the twist is held [m/s]."""
    stop: float
    """When the robot stands [s]."""


@jit
def manoeuvre(pose: Pose, twist: Twist, limits: Limits, dt: float, reach: float) -> Manoeuvre:
    """The manoeuvre that a command is certified by. reach: the outline's farthest corner [m]."""
    steps = brake_steps(twist, limits, dt)
    return Manoeuvre(
        pose, twist, dt, dt + coasting(twist, limits, dt), steps,
        abs(twist.v) + abs(twist.omega) * reach, dt * (1.0 + math.ceil(steps)),
    )  # fmt: skip


@jit
def in_the_way(
    m: Manoeuvre, outline: Floats, reach: float, around: Surroundings, clear: float
) -> int:
    """The first thing that the manoeuvre does not stay clear of, or CLEAR.

    Counted as in `Surroundings`: discs, then segments, then points.

    Things are looked at by conservative advancement: a clearance g at one moment can not fall
    below `clear` / 2 before the outline, at its largest pace, and the thing, at its own, have
    covered g - clear / 2; that is where the next look is. So the clearance is at least `clear` / 2
    at every instant of the manoeuvre, not only at sampled ones. What starts nearer than that may
    come no nearer, if it rests; one that can move holds the robot where it stands.
    """
    if m.pace == 0.0:
        return CLEAR  # standing still meets nothing that does not come to it
    far = reach + m.pace * m.length + clear
    discs = around.discs.shape[0]
    for i in range(discs):
        x, y, radius = around.discs[i, X], around.discs[i, Y], around.discs[i, RADIUS]
        vx, vy = around.discs[i, VX], around.discs[i, VY]
        most, off = around.max_acceleration[i], around.velocity_error[i]
        if rests(around, i):
            dx, dy = x - m.pose.x, y - m.pose.y
            near = dx * dx + dy * dy < (far + radius) * (far + radius)
            if near and not _clears_still(m, outline, x, y, x, y, radius, clear):
                return i
        elif not _clears_mover(m, outline, reach, x, y, vx, vy, radius, most, off, clear):
            return i
    for i in range(around.segments.shape[0]):
        ax, ay = around.segments[i, 0], around.segments[i, 1]
        bx, by = around.segments[i, 2], around.segments[i, 3]
        near = _near(m.pose, ax, ay, bx, by, far)
        if near and not _clears_still(m, outline, ax, ay, bx, by, 0.0, clear):
            return discs + i
    for i in range(around.points.shape[0]):
        x, y = around.points[i, 0], around.points[i, 1]
        dx, dy = x - m.pose.x, y - m.pose.y
        near = dx * dx + dy * dy < far * far  # never for NaN
        if near and not _clears_still(m, outline, x, y, x, y, 0.0, clear):
            return discs + around.segments.shape[0] + i
    return CLEAR


@jit
def _clears_still(
    m: Manoeuvre, outline: Floats, ax: float, ay: float, bx: float, by: float, radius: float,
    clear: float,
) -> bool:  # fmt: skip
    """A thing at rest, a segment with a radius: only the arc matters, not when the robot is where.

    A look is no nearer to the last one than a grain of the outline's way. Between two looks a
    grain apart the clearance can dip by half of that, so the floor lies that much above clear / 2;
    and where that can be, there is also a look wherever the next command may come in. So every
    command finds at least the floor, or what the first one found, and repeated ones can not
    creep below. 1e-12 m is arithmetic.
    """
    grain = 0.125 * clear
    floor = 0.5 * clear + 0.5 * grain
    g = _clearance_at(m.pose, outline, ax, ay, bx, by) - radius
    allowed = clear if g >= clear else min(floor, g)
    s, k = 0.0, 1
    for _ in range(_MOST):
        left = m.length - s
        if left <= 0.0 or m.pace * left <= g - floor:
            return True
        ahead = s + max(g - floor, grain) / m.pace
        if g < floor + grain:
            while _travelled(m, k * m.dt) <= s:
                k += 1
            ahead = min(ahead, _travelled(m, k * m.dt))
        s = min(ahead, m.length)
        g = _clearance_at(arc(m.pose, m.twist, s), outline, ax, ay, bx, by) - radius
        if g < allowed - 1e-12:
            return False
        allowed = max(allowed, min(floor, g))
    return False


@jit
def _travelled(m: Manoeuvre, t: float) -> float:
    """How long the twist would have to be held to be where the manoeuvre is at time t [s]."""
    if t <= m.dt:
        return t
    if t >= m.stop:
        return m.length
    k = math.floor((t - m.dt) / m.dt)
    share = max(1.0 - (k + 1.0) / m.steps, 0.0)
    before = m.dt * k * (1.0 - 0.5 * (k + 1.0) / m.steps) if k > 0 else 0.0  # 0 x inf
    return min(m.dt + before + share * (t - m.dt - k * m.dt), m.length)


@jit
def _clears_mover(
    m: Manoeuvre, outline: Floats, reach: float,
    x0: float, y0: float, vx: float, vy: float, radius: float, most: float, off: float,
    clear: float,
) -> bool:  # fmt: skip
    """A moving disc, until the robot stands: it keeps its velocity up to off t + most t^2 / 2.

    Where the next command may come in while it is nearer than `clear`, there is a look too, so
    that only a robot that stood finds one as near: see `_leaves`.
    """
    closing = m.pace + math.sqrt(vx * vx + vy * vy) + off + most * m.stop
    g = _clearance_at(m.pose, outline, x0, y0, x0, y0) - radius
    if g < clear:
        if g < 0.5625 * clear:  # the floor of `_clears_still`
            return False
        return _leaves(m, outline, x0, y0, vx, vy, radius, most, off, clear, g, closing)
    t = 0.0
    for _ in range(_MOST):
        grown = radius + strayed(off, most, t)
        x, y = x0 + vx * t, y0 + vy * t
        pose = arc(m.pose, m.twist, _travelled(m, t))
        dx, dy = x - pose.x, y - pose.y
        g = math.sqrt(dx * dx + dy * dy) - reach - grown
        if g < clear:  # the circle around the outline is too coarse
            g = _clearance_at(pose, outline, x, y, x, y) - grown
        if g < clear:
            return False
        if closing * (m.stop - t) <= g - clear:
            return True
        doubtful = math.ceil((t + (g - clear) / closing) / m.dt - 1e-9)
        command = m.dt * max(doubtful, math.floor(t / m.dt + 1e-9) + 1)
        t = min(t + (g - 0.5 * clear) / closing, command, m.stop)
    return False


@jit
def _leaves(
    m: Manoeuvre, outline: Floats,
    x0: float, y0: float, vx: float, vy: float, radius: float, most: float, off: float,
    clear: float, allowed: float, closing: float,
) -> bool:  # fmt: skip
    """Whether a moving disc that is nearer than `clear`, by `allowed`, comes no nearer at any step.

    Between two looks the clearance stays above clear / 2. Every step is a look, since the next
    command may come in there, and finds what it finds.
    """
    end = max(m.stop - m.dt, m.dt)  # in the last step of braking it stands
    t, k = 0.0, 1
    for _ in range(_MOST):
        g = _grown_clearance(m, outline, x0, y0, vx, vy, radius, most, off, t)
        if g < allowed - 1e-12:
            return False
        if t >= end:
            return True
        t = min(t + (g - 0.5 * clear) / closing, end)
        if t >= k * m.dt:
            t, k = k * m.dt, k + 1
    return False


@jit
def _grown_clearance(
    m: Manoeuvre, outline: Floats, x0: float, y0: float, vx: float, vy: float, radius: float,
    most: float, off: float, t: float,
) -> float:  # fmt: skip
    """The clearance to a moving disc at time t of the manoeuvre, at least [m]."""
    pose = arc(m.pose, m.twist, _travelled(m, t))
    x, y = x0 + vx * t, y0 + vy * t
    return _clearance_at(pose, outline, x, y, x, y) - radius - strayed(off, most, t)


@jit
def _near(pose: Pose, ax: float, ay: float, bx: float, by: float, far: float) -> bool:
    """Whether a segment comes nearer to the robot's origin than `far`."""
    ex, ey = bx - ax, by - ay
    wx, wy = pose.x - ax, pose.y - ay
    square = ex * ex + ey * ey
    s = min(max((wx * ex + wy * ey) / square, 0.0), 1.0) if square > 0.0 else 0.0
    gx, gy = wx - s * ex, wy - s * ey
    return gx * gx + gy * gy < far * far


@jit
def _clearance_at(pose: Pose, outline: Floats, ax: float, ay: float, bx: float, by: float) -> float:
    """Clearance between the outline at a pose and a segment, which may be a point [m]."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    ux, uy = c * (ax - pose.x) + s * (ay - pose.y), -s * (ax - pose.x) + c * (ay - pose.y)
    if ax == bx and ay == by:
        return point_clearance(outline, ux, uy)
    wx, wy = c * (bx - pose.x) + s * (by - pose.y), -s * (bx - pose.x) + c * (by - pose.y)
    return wall_clearance(outline, ux, uy, wx, wy)
