"""The conformance suite of stick devices, and tests of single devices."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Stick, StickRecording
from cohelm.link.sticks import choose
from cohelm.link.sticks.choose import FileStick
from cohelm.link.sticks.port import Button, Feel, StickDevice
from tests.link.ends import until
from tests.link.sticks.cls2sim import CLS2SimServer
from tests.link.sticks.virtual import VirtualEvdev, VirtualSdl

UINPUT = Path("/dev/uinput").exists()
needs_uinput = pytest.mark.skipif(
    not UINPUT, reason="/dev/uinput is missing: force feedback is not proved here"
)
pytestmark = pytest.mark.xdist_group("sticks")


class Played:
    """A record is moved by its clock."""

    def __init__(self) -> None:
        self.now = 0.0
        self.steps = [CENTRED]

    def open(self) -> StickDevice:
        record = StickRecording(
            np.arange(100.0), np.linspace(0.0, 0.99, 100), np.linspace(0.0, -0.99, 100)
        )
        return FileStick(record, "played", lambda: self.now)

    def move(self, stick: Stick) -> None:
        self.now = round(stick.x * 100.0)

    def unplug(self) -> None:
        self.now = 1000.0


class Sdl(VirtualSdl):
    def open(self) -> StickDevice:
        from cohelm.link.sticks.sdl_stick import SdlStick

        return SdlStick(self.index)


class Evdev(VirtualEvdev):
    def open(self) -> StickDevice:
        from cohelm.link.sticks.evdev_stick import EvdevStick

        return EvdevStick(self.path)


class Brunner:
    """Behind a CLS2Sim of our own; unplugged is a CLS2Sim that ended."""

    def __init__(self) -> None:
        self._server = CLS2SimServer()

    def open(self) -> StickDevice:
        return choose.opened(f"{self._server.url}?force=500")

    def move(self, stick: Stick) -> None:
        self._server.stick.hold(stick)

    def unplug(self) -> None:
        self._server.close()


@pytest.fixture(params=[Played, Sdl, Brunner, pytest.param(Evdev, marks=needs_uinput)])
def plug(request):
    if request.param in (Sdl, Evdev):
        pytest.importorskip("pygame" if request.param is Sdl else "evdev")
    plug = request.param()
    plug.open_ = True
    yield plug
    if plug.open_:
        plug.unplug()


def test_it_is_valid_and_follows_the_hand_forward_and_left_positive(plug):
    device = plug.open()
    assert device.name
    assert device.read().valid
    plug.move(Stick(0.5, -0.5))
    until(lambda: device.read().stick == pytest.approx((0.5, -0.5), abs=0.01), within=2.0)
    assert all(-1.0 <= axis <= 1.0 for axis in device.read().stick)
    device.close()


def test_a_lost_stick_is_not_centred_but_invalid_with_the_reason(plug):
    device = plug.open()
    device.read()
    plug.move(Stick(0.5, -0.5))
    until(lambda: device.read().stick.x, within=2.0)
    plug.unplug()
    plug.open_ = False
    until(lambda: not device.read().valid, within=2.0)
    reading = device.read()
    assert reading.stick == CENTRED
    assert device.name in reading.why
    device.feel(Feel(0.5, Stick(0.1, 0.1)))  # feels nothing, and does not raise
    device.close()


def test_a_gamepad_unplugged_after_a_long_drive_is_lost():
    """SDL keeps 65 535 events, some minutes of a moving stick, and drops further ones."""
    pygame = pytest.importorskip("pygame")
    plug = Sdl()
    device = plug.open()
    moved = pygame.event.Event(pygame.JOYAXISMOTION, instance_id=0, axis=0, value=0.0)
    for _ in range(7):
        with suppress(pygame.error):  # the queue is full
            for _ in range(10_000):
                pygame.event.post(moved)
        assert device.read().valid
    plug.unplug()
    until(lambda: not device.read().valid, within=2.0)
    assert "unplugged" in device.read().why
    device.close()


def test_force_feedback_is_accepted_at_any_time_and_closing_twice_is_allowed(plug):
    device = plug.open()
    for push in (0.0, 0.4, -0.4, 1.0):
        device.feel(Feel(0.5, Stick(push, -push)))
        assert device.read().valid
    device.close()
    device.close()
    reading = device.read()
    assert not reading.valid
    assert "closed" in reading.why


@pytest.mark.parametrize("kind", [Sdl, pytest.param(Evdev, marks=needs_uinput)])
def test_a_button_press_is_reported_once(kind):
    plug = kind()
    device = plug.open()
    device.read()
    for button in Button:
        pressed: list[Button] = []
        plug.press(button, True)
        until(
            lambda p=pressed: p, within=2.0, turn=lambda p=pressed: p.extend(device.read().pressed)
        )
        assert pressed == [button]
        assert not device.read().pressed
        plug.press(button, False)
        assert not device.read().pressed
    device.close()
    plug.unplug()


@needs_uinput
def test_the_kernel_plays_the_spring_and_the_cue_and_ends_them_with_the_program():
    from evdev import ecodes

    plug = Evdev()
    device = plug.open()
    assert device.force
    device.feel(Feel(0.5, Stick(-0.4, 0.0)))
    until(lambda: len(plug.playing) == 2, within=2.0)
    (spring,) = (e for e in plug.effects.values() if e["kind"] == ecodes.FF_SPRING)
    assert spring["coefficient"] == round(0.5 * 0x7FFF)
    ((push, constant),) = (
        (n, e) for n, e in plug.effects.items() if e["kind"] == ecodes.FF_CONSTANT
    )
    assert constant["direction"] == 0  # towards the person
    assert constant["level"] == round(0.4 * 0x7FFF)
    device.feel(Feel(0.5, Stick(0.0, 0.2)))
    until(lambda: plug.effects[push]["direction"] == 0x4000, within=2.0)
    assert len(plug.effects) == 2  # changed, not added
    device.close()
    until(lambda: not plug.effects, within=2.0)
    plug.unplug()


def test_the_first_device_is_chosen_and_an_unusable_one_is_reported(tmp_path, monkeypatch):
    pytest.importorskip("pygame")
    monkeypatch.setattr(choose, "_evdev_paths", list)
    names = choose._sdl_names
    monkeypatch.setattr(choose, "_sdl_names", list)  # whatever is plugged in here
    with pytest.raises(CohelmError, match="group 'input'"):
        choose.opened(None)
    with pytest.raises(CohelmError, match="number 7"):
        choose.opened("7")
    with pytest.raises(CohelmError, match="can not be opened"):
        choose.opened("/dev/input/event-none")
    with pytest.raises(CohelmError):
        choose.opened(str(tmp_path / "none.csv"))
    monkeypatch.setattr(choose, "_sdl_names", names)
    plug = Sdl()
    assert any("Virtual" in line or line[0].isdigit() for line in choose.listed())
    device = choose.opened(None)
    assert device.read().valid
    device.close()
    plug.unplug()
    (tmp_path / "hand.csv").write_text("t,x,psi\n0,0,0\n1,0.5,0\n")
    played = choose.opened(str(tmp_path / "hand.csv"))
    assert played.read().stick == CENTRED
    time.sleep(0.01)
    played.close()
