"""Chooses the stick: by path, by number, by network address, or the first one found."""

from __future__ import annotations

import time
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.core.extras import missing
from cohelm.link import stick as recordings
from cohelm.link.sticks.brunner_stick import SCHEME, BrunnerStick, parameters
from cohelm.link.sticks.played import PlayedStick
from cohelm.link.sticks.port import StickDevice


def listed() -> list[str]:
    """The sticks found here, a line each."""
    lines: list[str] = []
    for path in _evdev_paths():
        device = _evdev(path)
        lines.append(f"{path}: {device.name}{', with force feedback' if device.force else ''}")
        device.close()
    return lines + [f"{number}: {name}" for number, name in enumerate(_sdl_names())]


def opened(device: str | None) -> StickDevice:
    """The device requested, or the first one found. Raises CohelmError where there is none."""
    if device is None:
        paths = _evdev_paths()
        if paths:
            return _evdev(paths[0])
        if _sdl_names():
            return _sdl(0)
        raise CohelmError(
            "no stick is plugged in here (or you may not read /dev/input: join the group 'input')"
        )
    if device.isdigit():
        return _sdl(int(device))
    if device.startswith("/dev/"):
        return _evdev(device)
    if device.startswith(SCHEME):
        return BrunnerStick(parameters(device))
    return PlayedStick(recordings.read(device), Path(device).name, time.monotonic)


def _evdev_paths() -> list[str]:
    try:
        from cohelm.link.sticks.evdev_stick import found
    except ImportError:  # not Linux, or not installed; SDL may still know one
        return []
    return found()


def _evdev(path: str) -> StickDevice:
    try:
        from cohelm.link.sticks.evdev_stick import EvdevStick
    except ImportError:
        raise missing("a stick of this machine", "stick") from None
    return EvdevStick(path)


def _sdl_names() -> list[str]:
    try:
        from cohelm.link.sticks.sdl_stick import found

        return found()
    except ImportError:
        raise missing("a stick of this machine", "stick") from None


def _sdl(number: int) -> StickDevice:
    try:
        from cohelm.link.sticks.sdl_stick import SdlStick

        return SdlStick(number)
    except ImportError:
        raise missing("a stick of this machine", "stick") from None
