"""One control step: the block diagram of the paper's Fig. 2, read from top to bottom."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit, jit_inline
from cohelm.core.scalars import is_finite
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.barrier import Avoidance, barrier
from cohelm.law.gains import Gains
from cohelm.law.human import OperatorCommand, blend, operator_command
from cohelm.law.track import track
from cohelm.law.verdict import INVALID, UNTOUCHED


class Step(NamedTuple):
    """The result of one control step, with all intermediate quantities."""

    safe_v: float
    """Commanded surge speed, first entry of U (49) [m/s]."""
    safe_omega: float
    """Commanded yaw rate, second entry of U (49) [rad/s]."""
    tracking_v: float
    tracking_omega: float
    """tau_c, the tracking law's command (15)."""
    operator_v: float
    operator_omega: float
    """tau_h, the operator's command (38)."""
    nominal_v: float
    nominal_omega: float
    """tau, the blend (34)."""
    avoid_v: float
    avoid_omega: float
    """u, the collision-avoidance input (33)."""
    authority_x: float
    authority_psi: float
    """Diagonal of K_c: the automatic share of each axis."""
    intent_x: float
    intent_psi: float
    """V_hx and V_hpsi (41)(42)."""
    I: float
    J: float
    """Both sides of the filter's test (31)(32)."""
    h: float
    """Smallest h_i [m^2]; infinite without obstacles."""
    verdict: int
    """UNTOUCHED, SHAPED, POWERLESS or INVALID, see `law.verdict`."""
    limiting: int
    """Row of the limiting obstacle; -1 for none (or the heading term, E6)."""


_STOP = Step(
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    INVALID, -1,
)  # fmt: skip
"""The step where an input is not finite."""


@jit_inline
def _avoidance(pose: Pose, tau: Twist, discs: Floats, gains: Gains) -> Avoidance:
    """u of (33); nothing with the barrier off."""
    if gains.barrier:
        return barrier(pose, tau, discs, gains)
    return Avoidance(Twist(0.0, 0.0), 0.0, 0.0, math.inf, UNTOUCHED, -1)


@jit_inline
def total_command(tau_c: Twist, operator: OperatorCommand, tau: Twist, avoid: Avoidance) -> Step:
    """U = tau + u (49), with all intermediate quantities; zero where any is not finite."""
    v, omega = tau.v + avoid.input.v, tau.omega + avoid.input.omega
    valid = is_finite(v) and is_finite(omega) and operator.valid
    total = Step(
        v, omega, tau_c.v, tau_c.omega, operator.twist.v, operator.twist.omega, tau.v, tau.omega,
        avoid.input.v, avoid.input.omega, operator.authority.x, operator.authority.psi,
        operator.intent.x, operator.intent.psi, avoid.I, avoid.J, avoid.h,
        avoid.verdict, avoid.limiting,
    )  # fmt: skip
    return total if valid else _STOP  # to return before makes a step 5 % slower


@jit_inline
def control_step(pose: Pose, desired: Desired, stick: Stick, discs: Floats, gains: Gains) -> Step:
    """U = tau + u (49) from pose, reference, stick and obstacles; compiled code calls this one."""
    operator = operator_command(stick, gains)
    tau_c = track(pose, desired, gains)
    tau = blend(tau_c, operator.twist, operator.authority)
    return total_command(tau_c, operator, tau, _avoidance(pose, tau, discs, gains))


@jit
def _flat(
    x: float, y: float, psi: float,
    x_d: float, y_d: float, psi_d: float, u_d: float, r_d: float,
    stick_x: float, stick_psi: float,
    k_x: float, k_psi: float, K: float, C: float, k_cbf: float, k_hx: float, k_hpsi: float,
    k_s: float, dead_band: float, nominal: float, use_barrier: bool, joint: bool, true_sign: bool,
    discs: Floats,
) -> Step:  # fmt: skip
    gains = Gains(
        k_x, k_psi, K, C, k_cbf, k_hx, k_hpsi, k_s, dead_band, nominal,
        use_barrier, joint, true_sign,
    )  # fmt: skip
    return control_step(
        Pose(x, y, psi), Desired(x_d, y_d, psi_d, u_d, r_d), Stick(stick_x, stick_psi), discs, gains
    )


_PAPER = Gains()


def step(pose: Pose, desired: Desired, stick: Stick, discs: Floats, gains: Gains = _PAPER) -> Step:
    """One control step from Python: `control_step` for pose, reference, stick and obstacles.

    pose, desired: world frame [m, rad]. stick: deflections in [-1, 1]; more is cut. discs:
    float64 (n, 6), see `core.types.disc`. Never raises on numbers and never answers with one
    that is not finite: a NaN or infinity in pose, reference, stick or (with the barrier on) in
    a disc's place, motion or safe distance gives a standing command with verdict INVALID.

    Arguments are spread on the way in: numba unpacks a float in 30 ns, a named tuple in 800.
    """
    return _flat(*pose, *desired, *stick, *gains, discs)
