"""The record of one run: what every room that writes, reads, plots or scores runs agrees on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats

ROW = np.dtype(
    [
        ("t", "f8"),  # [s]
        ("x", "f8"), ("y", "f8"), ("psi", "f8"),  # pose, before the command acts [m, m, rad]
        ("x_d", "f8"), ("y_d", "f8"), ("psi_d", "f8"), ("u_d", "f8"), ("r_d", "f8"),  # (7)(10)
        ("e_p", "f8"),  # E_P (51)
        ("stick_x", "f8"), ("stick_psi", "f8"),  # deflection as it came
        ("safe_v", "f8"), ("safe_omega", "f8"),  # command U (49) [m/s, rad/s]
        ("tracking_v", "f8"), ("tracking_omega", "f8"),  # tau_c (15)
        ("operator_v", "f8"), ("operator_omega", "f8"),  # tau_h (38)
        ("nominal_v", "f8"), ("nominal_omega", "f8"),  # tau (34)
        ("avoid_v", "f8"), ("avoid_omega", "f8"),  # u (33)
        ("authority_x", "f8"), ("authority_psi", "f8"),  # diagonal of K_c
        ("intent_x", "f8"), ("intent_psi", "f8"),  # V_hx, V_hpsi
        ("I", "f8"), ("J", "f8"), ("h", "f8"),  # (31)(32), smallest h_i [m^2]
        ("verdict", "i8"), ("culprit", "i8"),
        ("applied_v", "f8"), ("applied_omega", "f8"),  # after delay and wheel limits
        ("saturated", "?"),  # whether the limits changed the command
        ("clearance", "f8"),  # real outline to the nearest disc or wall [m] (E7)
        ("energy", "f8"),  # passivity integral (40)
        ("gap", "f8"), ("change", "f8"),  # what the guard saw and did [m, m/s]
        ("doing", "i8"), ("course", "i8"),  # see `pilot.step`; courses followed before this one
        ("tau", "f8"), ("rate", "f8"),  # the course's clock [s] and how fast it goes
        ("to_go", "f8"), ("arrived", "?"),  # straight to the end of the reference [m]
    ]
)  # fmt: skip
"""One control step. The command is decided at `t` from the pose in the same row."""


@dataclass(frozen=True)
class Trace:
    """One run, step by step.

    rows: (n,) of dtype ROW. h: (n, m), h_i of every disc [m^2]. discs: (n, m, 6), every disc
    at every step, columns as in `core.types`. names: the m discs' names. dt: step [s].
    scenario: the YAML text that made the run, resolved; empty if there was none.
    """

    rows: NDArray[np.void]
    h: Floats
    discs: Floats
    names: tuple[str, ...]
    dt: float
    scenario: str = ""

    def __len__(self) -> int:
        return len(self.rows)

    def joined(self, *others: Trace) -> Trace:
        """This trace with the steps of `others`, of the same run, after it in their order."""
        parts = (self, *others)
        return Trace(
            np.concatenate([part.rows for part in parts]),
            np.concatenate([part.h for part in parts]),
            np.concatenate([part.discs for part in parts]),
            self.names,
            self.dt,
            self.scenario,
        )
