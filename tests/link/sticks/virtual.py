"""Virtual devices for tests: SDL's virtual joystick, and the kernel's (uinput)."""

from __future__ import annotations

import ctypes
import json
import os
import select
import subprocess
import sys
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
        (library,) = (Path(pygame.__file__).parent.parent / "pygame_ce.libs").glob("libSDL2-2*")
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
    """A joystick with force feedback inside the kernel, kept by a program of its own.

    An upload waits in the kernel for its answer, and with it the program that uploads.
    """

    def __init__(self) -> None:
        self._program = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.path: str = json.loads(self._program.stdout.readline())
        self.effects: dict[int, dict[str, int]] = {}
        """By number: kind, direction, level, coefficient."""
        self.playing: set[int] = set()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        for line in self._program.stdout:
            what, number, about = json.loads(line)
            if what == "upload":
                self.effects[number] = about
            elif what == "erase":
                self.effects.pop(number, None)
            elif about:
                self.playing.add(number)
            else:
                self.playing.discard(number)

    def move(self, stick: Stick) -> None:
        self._say([["X", round(-stick.psi * 1000)], ["Y", round(-stick.x * 1000)]])

    def press(self, button: int, down: bool) -> None:
        self._say([[button, int(down)]])

    def unplug(self) -> None:
        self._program.stdin.close()
        self._thread.join()
        self._program.wait(5.0)
        self._program.stdout.close()

    def _say(self, events: list[list[Any]]) -> None:
        self._program.stdin.write(json.dumps(events) + "\n")
        self._program.stdin.flush()


def _keep() -> None:
    """The program: moves as it is told on stdin, answers the kernel, tells of effects on stdout."""
    import evdev
    from evdev import AbsInfo, ecodes as e, ff

    axis = AbsInfo(0, -1000, 1000, 0, 0, 0)
    keys = (e.BTN_TRIGGER, e.BTN_THUMB, e.BTN_THUMB2, e.BTN_TOP)
    device: Any = evdev.UInput(
        {
            e.EV_ABS: [(e.ABS_X, axis), (e.ABS_Y, axis)],
            e.EV_KEY: list(keys),
            e.EV_FF: [e.FF_SPRING, e.FF_CONSTANT],
        },
        name="cohelm test stick", max_effects=8,
    )  # fmt: skip
    time.sleep(0.3)  # udev
    print(json.dumps(device.device.path), flush=True)
    waiting = select.poll()
    for fd in (0, device.fd):
        waiting.register(fd, select.POLLIN)
    while True:
        waiting.poll(100)
        if select.select([0], [], [], 0)[0]:
            said = os.read(0, 65536)  # lines are short, written whole, and may come together
            if not said:
                device.close()
                return
            for line in said.splitlines():
                for what, value in json.loads(line):
                    if isinstance(what, str):
                        device.write(e.EV_ABS, e.ABS_X if what == "X" else e.ABS_Y, value)
                    else:
                        device.write(e.EV_KEY, keys[what], value)
                device.syn()
        while (event := device.read_one()) is not None:
            if event.type == e.EV_UINPUT and event.code == e.UI_FF_UPLOAD:
                upload = ff.UInputUpload()
                upload.request_id = event.value  # evdev's own begin_upload leaves it out
                device.dll._uinput_begin_upload(device.fd, ctypes.byref(upload))
                upload.retval = 0
                effect = upload.effect
                about = {
                    "kind": effect.type, "direction": effect.direction,
                    "level": effect.u.ff_constant_effect.level,
                    "coefficient": effect.u.ff_condition_effect[1].right_coeff,
                }  # fmt: skip
                print(json.dumps(["upload", effect.id, about]), flush=True)
                device.dll._uinput_end_upload(device.fd, ctypes.byref(upload))
            elif event.type == e.EV_UINPUT and event.code == e.UI_FF_ERASE:
                erase = ff.UInputErase()
                erase.request_id = event.value
                device.dll._uinput_begin_erase(device.fd, ctypes.byref(erase))
                erase.retval = 0
                print(json.dumps(["erase", erase.effect_id, None]), flush=True)
                device.dll._uinput_end_erase(device.fd, ctypes.byref(erase))
            elif event.type == e.EV_FF:
                print(json.dumps(["play", event.code, event.value]), flush=True)


if __name__ == "__main__":
    _keep()
