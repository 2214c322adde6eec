"""What becomes of a command: delay, wheels, motion, and a row of the trace."""

from __future__ import annotations

from typing import Any, NamedTuple

from cohelm.core.flat import fill
from cohelm.core.jit import jit_inline
from cohelm.core.types import SAFE, Desired, Floats, Pose, Stick, Twist, X, Y
from cohelm.law.gains import Gains
from cohelm.law.human import supplied_energy
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits


class SimulatedState(NamedTuple):
    """The simulated robot between two steps."""

    pose: Pose
    applied: Twist
    """What the wheels did in the step before."""
    stick: Stick
    """Where the stick was in the step before."""
    energy: float
    """Passivity integral (40)."""


@jit_inline
def at_rest(pose: Pose) -> SimulatedState:
    """Standing at a pose, stick centred."""
    return SimulatedState(pose, Twist(0.0, 0.0), Stick(0.0, 0.0), 0.0)


@jit_inline
def moved(
    k: int, dt: float, state: SimulatedState, command: Twist, stick: Stick, gains: Gains,
    limits: Limits, queue: Floats,
) -> tuple[SimulatedState, bool]:  # fmt: skip
    """From k dt to (k + 1) dt, the command held in between; and whether the limits changed it.

    queue: (d, 2), commands still on their way; d = 0 for no delay. It is written to.
    """
    arriving = command
    d = queue.shape[0]
    if d > 0:
        slot = k % d
        arriving = Twist(queue[slot, 0], queue[slot, 1])
        queue[slot, 0], queue[slot, 1] = command.v, command.omega
    applied = achievable(arriving, state.applied, limits, dt)
    saturated = applied.v != arriving.v or applied.omega != arriving.omega
    energy = supplied_energy(state.energy, state.stick, stick, gains)
    return SimulatedState(arc(state.pose, applied, dt), applied, stick, energy), saturated


@jit_inline
def note(
    row: Any, h: Floats, t: float, pose: Pose, stick: Stick, desired: Desired, s: Any,
    after: SimulatedState, saturated: bool, discs: Floats,
) -> None:  # fmt: skip
    """One step into its row of the trace, and h_i of every disc. s: what was decided and from what,
    a `law.step.Step` or more."""
    for i in range(discs.shape[0]):
        dx, dy = pose.x - discs[i, X], pose.y - discs[i, Y]
        h[i] = dx * dx + dy * dy - discs[i, SAFE] * discs[i, SAFE]
    row.t = t
    row.x, row.y, row.psi = pose.x, pose.y, pose.psi
    row.x_d, row.y_d, row.psi_d = desired.x, desired.y, desired.psi
    row.u_d, row.r_d = desired.u, desired.r
    row.stick_x, row.stick_psi = stick.x, stick.psi
    fill(row, s)
    if 0 <= s.limiting < discs.shape[0]:
        row.limiting_x, row.limiting_y = discs[s.limiting, X], discs[s.limiting, Y]
    row.applied_v, row.applied_omega = after.applied.v, after.applied.omega
    row.saturated = saturated
    row.energy = after.energy
