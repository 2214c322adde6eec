"""Gamepads and joysticks through SDL (pygame), with vibration instead of force."""

from __future__ import annotations

import contextlib
import os
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.link.messages import Device
from cohelm.link.sticks.feel import shake
from cohelm.link.sticks.port import NOTHING, Button, Feel, Reading, gone

_SHAKE = 200  # [ms]; renewed before it ends; ends by itself when this program does
_STEP = 0.02


def _sdl() -> Any:
    """Pygame without a window, and without its greeting on stdout."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
    import pygame

    if not pygame.joystick.get_init():
        pygame.display.init()
        pygame.joystick.init()
    return pygame


def found() -> list[str]:
    """Names of the devices that SDL knows; `SdlStick` takes their index."""
    pygame = _sdl()
    pygame.event.pump()
    count = pygame.joystick.get_count()
    return [pygame.joystick.Joystick(index).get_name() for index in range(count)]


class SdlStick:
    """One device, from opening to closing."""

    kind = Device.GAMEPAD
    repeats = True
    force = False

    def __init__(self, index: int = 0) -> None:
        """index: in `found()`. Raises CohelmError where there is no stick."""
        self._pygame = _sdl()
        self._pygame.event.pump()
        count: int = self._pygame.joystick.get_count()
        if not 0 <= index < count:
            raise CohelmError(f"there is no stick number {index}: {count} are plugged in")
        self._stick: Any = self._pygame.joystick.Joystick(index)
        self.name: str = self._stick.get_name()
        if self._stick.get_numaxes() < 2:
            raise CohelmError(f"{self.name} has fewer than two axes and is no stick")
        self._why = ""
        self._down: set[int] = set()
        self._felt = NOTHING
        self._since = 0

    def read(self) -> Reading:
        """The present state."""
        if not self._why and self._gone():
            self._why = "it was unplugged"
        if self._why:
            return gone(self.name, self._why)
        stick = Stick(_share(-self._stick.get_axis(1)), _share(-self._stick.get_axis(0)))
        most = min(self._stick.get_numbuttons(), len(Button))
        down = {number for number in range(most) if self._stick.get_button(number)}
        pressed = tuple(Button(number) for number in sorted(down - self._down))
        self._down = down
        return Reading(stick, True, "", pressed)

    def feel(self, feel: Feel) -> None:
        """Vibrate with the strength of the push, where the device can."""
        now = self._pygame.time.get_ticks()
        strong, before = shake(feel), shake(self._felt)
        due = now - self._since >= _SHAKE // 2 and strong > _STEP
        if self._why or not (due or abs(strong - before) >= _STEP):
            return
        self._felt, self._since = feel, now
        with contextlib.suppress(Exception):  # a device without motors refuses in its own way
            self._stick.rumble(strong, strong, _SHAKE)

    def close(self) -> None:
        """Stop the vibration, and close the device."""
        if not self._why:
            with contextlib.suppress(Exception):
                self._stick.stop_rumble()
        self._why = "it is closed"
        self._stick.quit()

    def _gone(self) -> bool:
        """Takes all events: a queue full of others would drop that of the removal."""
        removed, mine = self._pygame.JOYDEVICEREMOVED, self._stick.get_instance_id()
        events: list[Any] = self._pygame.event.get()
        return any(one.type == removed and one.instance_id == mine for one in events)


def _share(value: float) -> float:
    return max(-1.0, min(1.0, value + 0.0))
