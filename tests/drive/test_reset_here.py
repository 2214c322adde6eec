"""Reset of a latched stop without a station."""

from __future__ import annotations

import os
import pty
import threading
import time
from pathlib import Path

import pytest

from cohelm.cli.terminal import _terminal, typed
from cohelm.core.errors import CohelmError
from cohelm.drive.factory import simulated
from cohelm.drive.on_topics import OnTopics, TopicsConfig, on_topics
from cohelm.drive.reset_here import ResetHere
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.robot.port import FailedCall, Health
from cohelm.ros.port import Received
from cohelm.ros.reset import resets
from tests.cli.test_bad_input import refused
from tests.drive.faults import CORRIDOR, along_corridor
from tests.patience import looks
from tests.ros.test_joy import Topic


class Drive:
    """One in simulated time, that a test stops and resets."""

    def __init__(self, mode: Mode = Mode.AUTOMATIC, joy: Topic | None = None) -> None:
        self.mode, self.joy = mode, joy
        self.said: list[str] = []
        self.speeds: list[float] = []
        self.reset = ResetHere(mode, self.said.append)
        self.topics = OnTopics(None, None, joy=None if joy is None else joy.operator)

    def run(self, script) -> None:
        """script: of a loop, yields once a period."""
        made = along_corridor(8.0)
        operator = None if self.joy is None else self.joy.operator
        with Session(SessionConfig(made, localise=False), operator) as session:
            self.topics.begin(session)
            steps = script(session.loop)

            def until(loop) -> bool:
                self.speeds.append(loop.gated.truth().twist.v)
                if self.joy is not None:
                    self.joy.now = loop.gated.now()
                    (x,) = self.hand
                    trembling = x + 0.001 * (len(self.speeds) % 2) if x else x
                    self.joy.say(trembling)
                self.topics.turn(loop)
                self.reset.turn(loop, self.topics.joy)
                return next(steps, "over") == "over"

            session.run(until, self.mode)

    def asks(self, age: float = 0.0) -> None:
        self.reset.ask("/reset", time.monotonic() - age)

    def fastest(self, last: int) -> float:
        return max(self.speeds[-last:])


def test_a_first_reset_releases_the_stop_and_a_second_resumes_the_mode():
    drive = Drive()

    def script(loop):
        yield from range(150)
        assert drive.fastest(10) > 0.2
        loop.gated.stop("somebody did")
        yield from range(100)
        drive.asks()
        yield from range(100)
        assert drive.said == [
            "/reset: reset; the robot stands; once more continues in automatic mode"
        ]
        assert drive.fastest(100) == 0.0
        drive.asks()
        yield from range(100)
        assert drive.said[1:] == ["/reset: continues in automatic mode"]
        assert drive.fastest(10) > 0.2
        drive.asks()
        yield from range(10)
        assert drive.said[2:] == ["/reset: there is nothing to reset"]

    drive.run(script)


def test_a_reset_from_before_the_stop_or_while_braking_or_faulty_is_refused():
    drive = Drive()

    def script(loop):
        yield from range(150)
        loop.gated.stop("somebody did")
        yield from range(2)
        drive.asks(age=60.0)
        yield from range(3)
        assert drive.said == [
            "/reset: not reset: the robot was stopped after your request: request it again"
        ]
        drive.asks()
        yield from range(100)
        assert drive.said[1:] == ["/reset: not reset: the robot is still braking"]
        loop.supervisor.rights.revoke(0, loop.gated.now())  # and now it is to hold
        drive.asks(age=60.0)
        yield from range(20)
        assert drive.said[2].startswith(
            "/reset: not reset: the robot was stopped after your request"
        )
        assert drive.fastest(20) == 0.0

    drive.run(script)


def test_a_robot_started_in_hold_is_reset_to_hold():
    drive = Drive(Mode.HOLD)

    def script(loop):
        yield from range(20)
        loop.gated.stop("somebody did")
        yield from range(20)
        drive.asks()
        yield from range(20)
        drive.asks()
        yield from range(50)
        assert drive.said == [
            "/reset: reset; the robot stands",
            "/reset: there is nothing to reset, and the drive began in hold",
        ]  # fmt: skip
        assert drive.fastest(90) == 0.0

    drive.run(script)


def test_a_deflected_joystick_does_not_move_the_robot_after_a_reset():
    drive = Drive(Mode.MANUAL, Topic())
    drive.hand = (0.0,)

    def script(loop):
        yield from range(50)
        drive.hand = (0.8,)
        yield from range(100)
        assert drive.fastest(10) > 0.2
        loop.gated.stop("somebody did")
        yield from range(100)
        drive.asks()
        yield from range(20)
        drive.asks()
        yield from range(100)
        assert drive.said[1] == "/reset: continues in manual mode"
        assert drive.fastest(120) == 0.0
        drive.hand = (0.0,)
        yield from range(50)
        drive.hand = (0.8,)
        yield from range(100)
        assert drive.fastest(10) > 0.2

    drive.run(script)


class Wire:
    def subscribe(self, topic, kind, qos, heard):
        self.heard = heard
        return lambda: None


def test_a_topic_that_publishes_resets_continuously_is_refused():
    wire, asked, said = Wire(), [], []
    resets(wire, "/reset", asked.append, said.append)
    for t in (10.0, 11.0, 12.0, 13.0, 16.0):  # ros2 topic pub without --once: every second
        wire.heard(Received(object(), t))
    wire.heard(Received(None, 30.0, "bytes that are none"))
    assert asked == [10.0, 16.0]
    assert said == ["/reset is published continuously: publish it once (ros2 topic pub --once)"]


def test_a_reset_typed_in_the_terminal_counts_and_other_input_does_not(monkeypatch):
    keys, end = pty.openpty()
    monkeypatch.setattr("cohelm.cli.terminal.foreground", lambda _: True)
    resets_, said = [], []
    with typed(end, lambda: resets_.append(1), said.append):
        for line in (b"\n", b"R\n", b" reset \n", b"rr\n"):
            os.write(keys, line)
            time.sleep(0.05)
        for _ in looks(10.0, 0.02, 0.2):
            if said:
                break
    assert resets_ == [1, 1]
    assert said == ["type r and Enter to reset; Ctrl-C ends it"]
    with typed(end, lambda: resets_.append(1), said.append):
        os.close(keys)  # the terminal was closed, and nobody asks it again and again
        for _ in looks(10.0, 0.02, 0.2):
            listens = any(one.name == "typed" for one in threading.enumerate())
            if not listens:
                break
        assert not listens
    os.close(end)


def test_without_a_terminal_nothing_is_read(monkeypatch):
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        assert _terminal() == -1


def test_a_reset_topic_needs_a_ros2_robot_without_stations(cohelm):
    made = simulated(CORRIDOR, real_time=False)
    with (
        pytest.raises(CohelmError, match="--reset-from and --joy are of a ROS 2 robot"),
        on_topics(made, TopicsConfig(resets="/reset"), print),
    ):
        pass
    listens = ("--listen", "127.0.0.1", "--reset-from", "/reset")
    refused(cohelm("robot", "lab-guard", *listens), "a station resets it: leave out --reset-from")


def faulty_for_a_while(broken, why: str) -> None:
    """A drive with a faulty robot, whose reset is refused with that reason, and later made. broken:
    makes the faulty `read` of the sound one."""
    drive = Drive()

    def script(loop):
        yield from range(50)
        robot = loop.gated._robot
        sound = robot.read
        robot.read = broken(sound)
        yield from range(60)
        drive.asks()
        yield from range(10)
        assert drive.said == [f"/reset: not reset: {why}"]
        robot.read = sound
        yield from range(10)
        drive.asks()
        yield from range(10)
        assert drive.said[1].startswith("/reset: reset")

    drive.run(script)


@pytest.mark.parametrize("fault", ["the button is pressed", "read failed: the tag is dirty"])
def test_a_stop_is_not_reset_while_the_robot_reports_a_fault(fault):
    """Of any wording: one that began like a driver's exception was taken for one."""
    sick = Health(0.0, 0.5, (fault,))
    faulty_for_a_while(
        lambda read: lambda: read()._replace(health=sick), f"the robot reports: {fault}"
    )


def test_a_reset_is_refused_for_the_call_that_still_fails_and_not_for_the_readings_that_age_by_it():
    why = "OSError: no device"
    failed = Health(0.0, 0.5, (f"read failed: {why}",), FailedCall("read", why))

    def broken(read):
        kept = read()._replace(health=failed)
        return lambda: kept

    faulty_for_a_while(broken, "read still fails: OSError: no device")
