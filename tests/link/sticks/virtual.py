"""Devices that a test can move: SDL's own virtual joystick, and the kernel's (uinput)."""

from __future__ import annotations

import ctypes
import threading
import time
from pathlib import Path
from typing import Any

from cohelm.core.types import Stick


class VirtualSdl:
    """A joystick inside SDL (SDL_JoystickAttachVirtual)."""

    def __init__(self) -> None:
        from cohelm.link.sticks.sdl_stick import _sdl

        pygame = _sdl()
        (library,) = (Path(pygame.__file__).parent.parent / "pygame.libs").glob("libSDL2-2-*")
        self._sdl: Any = ctypes.CDLL(str(library))
        self._sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
        self.index: int = self._sdl.SDL_JoystickAttachVirtual(1, 2, 4, 0)
        assert self.index >= 0
        self._joystick = ctypes.c_void_p(self._sdl.SDL_JoystickOpen(self.index))

    def move(self, stick: Stick) -> None:
        for axis, value in ((0, -stick.psi), (1, -stick.x)):
            value = ctypes.c_int16(round(value * 32767))
            self._sdl.SDL_JoystickSetVirtualAxis(self._joystick, axis, value)

    def press(self, button: int, down: bool) -> None:
        self._sdl.SDL_JoystickSetVirtualButton(self._joystick, button, int(down))

    def unplug(self) -> None:
        self._sdl.SDL_JoystickClose(self._joystick)
        self._sdl.SDL_JoystickDetachVirtual(self.index)


class VirtualEvdev:
    """A joystick with force feedback inside the kernel; takes note of its effects."""

    def __init__(self) -> None:
        import evdev
        from evdev import AbsInfo, ecodes as e

        axis = AbsInfo(0, -1000, 1000, 0, 0, 0)
        self._e = e
        self._device: Any = evdev.UInput(
            {
                e.EV_ABS: [(e.ABS_X, axis), (e.ABS_Y, axis)],
                e.EV_KEY: [e.BTN_TRIGGER, e.BTN_THUMB, e.BTN_THUMB2, e.BTN_TOP],
                e.EV_FF: [e.FF_SPRING, e.FF_CONSTANT],
            },
            name="cohelm test stick", max_effects=8,
        )  # fmt: skip
        self.path: str = self._device.device.path
        self.effects: dict[int, Any] = {}
        self.playing: set[int] = set()
        self._open = True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        time.sleep(0.2)  # udev

    def _serve(self) -> None:
        e = self._e
        while self._open:
            event = self._device.read_one()
            if event is None:
                time.sleep(0.002)
            elif event.type == e.EV_UINPUT and event.code == e.UI_FF_UPLOAD:
                upload = self._device.begin_upload(event.value)
                upload.retval = 0
                self.effects[upload.effect.id] = (upload.effect.type, upload.effect)
                self._device.end_upload(upload)
            elif event.type == e.EV_UINPUT and event.code == e.UI_FF_ERASE:
                erase = self._device.begin_erase(event.value)
                erase.retval = 0
                self.effects.pop(erase.effect_id, None)
                self._device.end_erase(erase)
            elif event.type == e.EV_FF:
                (self.playing.add if event.value else self.playing.discard)(event.code)

    def move(self, stick: Stick) -> None:
        self._device.write(self._e.EV_ABS, self._e.ABS_X, round(-stick.psi * 1000))
        self._device.write(self._e.EV_ABS, self._e.ABS_Y, round(-stick.x * 1000))
        self._device.syn()

    def press(self, button: int, down: bool) -> None:
        keys = (self._e.BTN_TRIGGER, self._e.BTN_THUMB, self._e.BTN_THUMB2, self._e.BTN_TOP)
        self._device.write(self._e.EV_KEY, keys[button], int(down))
        self._device.syn()

    def unplug(self) -> None:
        self._open = False
        self._thread.join()
        self._device.close()
