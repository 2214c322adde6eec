"""Joysticks of Linux, with force feedback (evdev).

Right and back are positive there; forward and left are positive here. The spring is the device's
own (FF_SPRING), without this program's delay; the cue is a constant force (FF_CONSTANT) whose
direction and level are updated. The kernel ends all effects when the device is closed, also when
this process dies.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import evdev
from evdev import ecodes, ff

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.link.messages import Device
from cohelm.link.sticks.feel import shake
from cohelm.link.sticks.port import NOTHING, Button, Feel, Reading, gone

_FULL = 0x7FFF
_FOR_EVER = 0  # [ms]
_STEP = 0.01  # smaller changes of a push are not uploaded
_FIRST_BUTTONS = (ecodes.BTN_JOYSTICK, ecodes.BTN_GAMEPAD)


def found() -> list[str]:
    """Paths of the devices with two axes and a joystick button."""
    paths: list[str] = []
    for path in _paths():
        with contextlib.suppress(OSError):
            device: Any = _opened(path)
            try:
                if _is_stick(device.capabilities()):
                    paths.append(path)
            finally:
                device.close()
    return paths


class EvdevStick:
    """One device, from opening to closing."""

    kind = Device.FORCE_STICK
    repeats = True

    def __init__(self, path: str) -> None:
        """path: /dev/input/event... Raises CohelmError where there is no stick."""
        try:
            self._device: Any = _opened(path)
        except OSError as error:
            raise CohelmError(
                f"{path} can not be opened ({error.strerror}): is it plugged in, and are you in "
                f"the group 'input'?"
            ) from None
        can = self._device.capabilities()
        if not _is_stick(can):
            self._device.close()
            raise CohelmError(
                f"{path} ({self._device.name}) has fewer than two axes and is no stick"
            )
        self.name: str = self._device.name
        effects = set(can.get(ecodes.EV_FF, ()))
        self.force = ecodes.FF_CONSTANT in effects
        self._springs = ecodes.FF_SPRING in effects
        self._shakes = ecodes.FF_RUMBLE in effects and not self.force
        keys = sorted(key for key in can.get(ecodes.EV_KEY, ()) if key >= min(_FIRST_BUTTONS))
        self._buttons = dict(zip(keys, Button, strict=False))
        self._why = ""
        self._axes: dict[int, float] = {}
        self._ends: dict[int, tuple[int, int]] = {}
        self._effects: dict[int, int] = {}
        self._felt = NOTHING
        self._look()

    def read(self) -> Reading:
        """The present state."""
        pressed: list[Button] = []
        if self._why:
            return gone(self.name, self._why)
        try:
            for event in self._device.read():
                if event.type == ecodes.EV_SYN and event.code == ecodes.SYN_DROPPED:
                    self._look()  # the kernel dropped events: read the state
                elif event.type == ecodes.EV_ABS and event.code in self._axes:
                    self._axes[event.code] = self._share(event.code, event.value)
                elif event.type == ecodes.EV_KEY and event.value == 1:
                    pressed += [self._buttons[event.code]] if event.code in self._buttons else []
        except BlockingIOError:
            pass  # nothing new
        except (OSError, ValueError) as error:
            self._why = getattr(error, "strerror", None) or "it is closed"
        if self._why:
            return gone(self.name, self._why)
        stick = Stick(-self._axes[ecodes.ABS_Y], -self._axes[ecodes.ABS_X])
        return Reading(stick, True, "", tuple(pressed))

    def feel(self, feel: Feel) -> None:
        """Change the effects, as far as the device has them."""
        before = self._felt
        if self._why or _similar(before, feel):
            return
        self._felt = feel
        with contextlib.suppress(OSError):
            if self._springs and (feel.spring != before.spring or not self._effects):
                self._play(ecodes.FF_SPRING, _spring(feel.spring))
            if self.force:
                self._play(ecodes.FF_CONSTANT, _push(feel.push))
            elif self._shakes:
                self._play(ecodes.FF_RUMBLE, _shaking(shake(feel)))

    def close(self) -> None:
        """Close the device; the kernel ends its effects."""
        self._why = "it is closed"
        with contextlib.suppress(OSError):
            self._device.close()

    def _look(self) -> None:
        for axis in (ecodes.ABS_X, ecodes.ABS_Y):
            about = self._device.absinfo(axis)
            self._ends[axis] = (about.min, about.max)
            self._axes[axis] = self._share(axis, about.value)

    def _share(self, axis: int, value: int) -> float:
        least, most = self._ends[axis]
        half = 0.5 * (most - least)
        return max(-1.0, min(1.0, (value - 0.5 * (most + least)) / half)) if half else 0.0

    def _play(self, what: int, effect: tuple[int, ff.EffectType]) -> None:
        direction, of = effect
        known = self._effects.get(what, -1)
        made = ff.Effect(what, known, direction, ff.Trigger(0, 0), ff.Replay(_FOR_EVER, 0), of)
        number: int = self._device.upload_effect(made)
        if known < 0:
            self._effects[what] = number
            self._device.write(ecodes.EV_FF, number, 1)


def _spring(share: float) -> tuple[int, ff.EffectType]:
    strength = round(share * _FULL)
    one = ff.Condition(_FULL, _FULL, strength, strength, 0, 0)
    return 0, ff.EffectType(ff_condition_effect=(ff.Condition * 2)(one, one))


def _push(push: Stick) -> tuple[int, ff.EffectType]:
    """Linux counts directions from down (towards the person) over left to up, 2^16 a turn."""
    angle = math.atan2(push.psi, -push.x) / (2.0 * math.pi)
    level = round(min(1.0, math.hypot(*push)) * _FULL)
    effect = ff.Constant(level, ff.Envelope(0, 0, 0, 0))
    return round(angle * 65536.0) % 65536, ff.EffectType(ff_constant_effect=effect)


def _shaking(share: float) -> tuple[int, ff.EffectType]:
    return 0, ff.EffectType(ff_rumble_effect=ff.Rumble(round(share * 0xFFFF), 0))


def _similar(a: Feel, b: Feel) -> bool:
    return a.spring == b.spring and all(
        abs(p - q) < _STEP for p, q in zip(a.push, b.push, strict=True)
    )


def _is_stick(can: Any) -> bool:
    axes = {axis for axis, _ in can.get(ecodes.EV_ABS, ())}
    keys = can.get(ecodes.EV_KEY, ())
    buttons = any(ecodes.BTN_JOYSTICK <= key < ecodes.BTN_DIGI for key in keys)
    return {ecodes.ABS_X, ecodes.ABS_Y} <= axes and buttons


def _paths() -> list[str]:
    return evdev.list_devices()  # pyright: ignore[reportUnknownMemberType]


def _opened(path: str) -> Any:
    return evdev.InputDevice(path)  # pyright: ignore[reportUnknownVariableType]
