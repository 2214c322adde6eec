"""One robot, fully recorded, in pieces that can be written down as they come."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.trace import Trace
from cohelm.core.types import Desired, Floats, StickRecording, Twist
from cohelm.law.gains import Gains
from cohelm.law.reference import tabulate
from cohelm.law.step import control_step
from cohelm.law.track import pose_error
from cohelm.pilot.behavior import FOLLOWING
from cohelm.robot.limits import Limits
from cohelm.sim import closed_loop
from cohelm.sim.operator_model import IDLE, OperatorModel, OperatorState, operate
from cohelm.sim.setup import Setup
from cohelm.sim.wheels import SimulatedState, at_rest, moved, note
from cohelm.sim.world import NOWHERE, World, outline_clearance, place


def run(setup: Setup) -> Trace:
    """The whole run at once."""
    (trace,) = pieces(setup, setup.steps)
    return trace


def pieces(setup: Setup, length: int = 200) -> Iterator[Trace]:
    """The run in traces of `length` steps, the last one shorter, in order."""
    if setup.twin is not None:
        from cohelm.sim.twin import drive  # MuJoCo takes a while to import

        yield from drive.pieces(setup, length)
        return
    if setup.pilot is not None:
        yield from closed_loop.pieces(setup, setup.pilot, length)
        return
    desired = tabulate(setup.reference, setup.dt, setup.steps, setup.spline_speed)
    state, person = at_rest(setup.start), IDLE
    queue = np.zeros((setup.delay_steps, 2))
    goal = (*setup.goal, setup.near)
    for k in range(0, setup.steps, length):
        part = setup.blank(min(length, setup.steps - k))
        state, person = _advance(
            k, setup.dt, state, person, desired, goal, setup.obstacles, setup.recorded_stick,
            setup.operator, setup.seed, setup.gains, setup.limits, setup.outline, setup.reach,
            queue, part.rows, part.h, part.discs,
        )  # fmt: skip
        yield part


@jit
def _advance(
    first: int, dt: float, state: SimulatedState, person: OperatorState, table: Floats,
    goal: tuple[float, float, float], obstacles: World,
    recorded_stick: StickRecording, operator: OperatorModel, seed: int, gains: Gains,
    limits: Limits, outline: Floats, reach: float, queue: Floats, rows: NDArray[np.void],
    h: Floats, discs: Floats,
) -> tuple[SimulatedState, OperatorState]:  # fmt: skip
    """Steps first ... first + len(rows) - 1, each written into rows, h and discs."""
    for j in range(len(rows)):
        k = first + j
        now = discs[j]
        place(now, obstacles, k * dt)
        d = table[k]
        desired = Desired(d[0], d[1], d[2], d[3], d[4])
        pose = state.pose
        person, stick = operate(
            person, operator, recorded_stick, pose, now, obstacles.noticed, k, dt, seed
        )
        s = control_step(pose, desired, stick, now, gains)
        command = Twist(s.safe_v, s.safe_omega)
        state, saturated = moved(k, dt, state, command, stick, gains, limits, queue)
        row = rows[j]
        note(row, h[j], k * dt, pose, stick, desired, s, state, saturated, now)
        row.e_p = pose_error(pose, desired)
        row.clearance = outline_clearance(pose, outline, reach, now, obstacles.walls, NOWHERE)
        row.clearance_seen, row.change = math.inf, 0.0
        row.behavior, row.course = FOLLOWING, 0
        row.tau, row.rate = k * dt, 1.0
        row.to_go = math.hypot(pose.x - goal[0], pose.y - goal[1])
        on_it = math.hypot(pose.x - desired.x, pose.y - desired.y) < goal[2]
        row.arrived = on_it and math.hypot(desired.x - goal[0], desired.y - goal[1]) < goal[2]
    return state, person
