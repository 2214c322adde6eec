"""The record of one run, for all rooms that write, read, plot or score runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats


@dataclass(frozen=True)
class Trace:
    """One run, step by step.

    rows: (n,) of dtype `core.row.ROW`. h: (n, m), h_i of every disc [m^2]. discs: (n, m, 6), every
    disc at every step, columns as in `core.types`. names: the m discs' names. dt: step [s].
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

    def until(self, n: int) -> Trace:
        """Its first n steps, sharing memory."""
        return replace(self, rows=self.rows[:n], h=self.h[:n], discs=self.discs[:n])

    def joined(self, *others: Trace) -> Trace:
        """This trace with the steps of `others`, of the same run, after it in their order."""
        parts = (self, *others)
        return Trace(
            np.concatenate([part.rows for part in parts]),
            np.concatenate([part.h for part in parts]),
            np.concatenate([part.discs for part in parts]), self.names, self.dt, self.scenario,
        )  # fmt: skip
