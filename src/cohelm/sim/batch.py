"""Many robots at once, over all cores: the same closed loop, keeping only what is scored."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit, jit_inline, jit_parallel
from cohelm.core.types import Desired, Floats, Ints, Pose
from cohelm.law.barrier import HEADING, INVALID, SHAPED, UNTOUCHED
from cohelm.law.gains import Gains, table
from cohelm.law.reference import Reference, tabulate
from cohelm.law.track import pose_error
from cohelm.robot.limits import Limits
from cohelm.sim.hand import IDLE, Operator, Replay, operate, operator_table, replay, replayed
from cohelm.sim.loop import at_rest, turn
from cohelm.sim.world import NOWHERE, World, clearance, moves, place, world

OUTCOME = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("psi", "f8"),  # pose at the end
        ("e_p_max", "f8"), ("e_p_rms", "f8"), ("e_p_end", "f8"),  # pose error (51)
        ("h_min", "f8"),  # smallest h_i [m^2]
        ("clearance_min", "f8"),  # real outline to the nearest disc or wall [m] (E7)
        ("v_max", "f8"), ("omega_max", "f8"),  # largest command asked (E5) [m/s, rad/s]
        ("path", "f8"),  # length driven [m]
        ("saturated", "i8"),  # steps in which the limits changed the command (E5)
        ("shaped", "i8"),  # steps in which the filter acted
        ("heading", "i8"),  # of those, for the heading term and no obstacle (E6)
        ("invalid", "i8"),  # steps stopped for a number that was not finite
        ("human", "f8"),  # mean human share 1 - K_c (surge axis)
    ],
    align=True,
)  # fmt: skip
"""What is kept of each robot's run."""


@dataclass(frozen=True)
class Batch:
    """Runs that share a reference, an outline and a clock, and differ in all else.

    Every per-robot list or array has either one row, shared by all, or `robots` rows; robot i
    sees world i and hand i, or the only one.
    """

    starts: Floats
    """(robots, 3) poses, world frame [m, m, rad]."""
    reference: Reference
    outline: Floats
    limits: Limits
    gains: list[Gains] = field(default_factory=lambda: [Gains()])
    worlds: World = field(default_factory=lambda: world(([], np.empty((0, 4)))))
    hands: Replay = field(default_factory=replay)
    operators: list[Operator] = field(default_factory=lambda: [Operator()])
    seeds: Ints = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    spline_speed: bool = False
    dt: float = 0.01
    duration: float | None = None
    """[s]; by default that of the reference."""
    delay: float = 0.0
    """From command to wheels, rounded to whole steps [s]."""


def run_batch(batch: Batch, threads: int | None = None) -> NDArray[np.void]:
    """Run every robot of a batch: (robots,) of dtype OUTCOME.

    The result does not depend on the number of threads: each robot's randomness comes from its
    own seed and the step number alone. Raises CohelmError where the numbers of rows disagree.
    """
    starts = np.ascontiguousarray(batch.starts, dtype=np.float64).reshape(-1, 3)
    n = len(starts)
    counts = {
        "gains": len(batch.gains),
        "worlds": len(batch.worlds.first) - 1,
        "hands": len(batch.hands.first) - 1,
        "operators": len(batch.operators),
        "seeds": len(batch.seeds),
    }
    for name, count in counts.items():
        if count not in (1, n):
            raise CohelmError(f"a batch of {n} robots needs 1 or {n} {name}, got {count}")
    duration = batch.reference.duration if batch.duration is None else batch.duration
    steps = math.floor(duration / batch.dt + 1e-9) + 1
    desired = tabulate(batch.reference, batch.dt, steps, batch.spline_speed)
    outcomes = np.zeros(n, dtype=OUTCOME)
    kernel: Any = numba
    before: int = kernel.get_num_threads()
    kernel.set_num_threads(min(threads or before, before))
    try:
        _run_all(
            starts, desired, batch.dt, batch.worlds, batch.hands,
            operator_table(batch.operators), np.asarray(batch.seeds, dtype=np.int64),
            table(batch.gains), batch.limits, batch.outline,
            float(np.hypot(*batch.outline.T).max()), round(batch.delay / batch.dt), outcomes,
        )  # fmt: skip
    finally:
        kernel.set_num_threads(before)
    return outcomes


@jit_parallel
def _run_all(
    starts: Floats, table: Floats, dt: float, worlds: World, hands: Replay,
    operators: NDArray[np.void], seeds: Ints, gains: NDArray[np.void], limits: Limits,
    outline: Floats, reach: float, delay: int, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    for i in numba.prange(len(starts)):
        _run_one(
            np.int64(i), starts, table, dt, worlds, hands, operators, seeds, gains, limits,
            outline, reach, delay, outcomes,
        )  # fmt: skip


@jit_inline
def _own(i: int, count: int) -> int:
    """Robot i's row among `count`: its own, or the only one."""
    return 0 if count == 1 else i


@jit
def _run_one(
    i: int, starts: Floats, table: Floats, dt: float, worlds: World, hands: Replay,
    operators: NDArray[np.void], seeds: Ints, rows: NDArray[np.void], limits: Limits,
    outline: Floats, reach: float, delay: int, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    w, hand = _own(i, len(worlds.first) - 1), _own(i, len(hands.first) - 1)
    operator, seed = operators[_own(i, len(operators))], seeds[_own(i, len(seeds))]
    row = rows[_own(i, len(rows))]
    gains = Gains(
        row.k_x, row.k_psi, row.K, row.C, row.k_cbf, row.k_hx, row.k_hpsi, row.k_s,
        row.dead_band, row.u_d, row.barrier, row.joint, row.true_sign,
    )  # fmt: skip
    a, b = worlds.first[w], worlds.first[w + 1]
    walls = worlds.walls[worlds.wall_first[w] : worlds.wall_first[w + 1]]
    noticed = worlds.noticed[a:b]
    discs = worlds.discs[a:b].copy()
    moving = moves(w, worlds)
    place(discs, w, worlds, 0.0)
    queue = np.zeros((delay, 2))
    state = at_rest(Pose(starts[i, 0], starts[i, 1], starts[i, 2]))
    person = IDLE
    e_p_max, e_p_square, e_p, h_min, gap = 0.0, 0.0, 0.0, math.inf, NOWHERE
    v_max, omega_max, path, human = 0.0, 0.0, 0.0, 0.0
    saturated, shaped, heading, invalid = 0, 0, 0, 0
    steps = len(table)
    for k in range(steps):
        if moving:
            place(discs, w, worlds, k * dt)
        desired = Desired(table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4])
        pose = state.pose
        if operator.active:
            person, stick = operate(person, operator, pose, discs, noticed, k, dt, seed)
        else:
            stick = replayed(hand, hands, k * dt)
        state, s, limited = turn(k, dt, state, stick, desired, discs, gains, limits, queue)
        e_p = pose_error(pose, desired)
        e_p_max = max(e_p_max, e_p)
        e_p_square += e_p * e_p
        h_min = min(h_min, s.h)
        gap = clearance(pose, outline, reach, discs, walls, gap)
        v_max, omega_max = max(v_max, abs(s.v)), max(omega_max, abs(s.omega))
        path += abs(state.applied.v) * dt
        human += 1.0 - s.authority_x
        saturated += limited
        if s.verdict != UNTOUCHED:
            shaped += s.verdict == SHAPED
            heading += s.verdict == SHAPED and s.culprit == HEADING
            invalid += s.verdict == INVALID
    out = outcomes[i]
    out.x, out.y, out.psi = state.pose.x, state.pose.y, state.pose.psi
    out.e_p_max, out.e_p_rms, out.e_p_end = e_p_max, math.sqrt(e_p_square / steps), e_p
    out.h_min, out.clearance_min = h_min, gap
    out.v_max, out.omega_max, out.path = v_max, omega_max, path
    out.saturated, out.shaped, out.heading, out.invalid = saturated, shaped, heading, invalid
    out.human = human / steps
