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
from cohelm.core.types import Desired, Floats, Ints, Pose, Twist
from cohelm.law.barrier import HEADING
from cohelm.law.gains import Gains, table
from cohelm.law.reference import Reference, tabulate
from cohelm.law.track import pose_error
from cohelm.law.verdict import INVALID, SHAPED, UNTOUCHED
from cohelm.robot.limits import Limits
from cohelm.sim.hand import (
    IDLE,
    Operator,
    Person,
    Replay,
    operate,
    operator_table,
    replay,
    replayed,
)
from cohelm.sim.loop import State, turn
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


LANES = 32
"""Robots that one thread takes through time side by side: while the long chain from pose to
pose of one robot waits for a number, the processor works on the next."""

FEW = 8
"""Fewer than these are not worth a thread of their own."""


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
    used = min(threads or before, before)
    lanes = min(max(-(-n // used), FEW), LANES)
    kernel.set_num_threads(max(min(used, -(-n // lanes)), 1))
    try:
        _run_all(
            lanes, starts, desired, batch.dt, batch.worlds, batch.hands,
            operator_table(batch.operators), np.asarray(batch.seeds, dtype=np.int64),
            table(batch.gains), batch.limits, batch.outline,
            float(np.hypot(*batch.outline.T).max()), round(batch.delay / batch.dt), outcomes,
        )  # fmt: skip
    finally:
        kernel.set_num_threads(before)
    return outcomes


LANE = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("psi", "f8"),
        ("v", "f8"), ("omega", "f8"),
        ("noticed_at", "f8"), ("seen_at", "f8"), ("side", "f8"),
        ("hand_x", "f8"), ("hand_psi", "f8"),
    ],
    align=True,
)  # fmt: skip
"""One robot between two steps: its pose, what the wheels do, and its `Person`."""


@jit_parallel
def _run_all(
    lanes: int, starts: Floats, table: Floats, dt: float, worlds: World, hands: Replay,
    operators: NDArray[np.void], seeds: Ints, gains: NDArray[np.void], limits: Limits,
    outline: Floats, reach: float, delay: int, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    n = len(starts)
    for group in numba.prange((n + lanes - 1) // lanes):
        first: Any = np.int64(group) * lanes
        _run_group(
            first, min(first + lanes, n), starts, table, dt, worlds, hands, operators, seeds,
            gains, limits, outline, reach, delay, outcomes,
        )  # fmt: skip


@jit
def _run_group(
    first: int, end: int, starts: Floats, table: Floats, dt: float, worlds: World, hands: Replay,
    operators: NDArray[np.void], seeds: Ints, gains: NDArray[np.void], limits: Limits,
    outline: Floats, reach: float, delay: int, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    """Robots first ... end - 1: room for them, their start, all steps, and what they add up to."""
    n = end - first
    a, b = (0, 1) if len(worlds.first) == 2 else (first, end)
    discs = worlds.discs[worlds.first[a] : worlds.first[b]].copy()
    queues = np.zeros((n, delay, 2))
    lanes = np.zeros(n, dtype=LANE)
    for j in range(n):
        lane, out = lanes[j], outcomes[first + j]
        lane.x, lane.y, lane.psi = starts[first + j, 0], starts[first + j, 1], starts[first + j, 2]
        lane.noticed_at, lane.seen_at = IDLE.noticed_at, IDLE.seen_at
        out.h_min, out.clearance_min = math.inf, NOWHERE
    _steps(
        first, a, b, lanes, queues, discs, table, dt, worlds, hands, operators, seeds, gains,
        limits, outline, reach, outcomes,
    )  # fmt: skip
    for j in range(n):
        lane, out = lanes[j], outcomes[first + j]
        out.x, out.y, out.psi = lane.x, lane.y, lane.psi
        out.e_p_rms = math.sqrt(out.e_p_rms / len(table))
        out.human /= len(table)


@jit_inline
def _own(i: int, count: int) -> int:
    """Robot i's row among `count`: its own, or the only one."""
    return 0 if count == 1 else i


@jit_inline
def _steps(
    first: int, a: int, b: int, lanes: NDArray[np.void], queues: Floats, discs: Floats,
    table: Floats, dt: float, worlds: World, hands: Replay, operators: NDArray[np.void],
    seeds: Ints, gains: NDArray[np.void], limits: Limits, outline: Floats, reach: float,
    outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    """All robots of a group through time; `discs` are those of the worlds a ... b - 1.

    Until the end `e_p_rms` is the sum of squares and `human` the sum of shares. `gains` go into
    the law row by row as they are: it reads either form, and only what it needs.
    """
    base = worlds.first[a]
    moving = False
    for w in range(a, b):
        moving = moving or moves(w, worlds)
    for k in range(len(table)):
        if moving or k == 0:
            for w in range(a, b):
                place(discs[worlds.first[w] - base : worlds.first[w + 1] - base], w, worlds, k * dt)
        desired = Desired(table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4])
        for j in range(len(lanes)):
            i = first + j
            lane, out = lanes[j], outcomes[i]
            operator, row = operators[_own(i, len(operators))], gains[_own(i, len(gains))]
            w = _own(i, len(worlds.first) - 1)
            near = discs[worlds.first[w] - base : worlds.first[w + 1] - base]
            walls = worlds.walls[worlds.wall_first[w] : worlds.wall_first[w + 1]]
            pose, applied = Pose(lane.x, lane.y, lane.psi), Twist(lane.v, lane.omega)
            if operator.active:
                person, stick = operate(
                    Person(lane.noticed_at, lane.seen_at, lane.side, lane.hand_x, lane.hand_psi),
                    operator, pose, near, worlds.noticed[worlds.first[w] : worlds.first[w + 1]],
                    k, dt, seeds[_own(i, len(seeds))],
                )  # fmt: skip
                lane.noticed_at, lane.seen_at = person.noticed_at, person.seen_at
                lane.side, lane.hand_x, lane.hand_psi = person.side, person.x, person.psi
            else:
                stick = replayed(_own(i, len(hands.first) - 1), hands, k * dt)
            state = State(pose, applied, stick, 0.0)  # the energy (40) is not kept
            state, s, limited = turn(k, dt, state, stick, desired, near, row, limits, queues[j])
            lane.x, lane.y, lane.psi = state.pose.x, state.pose.y, state.pose.psi
            lane.v, lane.omega = state.applied.v, state.applied.omega
            e_p = pose_error(pose, desired)
            out.e_p_max, out.e_p_end = max(out.e_p_max, e_p), e_p
            out.e_p_rms += e_p * e_p
            out.h_min = min(out.h_min, s.h)
            out.clearance_min = clearance(pose, outline, reach, near, walls, out.clearance_min)
            out.v_max = max(out.v_max, abs(s.v))
            out.omega_max = max(out.omega_max, abs(s.omega))
            out.path += abs(lane.v) * dt
            out.human += 1.0 - s.authority_x
            out.saturated += limited
            if s.verdict != UNTOUCHED:
                out.shaped += s.verdict == SHAPED
                out.heading += s.verdict == SHAPED and s.culprit == HEADING
                out.invalid += s.verdict == INVALID
