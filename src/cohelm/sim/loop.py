"""One turn of the closed loop: law, delay, wheels, motion. The run and the batch share it."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.core.jit import jit_inline
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from cohelm.law.human import supplied_energy
from cohelm.law.step import Step, control_step
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, achievable


class State(NamedTuple):
    """The closed loop between two steps."""

    pose: Pose
    applied: Twist
    """What the wheels did in the step before."""
    stick: Stick
    """Where the stick was in the step before."""
    energy: float
    """Passivity integral (40)."""


@jit_inline
def at_rest(pose: Pose) -> State:
    """Standing at a pose, stick centred."""
    return State(pose, Twist(0.0, 0.0), Stick(0.0, 0.0), 0.0)


@jit_inline
def turn(
    k: int, dt: float, state: State, stick: Stick, desired: Desired, discs: Floats,
    gains: Gains, limits: Limits, queue: Floats,
) -> tuple[State, Step, bool]:  # fmt: skip
    """From k dt to (k + 1) dt, the command held in between.

    queue: (d, 2), commands still on their way; d = 0 for no delay. It is written to.
    Returns the state after, what the law decided, and whether the limits changed the command.
    """
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
    return State(arc(state.pose, applied, dt), applied, stick, energy), decided, saturated
