"""All parameters and options of the paper's law in one flat tuple, with its values."""

from __future__ import annotations

from typing import NamedTuple


class Gains(NamedTuple):
    """Parameters of Table II and the choices that the errata leave open."""

    k_x: float = 0.9
    """Surge gain of (16) [1/s]."""
    k_psi: float = 1.0
    """Heading gain of (17) [1/s]."""
    K: float = 0.5
    """Growth rate the barrier tolerates (32) [1/s]."""
    C: float = 0.5
    """Constant growth the barrier tolerates (32) [1/(m^2 s)]."""
    k_cbf: float = 1.5
    """Steering to the right while the filter acts (33) [rad/s]; no value in the paper (E3)."""
    k_hx: float = 0.5
    """Human surge gain of (45)."""
    k_hpsi: float = 0.5
    """Human yaw-rate gain of (46) [rad/s]."""
    k_s: float = 5.0
    """Spring constant of the stick (35)."""
    dead_band: float = 0.05
    """C_Joy of (45)(46), in deflection; no value in the paper (E3)."""
    u_d: float = 0.5
    """Speed that a full fore-aft deflection is scaled by (45) [m/s]."""
    barrier: bool = True
    """Whether the collision-avoidance input (33) is added at all (49)."""
    joint: bool = True
    """One authority for both axes (47)(48), or one per axis (43)(44), found unstable (Remark 2)."""
    true_sign: bool = True
    """Sign of the moving-obstacle term: the derivative's own, or (27) as printed (E2)."""
