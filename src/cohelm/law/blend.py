"""Authority from intent, and the blend of both commands (34)(43)(44)(47)(48)."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit_inline
from cohelm.core.types import Twist
from cohelm.law.gains import Gains
from cohelm.law.human import Intent


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
