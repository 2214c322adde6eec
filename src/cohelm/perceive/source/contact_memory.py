"""Contacts of bumpers and cliff sensors, remembered as static points."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cohelm.core.frames import placed
from cohelm.core.types import Floats, Pose
from cohelm.robot.contacts import ContactModel
from cohelm.robot.port import Contact

KEPT = 30.0
"""How long a contact is remembered [s]: no other sensor may see the obstacle."""
_APART = 0.05  # spacing of points across a bumper [m]
_SAME = 0.02  # displacement up to which it is the same contact [m]


class ContactMemory:
    """The contacts of one robot."""

    def __init__(self, models: Sequence[ContactModel]) -> None:
        self._places: dict[str, Floats] = {}
        for one in models:
            left, right = (np.array(end) for end in one.ends())
            steps = math.ceil(one.width_m / _APART)
            share = np.arange(steps + 1)[:, None] / max(steps, 1)
            self._places[one.name] = left + share * (right - left)
        self._met: list[tuple[float, str, Floats]] = []

    def take(self, now: float, contacts: Sequence[Contact], pose: Pose) -> None:
        """Take their readings at an `odom` pose."""
        self._met = [one for one in self._met if now - one[0] <= KEPT]
        for one in contacts:
            if not one.on or one.sensor not in self._places:
                continue
            there = placed(self._places[one.sensor], pose)
            again = [i for i, (_, name, old) in enumerate(self._met)
                     if name == one.sensor and np.abs(old - there).max() <= _SAME]  # fmt: skip
            for i in again:
                self._met[i] = (now, one.sensor, self._met[i][2])
            if not again:
                self._met.append((now, one.sensor, there))

    @property
    def points(self) -> Floats:
        """(p, 2), in `odom` [m]."""
        if not self._met:
            return np.empty((0, 2))
        return np.vstack([there for _, _, there in self._met])
