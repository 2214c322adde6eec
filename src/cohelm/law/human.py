"""The operator's stick: command, intent, passivity, authority, and the blend (34)-(48)."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_inline
from cohelm.core.scalars import is_finite
from cohelm.core.types import Stick, Twist
from cohelm.law.gains import Gains


class Intent(NamedTuple):
    """V_hx and V_hpsi, the energy put into the stick's springs (41)(42)."""

    x: float
    psi: float


@jit_inline
def limited(stick: Stick, gains: Gains) -> Stick:
    """Deflections inside [-1, 1], and 0 on an axis inside the dead band C_Joy."""
    x = min(max(stick.x, -1.0), 1.0)
    psi = min(max(stick.psi, -1.0), 1.0)
    return Stick(
        0.0 if abs(x) <= gains.dead_band else x, 0.0 if abs(psi) <= gains.dead_band else psi
    )


@jit_inline
def human(stick: Stick, gains: Gains) -> Twist:
    """The operator's command tau_h, from a stick already `limited`.

    (45) v = k_hx x_h u_d with the fore-aft axis outside the band (also when both are: E8),
         v = k_hx u_d     with only the left-right axis outside it, else 0
    (46) omega = k_hpsi psi_h
    """
    if stick.x != 0.0:
        v = gains.k_hx * stick.x * gains.u_d
    elif stick.psi != 0.0:
        v = gains.k_hx * gains.u_d
    else:
        v = 0.0
    return Twist(v, gains.k_hpsi * stick.psi)


@jit_inline
def intent(stick: Stick, gains: Gains) -> Intent:
    """V_hx = k_s x_h^2 / 2 (41), V_hpsi = k_s psi_h^2 / 2 (42), from a stick already `limited`."""
    return Intent(0.5 * gains.k_s * stick.x * stick.x, 0.5 * gains.k_s * stick.psi * stick.psi)


@jit_inline
def supplied_energy(energy: float, before: Stick, now: Stick, gains: Gains) -> float:
    """The passivity integral (40) carried one step on: energy + f dx, trapezoidal, both axes.

    The force is the spring's (35), f = k_s x. Assumption 2 holds while the result is >= 0.
    For an ideal spring the integral equals V_h exactly (41)(42); it is an observable because
    a real stick's record may start deflected, and then it can go below 0.
    """
    along_x = 0.5 * gains.k_s * (before.x + now.x) * (now.x - before.x)
    along_psi = 0.5 * gains.k_s * (before.psi + now.psi) * (now.psi - before.psi)
    return energy + along_x + along_psi


@jit_inline
def finite(stick: Stick) -> bool:
    """Whether both deflections are finite; NaN is not a centred stick."""
    return is_finite(stick.x) and is_finite(stick.psi)


class Authority(NamedTuple):
    """Diagonal of K_c, the automatic controller's share of surge and of yaw, in [0, 1]."""

    x: float
    psi: float


@jit_inline
def authority(intent: Intent, gains: Gains) -> Authority:
    """K_c = exp(-(V_hx + V_hpsi)) on both axes (48), or exp(-V_hx), exp(-V_hpsi) (44)."""
    if intent.x == 0.0 and intent.psi == 0.0:
        return Authority(1.0, 1.0)  # most of the time, and spares the exponential
    if gains.joint:
        share = math.exp(-(intent.x + intent.psi))
        return Authority(share, share)
    return Authority(math.exp(-intent.x), math.exp(-intent.psi))


@jit_inline
def blend(automatic: Twist, human: Twist, share: Authority) -> Twist:
    """tau = K_h tau_h + K_c tau_c with K_h = 1 - K_c (34)(47)."""
    return Twist(
        (1.0 - share.x) * human.v + share.x * automatic.v,
        (1.0 - share.psi) * human.omega + share.psi * automatic.omega,
    )


class OperatorCommand(NamedTuple):
    """The operator's part of a control step."""

    twist: Twist
    """tau_h (38)."""
    intent: Intent
    """V_h (41)(42)."""
    authority: Authority
    """K_c, the share of the automatic controller."""
    valid: bool
    """Whether the deflection is finite; NaN is not a centred stick."""


@jit_inline
def operator_command(stick: Stick, gains: Gains) -> OperatorCommand:
    """The operator's part, from the unlimited stick."""
    stick_limited = limited(stick, gains)
    energy = intent(stick_limited, gains)
    return OperatorCommand(
        human(stick_limited, gains), energy, authority(energy, gains), finite(stick)
    )
