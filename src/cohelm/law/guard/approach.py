"""Velocity bounds from each obstacle: do not approach it faster than the robot can stop."""

from __future__ import annotations

import math

from cohelm.core.jit import jit_inline, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.scalars import is_finite
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.contact import NearestPoint, contact, overlap
from cohelm.robot.limits import Limits


@jit_no_refcount
def approach(h: float, deceleration: float, dt: float) -> float:
    """alpha(h): the approach speed from which clearance h [m] is enough to stop, one step later.

    h = alpha T + alpha^2 / (2 a); without a limit of deceleration the whole clearance in one step.
    """
    if h <= 0.0:
        return 0.0
    if deceleration == math.inf:
        return h / dt
    a = deceleration
    return math.sqrt(a * a * dt * dt + 2.0 * a * h) - a * dt


@jit_no_refcount
def max_rows(obstacles: Surroundings, outline: Floats) -> int:
    """Upper bound of the number of rows that `approach_rows` writes."""
    return (
        len(obstacles.discs) + len(obstacles.points) + len(obstacles.segments) * (len(outline) + 2)
    )


@jit_no_refcount
def approach_rows(
    rows: Floats, first: int, pose: Pose, before: Twist, obstacles: Surroundings, outline: Floats,
    reach: float, limits: Limits, dt: float, margin: float, deceleration_fraction: float,
) -> tuple[int, float]:  # fmt: skip
    """Append a row of `project` for each relevant contact; returns the number of rows then, and
    the smallest clearance. -1 rows if a disc or segment is not finite.

    reach: the outline's farthest corner [m].
    """
    a = deceleration_fraction * min(limits.acceleration, limits.wheel_acceleration)
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    outline_speed = _outline_speed(before, limits, reach, dt)
    n, min_clearance = first, math.inf
    far = _far(outline_speed, a, dt, margin)
    discs = obstacles.discs.shape[0]
    for i in range(discs):
        x, y, vx, vy, radius = _disc(obstacles.discs, i)
        velocity_error = obstacles.velocity_error[i]
        if not is_finite(x + y + vx + vy + radius + obstacles.max_acceleration[i] + velocity_error):
            return -1, math.inf
        dx, dy = x - pose.x, y - pose.y
        reached = reach + radius + far
        if abs(vx) + abs(vy) + abs(velocity_error) != 0.0:
            speed = math.sqrt(vx * vx + vy * vy) + velocity_error
            reached = reach + radius + _far(outline_speed + speed, a, dt, margin)
        if dx * dx + dy * dy < reached * reached:
            p = contact(outline, c * dx + s * dy, -s * dx + c * dy)
            clearance = p.clearance - radius
            min_clearance = min(min_clearance, clearance)
            toward = p.nx * (c * vx + s * vy) + p.ny * (-s * vx + c * vy) + velocity_error
            _row(rows, n, p, min(toward - approach(clearance - margin, a, dt), 0.0), i)
            n += 1
    segments = obstacles.segments
    for i in range(segments.shape[0]):
        if not is_finite(segments[i, 0] + segments[i, 1] + segments[i, 2] + segments[i, 3]):
            return -1, math.inf
        dx, dy = segments[i, 0] - pose.x, segments[i, 1] - pose.y
        ex, ey = segments[i, 2] - pose.x, segments[i, 3] - pose.y
        ax, ay = c * dx + s * dy, -s * dx + c * dy
        bx, by = c * ex + s * ey, -s * ex + c * ey
        if _within(ax, ay, bx, by, far + reach):
            last = n
            n = _wall_rows(rows, n, outline, ax, ay, bx, by, far, discs + i)
            for k in range(last, n):  # column 2 still holds the clearance
                min_clearance = min(min_clearance, rows[k, 2])
                rows[k, 2] = -approach(rows[k, 2] - margin, a, dt)
    points = discs + segments.shape[0]
    far += reach
    for i in range(obstacles.points.shape[0]):
        dx, dy = obstacles.points[i, 0] - pose.x, obstacles.points[i, 1] - pose.y
        if dx * dx + dy * dy < far * far:  # never for NaN
            p = contact(outline, c * dx + s * dy, -s * dx + c * dy)
            min_clearance = min(min_clearance, p.clearance)
            _row(rows, n, p, -approach(p.clearance - margin, a, dt), points + i)
            n += 1
    return n, min_clearance


@jit_inline
def _disc(discs: Floats, i: int) -> tuple[float, float, float, float, float]:
    """One row, without a view of it, which would be reference-counted."""
    return discs[i, X], discs[i, Y], discs[i, VX], discs[i, VY], discs[i, RADIUS]


@jit_no_refcount
def _outline_speed(before: Twist, limits: Limits, reach: float, dt: float) -> float:
    """Largest speed of any point of the outline one step later [m/s]."""
    dv = min(limits.acceleration, limits.wheel_acceleration) * dt
    domega = min(limits.yaw_acceleration, 2.0 * limits.wheel_acceleration / limits.track) * dt
    outline_speed = min(abs(before.v) + dv, limits.speed, limits.wheel_speed)
    if reach > 0.0:  # 0 x inf
        outline_speed += reach * min(abs(before.omega) + domega, limits.yaw_rate)
    return outline_speed


@jit_no_refcount
def _far(speed: float, a: float, dt: float, margin: float) -> float:
    """The clearance beyond which no obstacle at this closing speed can violate a bound [m]."""
    stopping = 0.0 if a == math.inf else speed * speed / (2.0 * a)
    return margin + speed * dt + stopping


@jit_no_refcount
def _row(rows: Floats, n: int, p: NearestPoint, b: float, owner: int) -> None:
    """n . (v - omega q_y, omega q_x) >= b, of a contact."""
    rows[n, 0] = p.nx
    rows[n, 1] = p.ny * p.qx - p.nx * p.qy
    rows[n, 2] = b
    rows[n, 3] = owner


@jit_no_refcount
def _wall_rows(
    rows: Floats, n: int, outline: Floats, ax: float, ay: float, bx: float, by: float, far: float,
    owner: int,
) -> int:  # fmt: skip
    """Rows of a segment's ends against the outline and of the outline's corners against the
    segment; if they cross, of the shortest way out. The clearance stands in place of b. Returns
    the number of rows."""
    out = overlap(outline, ax, ay, bx, by)
    if out.clearance < 0.0:
        _row(rows, n, out, out.clearance, owner)
        return n + 1
    if out.clearance >= far:
        return n
    for end in range(2):
        x, y = (ax, ay) if end == 0 else (bx, by)
        p = contact(outline, x, y)
        if p.clearance < far:
            _row(rows, n, p, p.clearance, owner)
            n += 1
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    length = math.sqrt(square)
    for i in range(outline.shape[0]):
        wx, wy = outline[i, 0] - ax, outline[i, 1] - ay
        if 0.0 < wx * ex + wy * ey < square:
            across = (wx * ey - wy * ex) / length
            side = 1.0 if across >= 0.0 else -1.0
            p = NearestPoint(
                abs(across), outline[i, 0], outline[i, 1], side * ey / length, -side * ex / length
            )
            if p.clearance < far:
                _row(rows, n, p, p.clearance, owner)
                n += 1
    return n


@jit_no_refcount
def _within(ax: float, ay: float, bx: float, by: float, far: float) -> bool:
    """Whether a segment comes nearer to the origin than `far`."""
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    t = min(max(-(ax * ex + ay * ey) / square, 0.0), 1.0) if square > 0.0 else 0.0
    x, y = ax + t * ex, ay + t * ey
    return x * x + y * y < far * far
