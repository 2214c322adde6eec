"""One turn of the closed loop: hand, law, delay, wheels, motion. The run and the batch share it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit_inline
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from cohelm.law.human import supplied_energy
from cohelm.law.step import Step, control_step
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, achievable
from cohelm.sim.hand import IDLE, Operator, Person, Replay, operate, replayed


class State(NamedTuple):
    """The closed loop between two steps."""

    pose: Pose
    applied: Twist
    stick: Stick
    energy: float
    """Passivity integral (40)."""
    person: Person


def at_rest(pose: Pose) -> State:
    """Standing at a pose, stick centred."""
    return State(pose, Twist(0.0, 0.0), Stick(0.0, 0.0), 0.0, IDLE)


class Turn(NamedTuple):
    """What happened in one turn."""

    after: State
    step: Step
    stick: Stick
    applied: Twist
    saturated: bool
    energy: float


@jit_inline
def turn(
    k: int, dt: float, state: State, desired: Desired, discs: Floats, noticed: NDArray[np.bool_],
    hand: int, hands: Replay, operator: Operator, seed: int,
    gains: Gains, limits: Limits, queue: Floats,
) -> Turn:  # fmt: skip
    """From the state at k dt to the state at (k + 1) dt, the command held in between.

    queue: (d, 2), commands still on their way; d = 0 for no delay. It is written to.
    """
    person = state.person
    if operator.active:
        person, stick = operate(person, operator, state.pose, discs, noticed, k, dt, seed)
    else:
        stick = replayed(hand, hands, k * dt)
    decided = control_step(state.pose, desired, stick, discs, gains)
    arriving = Twist(decided.v, decided.omega)
    d = queue.shape[0]
    if d > 0:
        slot = k % d
        arriving = Twist(queue[slot, 0], queue[slot, 1])
        queue[slot, 0], queue[slot, 1] = decided.v, decided.omega
    applied = achievable(arriving, state.applied, limits, dt)
    saturated = applied.v != arriving.v or applied.omega != arriving.omega
    energy = supplied_energy(state.energy, state.stick, stick, gains)
    pose = arc(state.pose, applied, dt)
    after = State(pose, applied, stick, energy, person)
    return Turn(after, decided, stick, applied, saturated, energy)
