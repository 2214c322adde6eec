"""`cohelm stick` with a device that is gone and repeats its last deflection; what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Answer, Command, Device, Mode, RequestKind
from cohelm.link.station_end import StampedMessage
from cohelm.link.sticks.port import Button, Feel, Reading
from cohelm.link.sticks.stick_client import Helm, SpeedLimits
from tests.link.ends import STATUS


class End:
    """The station's end: what is steered and asked."""

    def __init__(self) -> None:
        self.steered: list[Command] = []
        self.asked: list[RequestKind] = []
        self.answers: dict[int, Answer] = {}

    def status(self):
        return StampedMessage(STATUS, 0.0, 0.0)

    def steer(self, command: Command) -> None:
        self.steered.append(command)

    def ask(self, what: RequestKind, value: int = 0) -> int:
        self.asked.append(what)
        return len(self.asked)

    def answer(self, number: int) -> Answer | None:
        return self.answers.get(number)


class Pad:
    """A device in a test's hand."""

    name, kind, force, repeats = "pad", Device.GAMEPAD, False, True

    def __init__(self) -> None:
        self.stick, self.pressed = CENTRED, tuple[Button, ...]()

    def read(self) -> Reading:
        pressed, self.pressed = self.pressed, ()
        return Reading(self.stick, True, "", pressed)

    def feel(self, feel: Feel) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture
def helm():
    end, pad = End(), Pad()
    made = Helm(end, pad, SpeedLimits(1.0, 1.0), 5.0)  # type: ignore[arg-type]
    return SimpleNamespace(end=end, pad=pad, helm=made, now=100.0)


def holds(helm, stick: Stick, seconds: float, trembles: float = 0.0) -> Command:
    for k in range(round(seconds / 0.02)):
        helm.now += 0.02
        helm.pad.stick = stick if k % 2 else Stick(stick.x, stick.psi - trembles)
        assert helm.helm.turn(helm.now).valid  # the process goes on
    return helm.end.steered[-1]


@pytest.mark.parametrize(("stick", "after"), [(Stick(0.5, 0.0), 3.0), (Stick(1.0, 0.0), 10.0)])
def test_a_pad_that_is_gone_and_repeats_its_deflection_is_lost(helm, stick, after):
    assert holds(helm, CENTRED, 60.0).armed  # centred, nothing depends on it
    assert holds(helm, stick, after - 0.5).valid
    lost = holds(helm, stick, 1.0)
    assert (lost.valid, lost.armed, lost.stick) == (False, False, CENTRED)
    assert helm.helm.stuck == f"pad: nothing new for {after:g} s: centre the stick"
    back = holds(helm, Stick(0.4, 0.0), 0.1)
    assert back.valid
    assert not back.armed
    assert holds(helm, CENTRED, 0.1).armed
    assert helm.helm.stuck == ""


def test_a_hand_trembles_and_a_device_that_answers_is_not_gone(helm):
    holds(helm, CENTRED, 0.1)
    assert holds(helm, Stick(0.5, 0.2), 20.0, trembles=1e-3).valid
    helm.pad.repeats = False
    assert holds(helm, Stick(0.5, 0.2), 20.0).valid


def test_what_is_refused_is_said(helm):
    helm.pad.pressed = (Button.STOP, Button.RESET, Button.MODE, Button.LEASE)
    holds(helm, CENTRED, 0.1)
    assert helm.end.asked == [
        RequestKind.STOP, RequestKind.RESET, RequestKind.MODE, RequestKind.GIVE
    ]  # fmt: skip
    assert STATUS.mode is Mode.SHARED
    helm.end.answers = {n: Answer(n, n == 1, "" if n == 1 else f"because {n}") for n in range(1, 5)}
    holds(helm, CENTRED, 0.1)
    assert helm.helm.refusals == [
        "reset: because 2", "mode automatic: because 3", "give back the lease: because 4"
    ]  # fmt: skip
