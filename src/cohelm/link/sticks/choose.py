"""Chooses the stick: by path, by number, by network address, or the first one found."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.extras import missing
from cohelm.core.types import Stick, StickRecording
from cohelm.link import stick as recordings
from cohelm.link.messages import Device
from cohelm.link.sticks.brunner_stick import SCHEME, BrunnerStick, parameters
from cohelm.link.sticks.port import Feel, Reading, StickDevice, gone


def listed() -> list[str]:
    """The sticks found here, a line each."""
    lines: list[str] = []
    for path in _evdev_paths():
        device = _made("evdev_stick", "EvdevStick", path)
        lines.append(f"{path}: {device.name}{', with force feedback' if device.force else ''}")
        device.close()
    return lines + [f"{number}: {name}" for number, name in enumerate(_sdl_names())]


def opened(device: str | None) -> StickDevice:
    """The device requested, or the first one found. Raises CohelmError where there is none."""
    if device is None:
        paths = _evdev_paths()
        if paths:
            return _made("evdev_stick", "EvdevStick", paths[0])
        if _sdl_names():
            return _made("sdl_stick", "SdlStick", 0)
        raise CohelmError(
            "no stick is plugged in here (or you may not read /dev/input: join the group 'input')"
        )
    if device.isdigit():
        return _made("sdl_stick", "SdlStick", int(device))
    if device.startswith("/dev/"):
        return _made("evdev_stick", "EvdevStick", device)
    if device.startswith(SCHEME):
        return BrunnerStick(parameters(device))
    return FileStick(recordings.read(device), Path(device).name, time.monotonic)


def _evdev_paths() -> list[str]:
    try:
        return import_module("cohelm.link.sticks.evdev_stick").found()
    except ImportError:  # not Linux, or not installed; SDL may still know one
        return []


def _sdl_names() -> list[str]:
    return _made("sdl_stick", "found")


def _made(module: str, name: str, *given: object) -> Any:
    """What a function or class returns that needs the extra `stick`."""
    try:
        return getattr(import_module(f"cohelm.link.sticks.{module}"), name)(*given)
    except ImportError:
        raise missing("a stick of this machine", "stick") from None


class FileStick:
    """Plays a recorded stick as a device: for tests, demonstrations and repeated drives.

    Starts at its first reading, and becomes invalid when the record is over."""

    kind = Device.SCRIPT
    repeats = False
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
            return gone(self.name, "it is closed")
        if self._began is None:
            self._began = self._clock() - float(self._record.times[0])
        now = self._clock() - self._began
        if now > self._record.times[-1]:
            return gone(self.name, "it is over")
        at = int(np.searchsorted(self._record.times, now, side="right")) - 1
        stick = Stick(float(self._record.x[at]), float(self._record.psi[at]))
        return Reading(stick, True, "", ())

    def feel(self, feel: Feel) -> None:
        """No effect."""

    def close(self) -> None:
        """End the playback."""
        self._closed = True
