"""`cohelm stick`: a local stick drives over the real link."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from cohelm.cli import app
from cohelm.core.types import CENTRED, Stick, StickRecording, Twist
from cohelm.link import keys as pairing
from cohelm.link.bulk_messages import Hello
from cohelm.link.keys import pair_here
from cohelm.link.messages import Device, Mode, RequestKind
from cohelm.link.robot_bulk import both_ends
from cohelm.link.sticks import choose
from cohelm.link.sticks.choose import FileStick
from cohelm.link.sticks.port import Button, Feel, Reading
from cohelm.link.sticks.stick_client import STOOD, drive
from tests.link.ends import NAN, STATUS, until
from tests.link.side import Side, Used

pytestmark = pytest.mark.xdist_group("realtime")
HERE = "127.0.0.1"


class Robot:
    """Its loop, as far as the driver is concerned."""

    def __init__(self, keys) -> None:
        self.end, self.bulk = both_ends(keys, HERE)
        outline = np.zeros((3, 2), np.float32)
        self.bulk.publish(Hello("sally", outline, 2.0, 1.0, (NAN, NAN, NAN, NAN), False))
        self.side = Side()
        self.hands: list[Used] = []
        self._open = True
        self._thread = threading.Thread(target=self._loop)
        self._thread.start()

    def _loop(self) -> None:
        while self._open:
            heard = self.end.receive()
            for asked in heard.requests:
                granted, why = self.side.ask(asked.request, asked.name)
                self.end.answer(asked.client, asked.request.number, granted, why)
            if heard.driver or self.hands:
                self.hands.append(self.side.step(heard))
            self.end.send_status(
                STATUS._replace(
                    mode=self.side.mode, stopped=self.side.stopped,
                    arming=self.side.stick_state.arming,
                    nominal=Twist(1.0, 0.0), applied=Twist(0.5, 0.0),
                )
            )  # fmt: skip
            time.sleep(0.02)

    def close(self) -> None:
        self._open = False
        self._thread.join()
        self.bulk.close()
        self.end.close()


@pytest.fixture
def robot():
    robot_keys, keys = pair_here()
    robot = Robot(robot_keys)
    yield robot, keys
    robot.close()


class Held:
    """A device in a test's hand, that notes what is felt."""

    name, kind, force, repeats = "held", Device.FORCE_STICK, True, False

    def __init__(self) -> None:
        self.stick, self.there = CENTRED, True
        self.buttons: list[Button] = []
        self.felt: list[Feel] = []

    def read(self) -> Reading:
        pressed, self.buttons = tuple(self.buttons), []
        return Reading(self.stick, self.there, "" if self.there else "held: unplugged", pressed)

    def feel(self, feel: Feel) -> None:
        self.felt.append(feel)

    def close(self) -> None:
        self.there = False


def test_a_stick_takes_the_lease_steers_gets_force_feedback_and_its_loss_stops_the_robot(robot):
    robot, keys = robot
    held, said = Held(), []
    thread = threading.Thread(
        target=drive, args=(held, keys, (HERE, robot.end.address[1]), 5.0, said.append)
    )
    thread.start()
    until(lambda: robot.hands and robot.hands[-1].arming == 2)
    held.stick = Stick(0.5, 0.0)
    until(lambda: robot.hands[-1].stick == Stick(0.5, 0.0))
    # half a metre a second of two is held back: a quarter, times the gain
    until(lambda: held.felt[-1].push.x == pytest.approx(-0.2, abs=0.01))
    assert held.felt[-1].spring == 0.5
    held.buttons = [Button.MODE]
    until(lambda: robot.side.mode is Mode.AUTOMATIC)
    held.buttons = [Button.STOP]
    until(lambda: robot.side.stopped)
    held.stick = CENTRED
    until(lambda: robot.hands[-1].arming == 2)
    # half is held back still, but a cue would move a stick that nobody holds, and so the robot
    until(lambda: held.felt[-1].push == CENTRED, within=2.0)
    held.buttons = [Button.RESET, Button.MODE]
    until(lambda: not robot.side.stopped and robot.side.mode is Mode.SHARED)
    until(lambda: robot.hands[-1].arming == 2)
    held.there = False
    until(lambda: robot.side.stopped)
    assert robot.hands[-1].brake
    thread.join(3.0)
    assert not thread.is_alive()
    assert "you drive" in said
    assert "held: unplugged" in said


def test_a_stick_whose_process_stands_still_is_a_driver_that_has_gone(robot):
    """A terminal that is paused blocks what is said: in automatic mode no stick can be lost."""
    robot, keys = robot
    held, paused, goes_on = Held(), threading.Event(), threading.Event()

    def say(text: str) -> None:
        if text == "mode: automatic":
            paused.set()
            goes_on.wait()

    thread = threading.Thread(
        target=drive, args=(held, keys, (HERE, robot.end.address[1]), 5.0, say)
    )
    thread.start()
    until(lambda: robot.hands and robot.hands[-1].arming == 2)
    held.buttons = [Button.MODE]
    until(paused.is_set)
    until(lambda: robot.side.stick_state.driver_lost)
    asked = len(robot.side.asked)
    held.buttons = [Button.RESET, Button.STOP, Button.MODE]  # who knows when
    time.sleep(STOOD)
    goes_on.set()
    until(lambda: len(robot.side.asked) > asked)
    until(lambda: not robot.side.stick_state.driver_lost)
    assert robot.side.asked[asked:] == [RequestKind.STOP]
    held.there = False
    thread.join(3.0)
    assert not thread.is_alive()


def test_a_stick_file_drives_and_its_end_is_a_lost_stick(robot):
    robot, keys = robot
    record = StickRecording(
        np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.75, 0.75]), np.array([0.0, -0.5, -0.5])
    )
    played = FileStick(record, "record", time.monotonic)
    drive(played, keys, (HERE, robot.end.address[1]), 5.0, lambda _: None)
    until(lambda: robot.side.stopped)
    used = {result.stick for result in robot.hands if result.stick != CENTRED}
    assert used == {Stick(0.75, -0.5)}
    assert robot.side.stopped in ("no valid stick input", "there is no driver any more")


def test_the_stick_command_reports_missing_options_and_lists_devices(tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path))
    run = CliRunner().invoke
    assert "--robot" in str(run(app, ["stick"]).exception)
    assert "paired with no robot" in str(run(app, ["stick", "--robot", HERE]).exception)
    pairing.pair("anna", tmp_path / "anna.pair")
    pairing.install(tmp_path / "anna.pair")
    missing = run(app, ["stick", "--robot", HERE, "--device", str(tmp_path / "none.csv")])
    assert "none.csv" in str(missing.exception)
    pytest.importorskip("pygame")
    monkeypatch.setattr(choose, "listed", list)
    assert "no stick is here: plug one in" in run(app, ["stick", "--list"]).stderr
    monkeypatch.undo()
    assert run(app, ["stick", "--list"]).exit_code == 0
