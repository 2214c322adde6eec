"""Short dropouts of stick or page pause the robot; in simulated time."""

from __future__ import annotations

import pytest

from cohelm.core.types import Stick
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.operator import Scripted
from cohelm.loop.stick import CENTRED_WITHIN, WAITING
from cohelm.robot.gate.modes import GateMode
from tests.drive.faults import failing
from tests.drive.test_losing import BRAKING, drive, speed
from tests.few import first

GONE = Command(Stick(0.0, 0.0), False, False, Device.NONE, 1.0)
"""What a station says for a page that says nothing."""


class Anna(Scripted):
    """Holds a gamepad at `stick`; with `gone` her page says nothing, with `dark` her link does."""

    def __init__(self) -> None:
        super().__init__(lambda _: None, lambda: 0.0)
        self.stick, self.gone, self.dark, self.armed = Stick(0.0, 0.0), False, 0.0, True
        self.driver, self.device = 1, Device.GAMEPAD

    def receive(self):
        said = super().receive()
        command = Command(self.stick, True, self.armed, self.device, 1.0)
        command = GONE if self.gone else command
        self.dark += 0.02 if self.dark else 0.0
        late = self.dark > 0.25
        return said._replace(
            driver=self.driver, command=None if late or not self.driver else command,
            age=max(self.dark, 0.02),
        )  # fmt: skip


@pytest.fixture
def anna():
    return Anna()


@pytest.fixture
def session(anna):
    with Session(SessionConfig(failing("nothing", 1e9)), anna) as session:
        yield session


def lead(session: Session, anna: Anna, mode: Mode) -> None:
    """Have her choose a mode and drive."""
    anna.ask(RequestKind.MODE, mode)
    drive(session, 0.2)
    anna.stick = Stick(0.9, 0.0)
    drive(session, 1.5)
    assert speed(session) > 0.15
    assert session.loop.supervisor.mode == mode


def away(anna: Anna, how: str, yes: bool) -> None:
    anna.gone = yes and how == "page"
    anna.dark = 0.02 if yes and how == "link" else 0.0


@pytest.mark.parametrize("how", ["page", "link"])
@pytest.mark.parametrize("mode", first([Mode.SHARED, Mode.MANUAL]))
def test_a_short_dropout_is_no_stop_and_resumes_only_with_a_centred_stick(session, anna, how, mode):
    lead(session, anna, mode)
    away(anna, how, True)
    drive(session, 0.5)
    assert session.loop.supervisor.paused.startswith("the stick is lost")
    away(anna, how, False)  # still held forward
    drive(session, 0.3)
    assert session.loop.supervisor.paused == WAITING
    assert anna.statuses[-1].why == WAITING
    assert anna.statuses[-1].arming == Arming.WAITING
    drive(session, 1.0)
    assert speed(session) == 0.0
    anna.stick = Stick(0.0, 0.0)
    drive(session, 0.04)
    assert session.loop.supervisor.paused == ""
    anna.stick = Stick(0.9, 0.0)
    drive(session, 1.5)
    assert speed(session) > 0.15
    assert session.loop.supervisor.mode == mode
    assert session.gated.gate.mode == GateMode.SHARED
    assert not anna.statuses[-1].stopped
    assert not session.loop.alarms.worst()


def test_a_short_dropout_of_the_driver_is_no_stop_in_automatic_mode(session, anna):
    anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
    drive(session, 1.5)
    away(anna, "link", True)
    drive(session, 0.3 + BRAKING)
    assert "the driver is lost" in session.loop.supervisor.paused
    assert speed(session) == 0.0
    away(anna, "link", False)
    drive(session, 1.0)
    assert speed(session) > 0.15
    assert session.loop.supervisor.mode == Mode.AUTOMATIC
    assert not session.loop.alarms.worst()


@pytest.mark.parametrize("how", ["page", "link"])
def test_more_than_a_second_latches_a_stop(session, anna, how, monkeypatch):
    said = []
    monkeypatch.setattr(session.loop.log, "event", lambda text, *_: said.append(text))
    lead(session, anna, Mode.SHARED)
    away(anna, how, True)
    drive(session, 0.9)
    assert session.gated.gate.mode == GateMode.SHARED
    drive(session, 0.3)
    assert session.gated.gate.mode == GateMode.STOPPED
    assert "the stick is lost" in session.gated.gate.reason
    away(anna, how, False)
    anna.stick = Stick(0.0, 0.0)
    drive(session, 1.0)
    assert speed(session) == 0.0
    assert session.loop.supervisor.paused == ""
    assert any("stands: the stick is lost" in text for text in said)
    assert not any("goes on" in text for text in said)
    assert any("the stick is lost" in a.text for a in session.loop.alarms.worst())


def test_a_stick_that_is_not_released_after_a_dropout_latches_a_stop(session, anna):
    lead(session, anna, Mode.SHARED)
    away(anna, "page", True)
    drive(session, 0.4)
    away(anna, "page", False)
    drive(session, CENTRED_WITHIN + 0.1)
    assert session.gated.gate.mode == GateMode.STOPPED


@pytest.mark.parametrize("what", first(["disarmed", "released", "given away", "another device"], 2))
def test_a_deliberate_action_during_a_dropout_ends_it(session, anna, what):
    lead(session, anna, Mode.SHARED)
    if what != "disarmed":
        away(anna, "page", True)
        drive(session, 0.4)
        away(anna, "page", False)
    anna.armed = what != "disarmed"
    anna.driver = {"released": 0, "given away": 2}.get(what, 1)
    anna.device = Device.KEYBOARD if what == "another device" else Device.GAMEPAD
    anna.stick = Stick(0.0, 0.0)
    drive(session, 0.06)
    assert session.gated.gate.mode == GateMode.STOPPED
    drive(session, 1.0)
    assert speed(session) == 0.0


@pytest.mark.parametrize("mode", first([Mode.HOLD, Mode.MANUAL, Mode.SHARED]))
def test_a_mode_chosen_during_a_dropout_takes_precedence(session, anna, mode):
    lead(session, anna, Mode.SHARED)
    away(anna, "page", True)
    drive(session, 0.5)
    assert session.loop.supervisor.paused
    anna.ask(RequestKind.MODE, mode)
    drive(session, 0.04)
    assert session.loop.supervisor.mode == mode
    away(anna, "page", False)
    anna.stick = Stick(0.0, 0.0)
    drive(session, 1.0)
    assert session.loop.supervisor.mode == mode
    assert (speed(session) > 0.1) is (mode == Mode.SHARED)  # which she chose, and nobody steers


def test_a_stop_during_a_dropout_takes_precedence(session, anna):
    lead(session, anna, Mode.SHARED)
    away(anna, "page", True)
    drive(session, 0.5)
    anna.ask(RequestKind.STOP)
    away(anna, "page", False)
    anna.stick = Stick(0.0, 0.0)
    drive(session, 1.0)
    assert session.gated.gate.reason == "stop by script"
    assert session.loop.supervisor.paused == ""
    anna.ask(RequestKind.RESET)
    drive(session, 1.0)
    assert speed(session) == 0.0


def test_a_stop_is_executed_before_other_requests_of_the_same_period(session, anna):
    lead(session, anna, Mode.SHARED)
    anna.ask(RequestKind.MODE, Mode.HOLD)
    anna.ask(RequestKind.STOP)
    drive(session, 0.04)
    assert session.gated.gate.reason == "stop by script"
    assert [number for number, _, _ in anna.answers][-2:] == [3, 2]


@pytest.mark.parametrize("mode", first([Mode.MANUAL, Mode.SHARED]))
def test_after_a_stop_a_stick_that_is_held_does_not_steer_until_it_was_centred(session, anna, mode):
    lead(session, anna, mode)
    anna.ask(RequestKind.STOP)
    drive(session, BRAKING + 0.5)
    anna.ask(RequestKind.RESET)
    drive(session, 0.1)
    anna.ask(RequestKind.MODE, mode)
    drive(session, 0.5)
    assert session.loop.supervisor.stick_state.arming == Arming.WAITING
    assert session.loop.supervisor.stick_state.stick == Stick(0.0, 0.0)
    anna.stick = Stick(0.0, 0.0)
    drive(session, 0.1)
    anna.stick = Stick(0.9, 0.0)
    drive(session, 1.5)
    assert session.loop.supervisor.stick_state.arming == Arming.ARMED
    assert speed(session) > 0.15
