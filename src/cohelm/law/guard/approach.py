"""Velocity bounds from each obstacle: do not approach it faster than you can stop."""

from __future__ import annotations

import math

from cohelm.core.jit import jit, jit_inline
from cohelm.core.scalars import is_finite
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, Twist, X, Y
from cohelm.law.guard.contact import NearestPoint, contact, overlap
from cohelm.law.guard.surroundings import Surroundings
from cohelm.robot.limits import Limits


@jit
def approach(h: float, deceleration: float, dt: float) -> float:
    """alpha(h): the approach speed from which a clearance h [m] is enough to stop, one step on.

    h = alpha T + alpha^2 / (2 a); without a limit of deceleration the whole clearance in one step.
    """
    if h <= 0.0:
        return 0.0
    if deceleration == math.inf:
        return h / dt
    a = deceleration
    return math.sqrt(a * a * dt * dt + 2.0 * a * h) - a * dt


@jit
def most_rows(around: Surroundings, outline: Floats) -> int:
    """The most rows that `approach_rows` writes."""
    return len(around.discs) + len(around.points) + len(around.segments) * (len(outline) + 2)


@jit
def approach_rows(
    rows: Floats, first: int, pose: Pose, before: Twist, around: Surroundings, outline: Floats,
    reach: float, limits: Limits, dt: float, margin: float, caution: float,
) -> tuple[int, float]:  # fmt: skip
    """Append a row of `project` for each contact that could matter; how many rows there are
    then, and the least clearance. -1 rows if a disc or segment is not a number.

    reach: the outline's farthest corner [m].
    """
    a = caution * min(limits.acceleration, limits.wheel_acceleration)
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    fast = _fastest(before, limits, reach, dt)
    n, least = first, math.inf
    far = _far(fast, a, dt, margin)
    discs = around.discs.shape[0]
    for i in range(discs):
        x, y, vx, vy, radius = _disc(around.discs, i)
        off = around.velocity_error[i]
        if not is_finite(x + y + vx + vy + radius + around.max_acceleration[i] + off):
            return -1, math.inf
        dx, dy = x - pose.x, y - pose.y
        speed = math.sqrt(vx * vx + vy * vy) + off
        reached = reach + radius + (far if speed == 0.0 else _far(fast + speed, a, dt, margin))
        if dx * dx + dy * dy < reached * reached:
            p = contact(outline, c * dx + s * dy, -s * dx + c * dy)
            clearance = p.clearance - radius
            least = min(least, clearance)
            toward = p.nx * (c * vx + s * vy) + p.ny * (-s * vx + c * vy) + off
            _row(rows, n, p, min(toward - approach(clearance - margin, a, dt), 0.0), i)
            n += 1
    walls = around.segments
    for i in range(walls.shape[0]):
        if not is_finite(walls[i, 0] + walls[i, 1] + walls[i, 2] + walls[i, 3]):
            return -1, math.inf
        dx, dy = walls[i, 0] - pose.x, walls[i, 1] - pose.y
        ex, ey = walls[i, 2] - pose.x, walls[i, 3] - pose.y
        ax, ay = c * dx + s * dy, -s * dx + c * dy
        bx, by = c * ex + s * ey, -s * ex + c * ey
        if _within(ax, ay, bx, by, far + reach):
            last = n
            n = _wall_rows(rows, n, outline, ax, ay, bx, by, far, discs + i)
            for k in range(last, n):  # they hold their clearance yet
                least = min(least, rows[k, 2])
                rows[k, 2] = -approach(rows[k, 2] - margin, a, dt)
    points = discs + walls.shape[0]
    far += reach
    for i in range(around.points.shape[0]):
        dx, dy = around.points[i, 0] - pose.x, around.points[i, 1] - pose.y
        if dx * dx + dy * dy < far * far:  # never for NaN
            p = contact(outline, c * dx + s * dy, -s * dx + c * dy)
            least = min(least, p.clearance)
            _row(rows, n, p, -approach(p.clearance - margin, a, dt), points + i)
            n += 1
    return n, least


@jit_inline
def _disc(discs: Floats, i: int) -> tuple[float, float, float, float, float]:
    """One row, without a view of it, which would be counted."""
    return discs[i, X], discs[i, Y], discs[i, VX], discs[i, VY], discs[i, RADIUS]


@jit
def _fastest(before: Twist, limits: Limits, reach: float, dt: float) -> float:
    """The fastest any point of the outline can be one step on [m/s]."""
    dv = min(limits.acceleration, limits.wheel_acceleration) * dt
    domega = min(limits.yaw_acceleration, 2.0 * limits.wheel_acceleration / limits.track) * dt
    fast = min(abs(before.v) + dv, limits.speed, limits.wheel_speed)
    if reach > 0.0:  # 0 x inf
        fast += reach * min(abs(before.omega) + domega, limits.yaw_rate)
    return fast


@jit
def _far(speed: float, a: float, dt: float, margin: float) -> float:
    """The clearance beyond which nothing at this closing speed can break a bound [m]."""
    stopping = 0.0 if a == math.inf else speed * speed / (2.0 * a)
    return margin + speed * dt + stopping


@jit
def _row(rows: Floats, n: int, p: NearestPoint, b: float, owner: int) -> None:
    """n . (v - omega q_y, omega q_x) >= b, of a contact."""
    rows[n, 0] = p.nx
    rows[n, 1] = p.ny * p.qx - p.nx * p.qy
    rows[n, 2] = b
    rows[n, 3] = owner


@jit
def _wall_rows(
    rows: Floats, n: int, outline: Floats, ax: float, ay: float, bx: float, by: float, far: float,
    owner: int,
) -> int:  # fmt: skip
    """A wall's two ends against the outline, and the outline's corners against the wall; if
    they cross, the shortest way out. Rows with the clearance in place of b; how many there are."""
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


@jit
def _within(ax: float, ay: float, bx: float, by: float, far: float) -> bool:
    """Whether a segment comes nearer to the origin than `far`."""
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    t = min(max(-(ax * ex + ay * ey) / square, 0.0), 1.0) if square > 0.0 else 0.0
    x, y = ax + t * ex, ay + t * ey
    return x * x + y * y < far * far
