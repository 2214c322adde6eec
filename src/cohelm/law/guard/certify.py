"""The certificate: holding a twist for one step, then braking, touches nothing on the way."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.bounds import brake_steps, coasting
from cohelm.law.guard.contact import point_clearance, wall_clearance
from cohelm.law.guard.surroundings import is_static, position_bound
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits

CLEAR = -1
"""No obstacle blocks the manoeuvre."""

_MAX_CHECKS = 10_000  # along one manoeuvre; a manoeuvre that needs more is rejected


class Manoeuvre(NamedTuple):
    """Holding a twist for `dt` and then braking on its curvature to a stop."""

    pose: Pose
    twist: Twist
    dt: float
    """How long the twist is held [s]."""
    length: float
    """Time after which holding the twist would have travelled as far as the whole manoeuvre [s]."""
    steps: float
    """Control steps that the braking takes."""
    max_speed: float
    """Largest speed of any point of the outline while the twist is held [m/s]."""
    stop: float
    """When the robot stands [s]."""


class MovingDisc(NamedTuple):
    """A disc that moves, or may: position [m] and velocity [m/s] now, in the world frame, radius
    [m], and what it may be off its course by: max_acceleration [m/s^2], velocity_error [m/s]."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float
    max_acceleration: float
    velocity_error: float


@jit_no_refcount
def manoeuvre(pose: Pose, twist: Twist, limits: Limits, dt: float, reach: float) -> Manoeuvre:
    """The manoeuvre that certifies a command. reach: the outline's farthest corner [m]."""
    steps = brake_steps(twist, limits, dt)
    return Manoeuvre(
        pose, twist, dt, dt + coasting(twist, limits, dt), steps,
        abs(twist.v) + abs(twist.omega) * reach, dt * (1.0 + math.ceil(steps)),
    )  # fmt: skip


@jit_no_refcount
def blocking_obstacle(
    m: Manoeuvre, outline: Floats, reach: float, obstacles: Surroundings, hard_margin: float
) -> int:
    """The first obstacle that the manoeuvre does not stay clear of, or CLEAR.

    Numbered as in `Surroundings`: discs, then segments, then points.

    Conservative advancement: a clearance g can not fall below hard_margin / 2 before outline and
    obstacle, each at its largest speed, have covered g - hard_margin / 2; the next check is then.
    So the clearance is at least hard_margin / 2 at every instant of the manoeuvre, not only at
    sampled ones. A static obstacle that starts nearer must not come nearer; one that can move
    keeps the robot at rest."""
    if m.max_speed == 0.0:
        return CLEAR  # a standing robot hits nothing
    far = reach + m.max_speed * m.length + hard_margin
    discs = obstacles.discs.shape[0]
    for i in range(discs):
        x, y, radius = obstacles.discs[i, X], obstacles.discs[i, Y], obstacles.discs[i, RADIUS]
        if is_static(obstacles, i):
            dx, dy = x - m.pose.x, y - m.pose.y
            near = dx * dx + dy * dy < (far + radius) * (far + radius)
            if near and not _clears_static(m, outline, x, y, x, y, radius, hard_margin):
                return i
            continue
        mover = MovingDisc(
            x, y, obstacles.discs[i, VX], obstacles.discs[i, VY], radius,
            obstacles.max_acceleration[i], obstacles.velocity_error[i],
        )  # fmt: skip
        if not _clears_mover(m, outline, reach, mover, hard_margin):
            return i
    for i in range(obstacles.segments.shape[0]):
        ax, ay = obstacles.segments[i, 0], obstacles.segments[i, 1]
        bx, by = obstacles.segments[i, 2], obstacles.segments[i, 3]
        near = _near(m.pose, ax, ay, bx, by, far)
        if near and not _clears_static(m, outline, ax, ay, bx, by, 0.0, hard_margin):
            return discs + i
    for i in range(obstacles.points.shape[0]):
        x, y = obstacles.points[i, 0], obstacles.points[i, 1]
        dx, dy = x - m.pose.x, y - m.pose.y
        near = dx * dx + dy * dy < far * far  # never for NaN
        if near and not _clears_static(m, outline, x, y, x, y, 0.0, hard_margin):
            return discs + obstacles.segments.shape[0] + i
    return CLEAR


@jit_no_refcount
def _clears_static(
    m: Manoeuvre, outline: Floats, ax: float, ay: float, bx: float, by: float, radius: float,
    hard_margin: float,
) -> bool:  # fmt: skip
    """A static obstacle, a segment with a radius: only the arc matters, not the timing on it.

    Two checks are at least a grain of the outline's travel apart. Between them the clearance can
    dip by half a grain, so the floor lies that much above hard_margin / 2; where this can happen,
    the moments at which the next command may come in are checked too. So every command finds at
    least the floor, or what the first one found, and repeated commands can not creep below it.
    1e-12 m is rounding.
    """
    grain = 0.125 * hard_margin
    floor = 0.5 * hard_margin + 0.5 * grain
    g = _clearance_at(m.pose, outline, ax, ay, bx, by) - radius
    allowed = hard_margin if g >= hard_margin else min(floor, g)
    s, k = 0.0, 1
    for _ in range(_MAX_CHECKS):
        left = m.length - s
        if left <= 0.0 or m.max_speed * left <= g - floor:
            return True
        ahead = s + max(g - floor, grain) / m.max_speed
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


@jit_no_refcount
def _travelled(m: Manoeuvre, t: float) -> float:
    """How long the twist would have to be held to travel as far as the manoeuvre by time t [s]."""
    if t <= m.dt:
        return t
    if t >= m.stop:
        return m.length
    k = math.floor((t - m.dt) / m.dt)
    share = max(1.0 - (k + 1.0) / m.steps, 0.0)
    before = m.dt * k * (1.0 - 0.5 * (k + 1.0) / m.steps) if k > 0 else 0.0  # 0 x inf
    return min(m.dt + before + share * (t - m.dt - k * m.dt), m.length)


@jit_no_refcount
def _clears_mover(
    m: Manoeuvre, outline: Floats, reach: float, mover: MovingDisc, hard_margin: float
) -> bool:
    """A moving disc, until the robot stands: it is within velocity_error t + max_acceleration
    t^2 / 2 of its course.

    The moments at which the next command may come in while it is nearer than hard_margin are
    checked too, so that only a robot that stood finds one as near: see `_moves_away`."""
    speed = math.sqrt(mover.vx * mover.vx + mover.vy * mover.vy)
    closing = m.max_speed + speed + mover.velocity_error + mover.max_acceleration * m.stop
    dx, dy = mover.x - m.pose.x, mover.y - m.pose.y
    g = math.sqrt(dx * dx + dy * dy) - reach - mover.radius
    if closing * m.stop <= g - hard_margin:
        return True
    if g < hard_margin:  # the circle around the outline is too coarse
        g = _clearance_at(m.pose, outline, mover.x, mover.y, mover.x, mover.y) - mover.radius
    if g < hard_margin:
        if g < 0.5625 * hard_margin:  # the floor of `_clears_static`
            return False
        return _moves_away(m, outline, mover, hard_margin, g, closing)
    t = 0.0
    for _ in range(_MAX_CHECKS):
        grown = mover.radius + position_bound(mover.velocity_error, mover.max_acceleration, t)
        x, y = mover.x + mover.vx * t, mover.y + mover.vy * t
        pose = arc(m.pose, m.twist, _travelled(m, t))
        dx, dy = x - pose.x, y - pose.y
        g = math.sqrt(dx * dx + dy * dy) - reach - grown
        if g < hard_margin:
            g = _clearance_at(pose, outline, x, y, x, y) - grown
        if g < hard_margin:
            return False
        if closing * (m.stop - t) <= g - hard_margin:
            return True
        soonest = math.ceil((t + (g - hard_margin) / closing) / m.dt - 1e-9)
        command = m.dt * max(soonest, math.floor(t / m.dt + 1e-9) + 1)
        t = min(t + (g - 0.5 * hard_margin) / closing, command, m.stop)
    return False


@jit_no_refcount
def _moves_away(
    m: Manoeuvre, outline: Floats, mover: MovingDisc, hard_margin: float, allowed: float,
    closing: float,
) -> bool:  # fmt: skip
    """Whether a moving disc whose clearance `allowed` is below hard_margin comes no nearer at any
    step.

    Between two checks the clearance stays above hard_margin / 2. Every step is a check, since the
    next command may come in there.
    """
    end = max(m.stop - m.dt, m.dt)  # in the last step of braking it stands
    t, k = 0.0, 1
    for _ in range(_MAX_CHECKS):
        g = _grown_clearance(m, outline, mover, t)
        if g < allowed - 1e-12:
            return False
        if t >= end:
            return True
        t = min(t + (g - 0.5 * hard_margin) / closing, end)
        if t >= k * m.dt:
            t, k = k * m.dt, k + 1
    return False


@jit_no_refcount
def _grown_clearance(m: Manoeuvre, outline: Floats, mover: MovingDisc, t: float) -> float:
    """Lower bound of the clearance to a moving disc at time t of the manoeuvre [m]."""
    pose = arc(m.pose, m.twist, _travelled(m, t))
    x, y = mover.x + mover.vx * t, mover.y + mover.vy * t
    off = position_bound(mover.velocity_error, mover.max_acceleration, t)
    return _clearance_at(pose, outline, x, y, x, y) - mover.radius - off


@jit_no_refcount
def _near(pose: Pose, ax: float, ay: float, bx: float, by: float, far: float) -> bool:
    """Whether a segment is nearer to the robot's origin than `far` [m]."""
    ex, ey = bx - ax, by - ay
    wx, wy = pose.x - ax, pose.y - ay
    square = ex * ex + ey * ey
    s = min(max((wx * ex + wy * ey) / square, 0.0), 1.0) if square > 0.0 else 0.0
    gx, gy = wx - s * ex, wy - s * ey
    return gx * gx + gy * gy < far * far


@jit_no_refcount
def _clearance_at(pose: Pose, outline: Floats, ax: float, ay: float, bx: float, by: float) -> float:
    """Clearance between the outline at a pose and a segment, which may be a point [m]."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    ux, uy = c * (ax - pose.x) + s * (ay - pose.y), -s * (ax - pose.x) + c * (ay - pose.y)
    if ax == bx and ay == by:
        return point_clearance(outline, ux, uy)
    wx, wy = c * (bx - pose.x) + s * (by - pose.y), -s * (bx - pose.x) + c * (by - pose.y)
    return wall_clearance(outline, ux, uy, wx, wy)
