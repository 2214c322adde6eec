"""Adversarial rollout: an attacker's stick against one filter, in one compiled call.

There is no reference and no blending. The stick's full deflection requests the robot's full speed
and yaw rate; the filter shapes that.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.obstacles import Surroundings
from cohelm.core.types import RADIUS, SAFE, VX, VY, Floats, Pose, Stick, Twist, X, Y
from cohelm.law.barrier import barrier
from cohelm.law.gains import Gains
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import guard
from cohelm.robot.achievable import achievable
from cohelm.robot.clearance import circumscribed_radius
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.sim.judge import FAR, least_clearance
from cohelm.sim.operator_model import uniform
from cohelm.sim.world import from_wall

GUARD, PAPER, NO_LAW = range(3)
"""Which filter: the guard, the paper's barrier, or none but the wheels' limits."""

RAM, BANG, SPIN, SCRIPT = range(4)
"""RAM: at the nearest thing, two seconds of three, and BANG in between. BANG: any deflection,
changed at random about every 0.4 s, full ones preferred. SPIN: full turns, now and then a lunge
ahead or back. SCRIPT: deflections from a table."""

TURNS = 10
"""Steps for which a walker keeps what it does."""


class AdversarialScene(NamedTuple):
    """What there is to hit.

    discs: (n, 6) at t = 0. max_acceleration: (n,), acceleration that a disc uses and is assumed to
    be capable of [m/s^2]; 0 for one at rest. walk: the walkers' largest speed [m/s]. walls: (s, 4).
    points: (p, 2), things of no size, known as LiDAR returns.
    """

    discs: Floats
    max_acceleration: Floats
    walk: float
    walls: Floats
    points: Floats


class Attack(NamedTuple):
    """How the stick moves. seed: of everything random. script: (k, 2) deflections fore-aft and
    left-right, each held for `hold` [s]; the last one to the end."""

    kind: int
    seed: int
    script: Floats
    hold: float


@jit
def rollout(
    start: Pose, scene: AdversarialScene, attack: Attack, law: int, gains: Gains, outline: Floats,
    limits: Limits, rules: Rules, steps: int, rows: NDArray[np.void], h: Floats, discs: Floats,
) -> float:  # fmt: skip
    """The smallest clearance while the robot moves [m], at most FAR, over `steps` control steps.

    rows (n,), h (n, m), discs (n, m, 6), m = discs and points of the scene: the trace, or of
    length 0 for none. The paper's r_i is taken from the scene's discs; of a point it is the
    outline's reach.
    """
    dt = rules.dt
    n = len(scene.discs)
    m = n + len(scene.points)
    reach = circumscribed_radius(outline)
    now, after, between = np.zeros((m, 6)), np.zeros((m, 6)), np.zeros((m, 6))
    for i in range(n):
        now[i] = scene.discs[i]
    for i in range(n, m):
        now[i, X], now[i, Y] = scene.points[i - n, 0], scene.points[i - n, 1]
        now[i, SAFE] = reach
    after[:] = now
    push, sure = np.zeros((n, 2)), np.zeros(n)
    pose, applied, stick = start, Twist(0.0, 0.0), Stick(0.0, 0.0)
    least = FAR
    for k in range(steps):
        stick = deflection(attack, stick, k, dt, pose, now, scene.walls)
        nominal = Twist(stick.x * limits.speed, stick.psi * limits.yaw_rate)
        verdict, limiting = 0, -1
        if law == GUARD:
            surrounding = Surroundings(
                now[:n], scene.max_acceleration, sure, scene.walls, scene.points
            )
            passed = guard(pose, applied, nominal, surrounding, outline, limits, rules, False)
            twist = command = passed.twist
            verdict, limiting = passed.verdict, passed.limiting
        else:
            command = nominal
            if law == PAPER:
                avoid = barrier(pose, nominal, now, gains)
                command = Twist(nominal.v + avoid.input.v, nominal.omega + avoid.input.omega)
                verdict, limiting = avoid.verdict, avoid.limiting
            twist = achievable(command, applied, limits, dt)
        for i in range(n):
            if scene.max_acceleration[i] > 0.0:
                if k % TURNS == 0:
                    choose(push, i, scene.max_acceleration[i], pose, now[i], attack.seed, k)
                walk_on(after[i], now[i], push[i, 0], push[i, 1], scene.walk, dt)
        if len(rows) > 0:
            note(rows[k], k * dt, pose, stick, nominal, command, twist, verdict, limiting)
            for i in range(m):
                discs[k, i] = now[i]
                dx, dy = pose.x - now[i, X], pose.y - now[i, Y]
                h[k, i] = dx * dx + dy * dy - now[i, SAFE] * now[i, SAFE]
            rows[k].h = h[k].min() if m > 0 else math.inf
        clearance = least_clearance(
            pose, twist, dt, now, after, between, outline, reach, scene.walls, least
        )  # fmt: skip
        if len(rows) > 0:
            rows[k].clearance = clearance
        if twist.v != 0.0 or twist.omega != 0.0:
            least = min(least, clearance)
        pose, applied = arc(pose, twist, dt), twist
        now, after = after, now
        after[:] = now
    return least


@jit_inline
def deflection(
    attack: Attack, before: Stick, k: int, dt: float, pose: Pose, discs: Floats, walls: Floats
) -> Stick:
    """Where the attacker holds the stick in step k."""
    kind = attack.kind
    if kind == SCRIPT:
        i = min(int(k * dt / attack.hold), len(attack.script) - 1)
        return Stick(attack.script[i, 0], attack.script[i, 1])
    if kind == RAM and (k * dt) % 3.0 < 2.0:
        dx, dy = _nearest(pose, discs, walls)
        turn = math.atan2(dy, dx) - pose.psi
        return Stick(math.cos(turn), math.sin(turn))
    if k > 0 and uniform(attack.seed, 4 * k) > 0.05:
        return before
    b, c = uniform(attack.seed, 4 * k + 1), uniform(attack.seed, 4 * k + 2)
    if kind == SPIN:
        x = 0.0 if b < 0.5 else (0.1 if b < 0.7 else (1.0 if b < 0.9 else -1.0))
        return Stick(x, 1.0 if c < 0.45 else (-1.0 if c < 0.9 else 0.0))
    x = 1.0 if b < 0.35 else (-1.0 if b < 0.7 else 2.0 * c - 1.0)
    d = uniform(attack.seed, 4 * k + 3)
    return Stick(x, 1.0 if d < 0.3 else (-1.0 if d < 0.6 else 5.0 * d - 4.0))


@jit_inline
def _nearest(pose: Pose, discs: Floats, walls: Floats) -> tuple[float, float]:
    """From the robot's centre to the nearest surface, or the centre of the disc it belongs to."""
    best, x, y = math.inf, 1.0, 0.0
    for i in range(len(discs)):
        dx, dy = discs[i, X] - pose.x, discs[i, Y] - pose.y
        far = math.sqrt(dx * dx + dy * dy) - discs[i, RADIUS]
        if far < best:
            best, x, y = far, dx, dy
    for i in range(len(walls)):
        dx, dy = from_wall(pose, walls, i)
        far = math.sqrt(dx * dx + dy * dy)
        if far < best:
            best, x, y = far, -dx, -dy
    return x, y


@jit_inline
def choose(
    push: Floats, i: int, max_acceleration: float, pose: Pose, disc: Floats, seed: int, k: int
) -> None:
    """What walker i does next: half of the time it goes at the robot, else anywhere."""
    turn = math.atan2(pose.y - disc[Y], pose.x - disc[X])
    if uniform(seed + 1 + i, 2 * k) < 0.5:
        turn = 2.0 * math.pi * uniform(seed + 1 + i, 2 * k + 1)
    push[i, 0], push[i, 1] = max_acceleration * math.cos(turn), max_acceleration * math.sin(turn)


@jit_inline
def walk_on(after: Floats, now: Floats, ax: float, ay: float, walk: float, dt: float) -> None:
    """One step at constant acceleration, cut where it would lead beyond the largest speed."""
    vx, vy = now[VX] + ax * dt, now[VY] + ay * dt
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > walk:
        vx, vy = vx * walk / speed, vy * walk / speed
    after[X] = now[X] + 0.5 * dt * (now[VX] + vx)
    after[Y] = now[Y] + 0.5 * dt * (now[VY] + vy)
    after[VX], after[VY] = vx, vy


@jit_inline
def note(
    row: Any, t: float, pose: Pose, stick: Stick, nominal: Twist, command: Twist, twist: Twist,
    verdict: int, limiting: int,
) -> None:  # fmt: skip
    """One step into the trace; there is no reference, so the desired pose is the robot's own."""
    row.t = t
    row.x, row.y, row.psi = pose.x, pose.y, pose.psi
    row.x_d, row.y_d, row.psi_d = pose.x, pose.y, pose.psi
    row.stick_x, row.stick_psi = stick.x, stick.psi
    row.safe_v, row.safe_omega = command.v, command.omega
    row.operator_v, row.operator_omega = nominal.v, nominal.omega
    row.nominal_v, row.nominal_omega = nominal.v, nominal.omega
    row.avoid_v, row.avoid_omega = command.v - nominal.v, command.omega - nominal.omega
    row.verdict, row.limiting = verdict, limiting
    row.applied_v, row.applied_omega = twist.v, twist.omega
    row.saturated = twist.v != command.v or twist.omega != command.omega
