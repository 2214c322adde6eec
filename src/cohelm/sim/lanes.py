"""Robots side by side: the steps in which nothing happens, for many robots at once.

Most steps of most robots are ordinary: the hand is off the stick and the wheels can do what is
asked. For these the law is a chain of sums and products without a branch,
which the processor does for several robots in one instruction. It is the very same functions in
the same order as in `sim.loop.turn`, so the numbers are the same to the last bit. A robot for which
any of that does not hold is marked, keeps its state, and takes the step in `turn`.

Every loop over robots runs over all LANES and reads and writes rows of one array, whose places are
known at compile time: only then does the compiler know that the rows do not overlap.
"""

from __future__ import annotations

import math

from cohelm.core.facing import NEAR, Facing, facing, facing_near
from cohelm.core.jit import jit_apart, jit_inline
from cohelm.core.types import RADIUS, SAFE, VX, VY, Desired, Floats, Pose, Twist, is_finite
from cohelm.law.barrier import (
    Sums,
    added,
    growth,
    none_yet,
    part_of_growth,
    passes,
    shapes,
    steering,
    turning,
    with_disc,
)
from cohelm.law.track import pose_error_square, tracked
from cohelm.robot.footprint import INSIDE, Outside, outside_gap, past_edge
from cohelm.robot.kinematics import bends_little, gentle_arc
from cohelm.robot.limits import Limits, allowed

LANES = 32
"""Robots that one thread takes through time side by side."""

(
    AT_X, AT_Y, AT_PSI, V, OMEGA, STICK_X, STICK_PSI,
    ERROR_MAX, ERROR_SUM, ERROR_END, H_MIN, CLEARANCE, V_MAX, OMEGA_MAX, PATH,
    SHAPED_STEPS, HEADED_STEPS,
    COS, SIN, B, ALONG, MOTION, SMALLEST, CLOSE, ODD, AREA, LENGTH, CORNER,
    WISH_V, WISH_OMEGA, I_, J_, ACTS, MOST, HEADED, STEER,
    K_X, K_PSI, K, C, K_CBF, SIGN, FILTERED, DEAD_BAND,
    SIZE,
) = range(0, 45 * LANES, LANES)  # fmt: skip
"""Where the rows of a group's array begin, (SIZE,): where each robot is and what its wheels do; its
stick; scores so far (squares of E_P); what one step works out; and what stays the same."""


@jit_inline
def pose_of(lanes: Floats, j: int) -> Pose:
    """Where robot j is."""
    return Pose(lanes[AT_X + j], lanes[AT_Y + j], lanes[AT_PSI + j])


@jit_inline
def put(lanes: Floats, j: int, pose: Pose, applied: Twist) -> None:
    """Write where robot j is and what its wheels do."""
    lanes[AT_X + j], lanes[AT_Y + j], lanes[AT_PSI + j] = pose.x, pose.y, pose.psi
    lanes[V + j], lanes[OMEGA + j] = applied.v, applied.omega


@jit_apart
def gather(lanes: Floats, discs: Floats, walls: Floats, outline: Floats, reach: float) -> None:
    """Each robot's heading, what its discs add up to in (22)-(27), and whether it is CLOSE.

    discs: (m, 6, LANES), columns as in `core.types`. walls: (s, 5, LANES), first end, the vector
    to the other and 1 over its square. One that is not there is at FAR. reach: the outline's
    farthest corner [m]. CLEARANCE is brought up to date but for robots that are CLOSE: near a
    wall, or upon a disc.
    """
    for j in range(LANES):
        at = facing_near(lanes[AT_PSI + j])
        sums = none_yet(at)
        lanes[COS + j], lanes[SIN + j] = at.cos, at.sin
        lanes[B + j], lanes[ALONG + j] = sums.B, sums.along
        lanes[MOTION + j], lanes[SMALLEST + j], lanes[CLOSE + j] = sums.motion, sums.smallest, 0.0
    for i in range(len(discs) // (6 * LANES)):
        disc = discs[6 * LANES * i : 6 * LANES * (i + 1)]
        count = 0
        for j in range(LANES):
            sums = Sums(lanes[B + j], lanes[ALONG + j], lanes[MOTION + j], lanes[SMALLEST + j])
            at = Facing(lanes[COS + j], lanes[SIN + j])
            dx, dy = lanes[AT_X + j] - disc[j], lanes[AT_Y + j] - disc[LANES + j]
            sums = with_disc(
                sums, at, dx, dy,
                disc[VX * LANES + j], disc[VY * LANES + j], disc[SAFE * LANES + j],
            )  # fmt: skip
            lanes[B + j], lanes[ALONG + j] = sums.B, sums.along
            lanes[MOTION + j], lanes[SMALLEST + j] = sums.motion, sums.smallest
            near = max(lanes[CLEARANCE + j] + reach + disc[RADIUS * LANES + j] + _HAIR, 0.0)
            count += 1 if dx * dx + dy * dy < near * near else 0
        if count > 0:
            _clearance(lanes, disc, outline)
    for i in range(len(walls) // (5 * LANES)):
        wall = walls[5 * LANES * i : 5 * LANES * (i + 1)]
        for j in range(LANES):
            wx, wy = lanes[AT_X + j] - wall[j], lanes[AT_Y + j] - wall[LANES + j]
            ex, ey = wall[2 * LANES + j], wall[3 * LANES + j]
            along = min(max((wx * ex + wy * ey) * wall[4 * LANES + j], 0.0), 1.0)
            wx, wy = wx - along * ex, wy - along * ey
            near = max(lanes[CLEARANCE + j] + reach + _HAIR, 0.0)
            lanes[CLOSE + j] = 1.0 if wx * wx + wy * wy < near * near else lanes[CLOSE + j]


_HAIR = 1e-9  # more than the rounding of a distance [m]


@jit_apart
def _clearance(lanes: Floats, disc: Floats, outline: Floats) -> None:
    """`robot.footprint.disc_clearance` for one disc; a centre within the outline is left CLOSE."""
    for j in range(LANES):
        out = INSIDE
        lanes[AREA + j], lanes[LENGTH + j], lanes[CORNER + j] = out.area, out.length, out.corner
    k = outline.shape[0]
    for i in range(k):
        e = i + 1 if i + 1 < k else 0
        ax, ay, bx, by = outline[i, 0], outline[i, 1], outline[e, 0], outline[e, 1]
        for j in range(LANES):
            c, s = lanes[COS + j], lanes[SIN + j]
            dx, dy = disc[j] - lanes[AT_X + j], disc[LANES + j] - lanes[AT_Y + j]
            out = Outside(lanes[AREA + j], lanes[LENGTH + j], lanes[CORNER + j])
            out = past_edge(out, ax, ay, bx, by, c * dx + s * dy, -s * dx + c * dy)
            lanes[AREA + j], lanes[LENGTH + j], lanes[CORNER + j] = out.area, out.length, out.corner
    for j in range(LANES):
        gap = outside_gap(Outside(lanes[AREA + j], lanes[LENGTH + j], lanes[CORNER + j]))
        lanes[CLEARANCE + j] = min(lanes[CLEARANCE + j], gap - disc[RADIUS * LANES + j])
        lanes[CLOSE + j] = 1.0 if gap == math.inf else lanes[CLOSE + j]


FAR = 1e160
"""Where a disc is that is not there [m]: its h is infinite, and it adds nothing to any sum."""


@jit_inline
def spread_discs(spread: Floats, j: int, discs: Floats) -> None:
    """Write the discs of robot j, (n, 6), into (m, 6, LANES); the rest of the m are not there."""
    for i in range(len(spread) // (6 * LANES)):
        disc = spread[6 * LANES * i : 6 * LANES * (i + 1)]
        for column in range(6):
            disc[column * LANES + j] = discs[i, column] if i < len(discs) else 0.0
        if i >= len(discs):
            disc[j] = FAR


@jit_inline
def spread_walls(spread: Floats, j: int, walls: Floats) -> None:
    """Write the walls of robot j, (n, 4), into (s, 5, LANES); the rest of the s are not there."""
    for i in range(len(spread) // (5 * LANES)):
        wall = spread[5 * LANES * i : 5 * LANES * (i + 1)]
        x, y, ex, ey = FAR, 0.0, 0.0, 0.0
        if i < len(walls):
            x, y = walls[i, 0], walls[i, 1]
            ex, ey = walls[i, 2] - x, walls[i, 3] - y
        square = ex * ex + ey * ey
        wall[j], wall[LANES + j] = x, y
        wall[2 * LANES + j], wall[3 * LANES + j] = ex, ey
        wall[4 * LANES + j] = 1.0 / square if square > 0.0 else 0.0


@jit_inline
def score_error(lanes: Floats, j: int, desired: Desired) -> None:
    """Robot j's pose error (51), before the step."""
    error = pose_error_square(pose_of(lanes, j), desired)
    lanes[ERROR_MAX + j] = max(lanes[ERROR_MAX + j], error)
    lanes[ERROR_SUM + j] += error
    lanes[ERROR_END + j] = error


@jit_apart
def wishes(lanes: Floats, desired: Desired) -> int:
    """What each robot is asked to do, whether its filter ACTS, or is ODD; how many act."""
    to = facing(desired.psi)
    count = 0
    for j in range(LANES):
        pose = pose_of(lanes, j)
        at = Facing(lanes[COS + j], lanes[SIN + j])
        sums = Sums(lanes[B + j], lanes[ALONG + j], lanes[MOTION + j], lanes[SMALLEST + j])
        wish = tracked(pose, at, desired, to, lanes[K_X + j], lanes[K_PSI + j])
        wish = Twist(wish.v + 0.0, wish.omega + 0.0)  # as the blend makes it: no minus zero
        I, J = growth(sums, at, wish, lanes[SIGN + j], lanes[K + j], lanes[C + j])
        across = turning(at)
        acts = shapes(I, J, sums.smallest, sums.along * sums.along + across * across)
        acts &= lanes[FILTERED + j] != 0.0
        free = passes(I, J, sums.smallest) | (lanes[FILTERED + j] == 0.0)
        hands_off = (abs(lanes[STICK_X + j]) <= lanes[DEAD_BAND + j]) & (
            abs(lanes[STICK_PSI + j]) <= lanes[DEAD_BAND + j]
        )
        near = abs(pose.psi) <= NEAR
        lanes[WISH_V + j], lanes[WISH_OMEGA + j] = wish.v, wish.omega
        lanes[I_ + j], lanes[J_ + j] = I, J
        lanes[ACTS + j] = 1.0 if acts else 0.0
        lanes[ODD + j] = 0.0 if (free | acts) & hands_off & near else 1.0
        count += 1 if acts else 0
        score_error(lanes, j, desired)
    return count


@jit_apart
def filtered(lanes: Floats, discs: Floats) -> None:
    """The input of the filter, added to the wishes of those for whom it ACTS."""
    for j in range(LANES):
        lanes[MOST + j] = turning(Facing(lanes[COS + j], lanes[SIN + j])) * lanes[WISH_OMEGA + j]
        lanes[HEADED + j] = lanes[ACTS + j]
        if lanes[ACTS + j] != 0.0:
            lanes[STEER + j] = steering(lanes[K_CBF + j], lanes[SMALLEST + j])
    for i in range(len(discs) // (6 * LANES)):
        disc = discs[6 * LANES * i : 6 * LANES * (i + 1)]
        for j in range(LANES):
            dx, dy = lanes[AT_X + j] - disc[j], lanes[AT_Y + j] - disc[LANES + j]
            part = part_of_growth(
                Facing(lanes[COS + j], lanes[SIN + j]), lanes[WISH_V + j], lanes[SIGN + j], dx, dy,
                disc[VX * LANES + j], disc[VY * LANES + j], disc[SAFE * LANES + j],
            )  # fmt: skip
            lanes[HEADED + j] = 0.0 if part > lanes[MOST + j] else lanes[HEADED + j]
    for j in range(LANES):
        acts = lanes[ACTS + j] != 0.0
        across = turning(Facing(lanes[COS + j], lanes[SIN + j]))
        u = added(lanes[I_ + j], lanes[J_ + j], lanes[ALONG + j], across, lanes[STEER + j])
        lanes[WISH_V + j] += u.v if acts else 0.0
        lanes[WISH_OMEGA + j] += u.omega if acts else 0.0


@jit_apart
def ordinary(lanes: Floats, queue: Floats, slot: int, limits: Limits, dt: float) -> None:
    """One step for every robot whose step is ordinary; the others are marked ODD and wait.

    queue: (d, 2, LANES), commands still on their way; `slot` is the one that arrives.
    """
    late = len(queue) > 0
    due = queue[2 * LANES * slot : 2 * LANES * (slot + 1)]
    for j in range(LANES):
        pose = pose_of(lanes, j)
        before = Twist(lanes[V + j], lanes[OMEGA + j])
        command = Twist(lanes[WISH_V + j], lanes[WISH_OMEGA + j])
        arriving = Twist(due[j], due[LANES + j]) if late else command
        sound = is_finite(command.v) & is_finite(command.omega)
        gentle = bends_little(0.5 * arriving.omega * dt)
        able = allowed(arriving, before, limits, dt)
        ok = (lanes[ODD + j] == 0.0) & sound & gentle & able
        lanes[ODD + j] = 0.0 if ok else 1.0
        after = gentle_arc(pose, Facing(lanes[COS + j], lanes[SIN + j]), arriving, dt)
        lanes[AT_X + j] = after.x if ok else pose.x
        lanes[AT_Y + j] = after.y if ok else pose.y
        lanes[AT_PSI + j] = after.psi if ok else pose.psi
        lanes[V + j] = arriving.v if ok else before.v
        lanes[OMEGA + j] = arriving.omega if ok else before.omega
        if late:
            due[j] = command.v if ok else due[j]
            due[LANES + j] = command.omega if ok else due[LANES + j]
        h = lanes[SMALLEST + j] if lanes[FILTERED + j] != 0.0 else math.inf
        lanes[H_MIN + j] = min(lanes[H_MIN + j], h) if ok else lanes[H_MIN + j]
        lanes[V_MAX + j] = max(lanes[V_MAX + j], abs(command.v)) if ok else lanes[V_MAX + j]
        omega = max(lanes[OMEGA_MAX + j], abs(command.omega))
        lanes[OMEGA_MAX + j] = omega if ok else lanes[OMEGA_MAX + j]
        lanes[PATH + j] += abs(arriving.v) * dt if ok else 0.0
        lanes[SHAPED_STEPS + j] += lanes[ACTS + j] if ok else 0.0
        lanes[HEADED_STEPS + j] += lanes[ACTS + j] * lanes[HEADED + j] if ok else 0.0
