"""Many robots at once, over all cores: the same closed loop, keeping only what is scored."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.core import config
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit, jit_apart, jit_free, jit_inline
from cohelm.core.types import Desired, Floats, Ints, Pose, Stick, Twist
from cohelm.law.barrier import HEADING
from cohelm.law.gains import Gains, table
from cohelm.law.reference import Reference, tabulate
from cohelm.law.verdict import INVALID, SHAPED, UNTOUCHED
from cohelm.robot.limits import Limits
from cohelm.sim import lanes
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
from cohelm.sim.lanes import LANES
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


FEW = 8
"""Fewer than these are not worth a thread of their own."""

SHARES = 4
"""Pieces of a batch for each thread, so that one that is held up does not keep all waiting."""

WORTH_IT = 3
"""Robots from which on it is quicker to take all lanes through a step than each by itself."""


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
    shared = (
        starts, desired, batch.dt, batch.worlds, batch.hands, operator_table(batch.operators),
        np.ascontiguousarray(batch.seeds, dtype=np.int64), table(batch.gains), batch.limits,
        np.ascontiguousarray(batch.outline), float(np.hypot(*batch.outline.T).max()),
        round(batch.delay / batch.dt), outcomes,
    )  # fmt: skip
    used = max(min(threads or all_threads(), all_threads()), 1)
    side = min(max(-(-n // used), FEW), LANES)
    share = -(-n // (side * used * SHARES)) * side
    if used == 1 or share >= n:
        _run_range(0, n, side, *shared)
        return outcomes
    with ThreadPoolExecutor(used) as pool:
        parts = [
            pool.submit(_run_range, first, min(first + share, n), side, *shared)
            for first in range(0, n, share)
        ]
        for part in parts:
            part.result()
    return outcomes


def all_threads() -> int:
    """How many threads a batch may use: one per core, or what NUMBA_NUM_THREADS says."""
    chosen: Any = config
    return int(chosen.NUMBA_NUM_THREADS)


PERSON = np.dtype([(name, "f8") for name in Person._fields], align=True)
"""What the simulated person of one robot has in mind between two steps."""


@jit_free
def _run_range(
    first: int, end: int, side: int, starts: Floats, table: Floats, dt: float, worlds: World,
    hands: Replay, operators: NDArray[np.void], seeds: Ints, gains: NDArray[np.void],
    limits: Limits, outline: Floats, reach: float, delay: int, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    """Robots first ... end - 1, `side` of them at a time."""
    for at in range(first, end, side):
        _run_group(
            at, min(at + side, end), starts, table, dt, worlds, hands, operators, seeds, gains,
            limits, outline, reach, delay, outcomes,
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
    most_discs, most_walls = 0, 0
    for w in range(a, b):
        most_discs = max(most_discs, worlds.first[w + 1] - worlds.first[w])
        most_walls = max(most_walls, worlds.wall_first[w + 1] - worlds.wall_first[w])
    group = np.zeros(lanes.SIZE)
    queue = np.zeros(delay * 2 * LANES)
    people = np.zeros(n, dtype=PERSON)
    for j in range(LANES):
        i = first + min(j, n - 1)  # lanes beyond the last robot drive as that one, unscored
        row = gains[_own(i, len(gains))]
        lanes.put(group, j, Pose(starts[i, 0], starts[i, 1], starts[i, 2]), Twist(0.0, 0.0))
        group[lanes.H_MIN + j], group[lanes.CLEARANCE + j] = math.inf, NOWHERE
        group[lanes.K_X + j], group[lanes.K_PSI + j] = row.k_x, row.k_psi
        group[lanes.K + j], group[lanes.C + j] = row.K, row.C
        group[lanes.K_CBF + j] = row.k_cbf
        group[lanes.SIGN + j] = 1.0 if row.true_sign else -1.0
        group[lanes.FILTERED + j] = 1.0 if row.barrier else 0.0
        group[lanes.DEAD_BAND + j] = max(row.dead_band, 0.0)
    for j in range(n):
        people[j].noticed_at, people[j].seen_at = IDLE.noticed_at, IDLE.seen_at
    _steps(
        first, a, b, group, queue, people, discs, np.empty(most_discs * 6 * LANES),
        np.empty(most_walls * 5 * LANES), table, dt, worlds, hands, operators, seeds, gains,
        limits, outline, reach, outcomes,
    )  # fmt: skip
    for j in range(n):
        out = outcomes[first + j]
        out.x, out.y, out.psi = (
            group[lanes.AT_X + j],
            group[lanes.AT_Y + j],
            group[lanes.AT_PSI + j],
        )
        out.e_p_max, out.e_p_end = (
            math.sqrt(group[lanes.ERROR_MAX + j]),
            math.sqrt(group[lanes.ERROR_END + j]),
        )
        out.e_p_rms = math.sqrt(group[lanes.ERROR_SUM + j] / len(table))
        out.h_min, out.clearance_min = group[lanes.H_MIN + j], group[lanes.CLEARANCE + j]
        out.v_max, out.omega_max = group[lanes.V_MAX + j], group[lanes.OMEGA_MAX + j]
        out.path = group[lanes.PATH + j]
        out.human /= len(table)
        out.shaped += int(group[lanes.SHAPED_STEPS + j])
        out.heading += int(group[lanes.HEADED_STEPS + j])


@jit_inline
def _own(i: int, count: int) -> int:
    """Robot i's row among `count`: its own, or the only one."""
    return 0 if count == 1 else i


@jit_apart
def _steps(
    first: int, a: int, b: int, group: Floats, queue: Floats, people: NDArray[np.void],
    discs: Floats, spread: Floats, spread_wall: Floats, table: Floats, dt: float, worlds: World,
    hands: Replay, operators: NDArray[np.void], seeds: Ints, gains: NDArray[np.void],
    limits: Limits, outline: Floats, reach: float, outcomes: NDArray[np.void],
) -> None:  # fmt: skip
    """All robots of a group through time.

    discs: those of the worlds a ... b - 1, one after the other; `spread` and `spread_wall` hold
    them once more, as `sim.lanes` reads them.
    """
    base, n, d = worlds.first[a], len(people), len(queue) // (2 * LANES)
    moving, handled = False, False
    for w in range(a, b):
        moving = moving or moves(w, worlds)
    for j in range(n):
        i = first + j
        hand = _own(i, len(hands.first) - 1)
        held = hands.first[hand] < hands.first[hand + 1]
        handled = handled or held or operators[_own(i, len(operators))].active
    for j in range(LANES):
        low, high = _walls(first + min(j, n - 1), worlds)
        lanes.spread_walls(spread_wall, j, worlds.walls[low:high])
    for k in range(len(table)):
        if moving or k == 0:
            for w in range(a, b):
                place(discs[worlds.first[w] - base : worlds.first[w + 1] - base], w, worlds, k * dt)
            for j in range(LANES):
                low, high = _discs(first + min(j, n - 1), worlds, base)
                lanes.spread_discs(spread, j, discs[low:high])
        desired = Desired(table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4])
        if handled:
            for j in range(n):
                i, person = first + j, people[j]
                operator = operators[_own(i, len(operators))]
                if operator.active:
                    low, high = _discs(i, worlds, base)
                    stick = _operated(
                        person, operator, lanes.pose_of(group, j),
                        discs[low:high], worlds.noticed[low + base : high + base], k, dt,
                        seeds[_own(i, len(seeds))],
                    )  # fmt: skip
                else:
                    stick = replayed(_own(i, len(hands.first) - 1), hands, k * dt)
                group[lanes.STICK_X + j], group[lanes.STICK_PSI + j] = stick.x, stick.psi
        if n < WORTH_IT:
            for j in range(n):
                lanes.score_error(group, j, desired)
                group[lanes.CLOSE + j], group[lanes.ODD + j] = 1.0, 1.0
        else:
            lanes.gather(group, spread, spread_wall, outline, reach)
        for j in range(n):
            if group[lanes.CLOSE + j] != 0.0:
                low, high = _discs(first + j, worlds, base)
                bottom, top = _walls(first + j, worlds)
                group[lanes.CLEARANCE + j] = clearance(
                    lanes.pose_of(group, j), outline, reach, discs[low:high],
                    worlds.walls[bottom:top], group[lanes.CLEARANCE + j],
                )  # fmt: skip
        if n >= WORTH_IT:
            if lanes.wishes(group, desired) > 0:
                lanes.filtered(group, spread)
            lanes.ordinary(group, queue, k % d if d > 0 else 0, limits, dt)
        for j in range(n):
            if group[lanes.ODD + j] != 0.0:
                i = first + j
                low, high = _discs(i, worlds, base)
                _odd_step(
                    k, dt, j, group, desired, discs[low:high], gains[_own(i, len(gains))], limits,
                    queue.reshape(d, 2, LANES)[:, :, j], outcomes[i],
                )  # fmt: skip


@jit_inline
def _discs(i: int, worlds: World, base: int) -> tuple[int, int]:
    """Robot i's rows of discs, counted from row `base` of all on."""
    w = _own(i, len(worlds.first) - 1)
    return worlds.first[w] - base, worlds.first[w + 1] - base


@jit_inline
def _walls(i: int, worlds: World) -> tuple[int, int]:
    """Robot i's rows of walls."""
    w = _own(i, len(worlds.first) - 1)
    return worlds.wall_first[w], worlds.wall_first[w + 1]


@jit_inline
def _operated(
    person: Any, operator: Any, pose: Pose, discs: Floats, noticed: NDArray[np.bool_], k: int,
    dt: float, seed: int,
) -> Stick:  # fmt: skip
    """One step of a simulated person, kept in a row of PERSON: where the stick is."""
    mind = Person(person.noticed_at, person.seen_at, person.side, person.x, person.psi)
    mind, stick = operate(mind, operator, pose, discs, noticed, k, dt, seed)
    person.noticed_at, person.seen_at = mind.noticed_at, mind.seen_at
    person.side, person.x, person.psi = mind.side, mind.x, mind.psi
    return stick


@jit_apart
def _odd_step(
    k: int, dt: float, j: int, group: Floats, desired: Desired, discs: Floats, gains: Any,
    limits: Limits, queue: Floats, out: Any,
) -> None:  # fmt: skip
    """The step of a robot that `ordinary` left alone; only its pose error is scored yet.

    `gains` goes into the law as the row of a table: it reads either form, and only what it needs.
    """
    pose = Pose(group[lanes.AT_X + j], group[lanes.AT_Y + j], group[lanes.AT_PSI + j])
    stick = Stick(group[lanes.STICK_X + j], group[lanes.STICK_PSI + j])
    state = State(
        pose, Twist(group[lanes.V + j], group[lanes.OMEGA + j]), stick, 0.0
    )  # without energy (40)
    state, s, limited = turn(k, dt, state, stick, desired, discs, gains, limits, queue)
    group[lanes.AT_X + j], group[lanes.AT_Y + j], group[lanes.AT_PSI + j] = (
        state.pose.x,
        state.pose.y,
        state.pose.psi,
    )
    group[lanes.V + j], group[lanes.OMEGA + j] = state.applied.v, state.applied.omega
    group[lanes.H_MIN + j] = min(group[lanes.H_MIN + j], s.h)
    group[lanes.V_MAX + j] = max(group[lanes.V_MAX + j], abs(s.v))
    group[lanes.OMEGA_MAX + j] = max(group[lanes.OMEGA_MAX + j], abs(s.omega))
    group[lanes.PATH + j] += abs(state.applied.v) * dt
    out.human += 1.0 - s.authority_x
    out.saturated += limited
    if s.verdict != UNTOUCHED:
        out.shaped += s.verdict == SHAPED
        out.heading += s.verdict == SHAPED and s.culprit == HEADING
        out.invalid += s.verdict == INVALID
