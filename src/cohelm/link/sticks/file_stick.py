"""Plays a recorded stick as a device: for tests, demonstrations and repeated drives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Device
from cohelm.link.stick import StickRecording
from cohelm.link.sticks.port import Feel, Reading


class FileStick:
    """Starts at its first reading, and becomes invalid when the record is over."""

    kind = Device.SCRIPT
    force = False

    def __init__(self, record: StickRecording, name: str, clock: Callable[[], float]) -> None:
        """clock: seconds, steady."""
        self.name = name
        self._record = record
        self._clock = clock
        self._began: float | None = None
        self._closed = False

    def read(self) -> Reading:
        """The present state."""
        if self._closed:
            return Reading(CENTRED, False, f"{self.name}: it is closed", ())
        if self._began is None:
            self._began = self._clock() - float(self._record.times[0])
        now = self._clock() - self._began
        if now > self._record.times[-1]:
            return Reading(CENTRED, False, f"{self.name}: it is over", ())
        at = int(np.searchsorted(self._record.times, now, side="right")) - 1
        stick = Stick(float(self._record.x[at]), float(self._record.psi[at]))
        return Reading(stick, True, "", ())

    def feel(self, feel: Feel) -> None:
        """No effect."""

    def close(self) -> None:
        """End the playback."""
        self._closed = True
