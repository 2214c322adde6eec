"""Loss of sensors, stick and driver in simulated time."""

from itertools import pairwise

import pytest

from cohelm.core.types import Stick
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Arming, Mode, RequestKind
from cohelm.link.operator import Scripted
from cohelm.loop.loop import LoopParams
from cohelm.loop.stick import BACK_WITHIN
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.gated_robot import standing
from tests.drive.faults import FAULTS, HELD_UP, NOTICED, REAR_FAULTS, along_corridor, failing
from tests.few import first

AT = 1.5
BRAKING = 0.05 + 0.5 / 2.0 + 0.1
"""The delay, from 0.5 m/s at 2 m/s^2, and a little for the odometry to show it [s]."""


def speed(session: Session) -> float:
    return abs(session.gated.truth().twist.v)


def drive(session: Session, seconds: float, mode: Mode = Mode.HOLD) -> None:
    end = session.loop.gated.now() + seconds
    session.run(lambda loop: loop.gated.now() >= end - 1e-9, mode)


ALIKE = ("odometry is not a number", "odometry is gone", "clock jumps on")
"""Noticed where others that are tried are: each alone is in tests/robot."""


@pytest.mark.parametrize(
    "fault", first(sorted(FAULTS, key=lambda fault: fault in ALIKE), len(FAULTS) - len(ALIKE))
)
def test_a_broken_sensor_stops_the_robot_for_good(fault, tmp_path):
    record = tmp_path / "drive.mcap" if fault == "scans stop" else None  # a process more
    with Session(SessionConfig(failing(fault, AT), record=record)) as session:
        drive(session, AT - session.loop.gated.now() - 0.02, Mode.AUTOMATIC)
        assert speed(session) > 0.4
        drive(session, 0.02 + NOTICED.get(fault, 0.04) + 0.02)
        assert session.gated.gate.mode == GateMode.FAULTED
        assert FAULTS[fault] in session.gated.gate.reason
        drive(session, BRAKING)
        assert speed(session) == 0.0
        assert session.loop.supervisor.mode == Mode.HOLD
        assert session.loop.alarms.worst()[0].active
        drive(session, 1.0)
        assert speed(session) == 0.0
    if record is not None:
        log = record.with_suffix(".log").read_text()
        assert f"AUTOMATIC -> FAULTED: {FAULTS[fault]}" in log
        assert "gate: stands, 0." in log


@pytest.mark.parametrize("fault", first(REAR_FAULTS, 2))
def test_a_broken_rear_lidar_stops_the_robot_too_and_is_named(fault):
    with Session(SessionConfig(failing(fault, AT))) as session:
        drive(session, AT - session.loop.gated.now() - 0.02, Mode.AUTOMATIC)
        assert speed(session) > 0.4
        drive(session, 0.04 + NOTICED.get(fault, 0.04) + BRAKING)
        assert session.gated.gate.mode == GateMode.FAULTED
        assert REAR_FAULTS[fault] in session.gated.gate.reason
        assert speed(session) == 0.0


def test_a_loop_delayed_while_reading_sees_no_reading_from_the_future():
    with Session(SessionConfig(failing(HELD_UP, AT))) as session:
        drive(session, AT + 0.2, Mode.AUTOMATIC)
        assert session.loop.supervisor.problem == ""
        assert "future" not in session.gated.gate.reason


def test_a_fault_of_a_robot_that_is_stopped_is_an_alarm_of_its_own():
    with Session(SessionConfig(along_corridor(20.0))) as session:
        drive(session, 1.0, Mode.AUTOMATIC)
        session.gated.stop("stop by anna")
        drive(session, 0.5)
        alarms = session.loop.alarms
        assert [alarm.text for alarm in alarms.worst()] == ["stop by anna"]
        assert alarms.acknowledge(0)
        session.gated.fault("the robot reports: fire")
        drive(session, 0.1)
        (fault,) = alarms.worst()
        assert fault.text == "the robot reports: fire (and stopped: stop by anna)"
        assert not fault.acknowledged


def test_after_a_fault_driving_needs_a_reset_and_a_mode_request():
    operator = Scripted(lambda _: None, lambda: 0.0)
    with Session(SessionConfig(failing("scans stop", AT)), operator) as session:
        drive(session, AT + 1.5, Mode.AUTOMATIC)
        robot = session.gated._robot
        operator.ask(RequestKind.RESET)
        drive(session, 0.1)
        assert session.gated.gate.mode == GateMode.FAULTED  # the cause is still there
        robot._fault = ""
        drive(session, 1.0)
        assert session.gated.gate.mode == GateMode.FAULTED
        operator.ask(RequestKind.RESET)
        drive(session, 1.0)
        assert session.gated.gate.mode == GateMode.IDLE
        assert speed(session) == 0.0
        operator.ask(RequestKind.MODE, Mode.AUTOMATIC)
        drive(session, 2.0)
        assert speed(session) > 0.3
    answers = [(granted, reason) for _, granted, reason in operator.answers]
    assert answers[0][0] is False
    assert "the scan is" in answers[0][1]
    assert answers[1:] == [(True, ""), (True, "")]


def hand(steer_from: float, gone_from: float, back_at: float = 1e9):
    """Centred, then to the left, then no stick, then centred again, in the robot's time."""

    def stick(t: float) -> Stick | None:
        if gone_from <= t < back_at:
            return None
        return Stick(0.0, 0.0) if t < steer_from or t >= back_at else Stick(0.9, 0.1)

    return stick


def shared(session_plan: SessionConfig, script) -> tuple[Session, Scripted]:
    box: list[Session] = []
    operator = Scripted(script, lambda: box[0].loop.gated.now() if box else 0.0)
    session = Session(session_plan, operator)
    box.append(session)
    return session, operator


def test_a_stick_lost_in_use_latches_a_stop():
    session, operator = shared(SessionConfig(failing("", AT)), hand(2.0, 3.0))
    with session:
        drive(session, 3.0 - session.loop.gated.now() - 0.02, Mode.SHARED)
        assert session.loop.supervisor.stick_state.arming == Arming.ARMED
        assert session.loop.decision.authority.x < 0.2
        drive(session, 0.06)
        assert "no valid stick input" in session.loop.supervisor.paused  # at once it brakes
        drive(session, BRAKING)
        assert speed(session) == 0.0
        drive(session, BACK_WITHIN + 0.06 - BRAKING)
        assert session.gated.gate.mode == GateMode.STOPPED
        assert "no valid stick input" in session.gated.gate.reason
        status = operator.statuses[-1]
        assert "no valid stick input" in status.stopped
        assert any("the stick is lost" in alarm.text for alarm in status.alarms)


def test_with_carry_on_the_controller_takes_over_without_a_jump():
    plan = SessionConfig(failing("", AT), loop=LoopParams(carry_on=True))
    session, operator = shared(plan, hand(2.0, 3.0, 5.0))
    twists = []
    with session:

        def until(loop):
            twists.append(session.gated.truth().twist)
            return loop.gated.now() >= 5.5

        session.run(until, Mode.SHARED)
        assert session.gated.gate.mode == GateMode.SHARED
        assert speed(session) > 0.3
        alarm = next(a for a in operator.statuses[-1].alarms if "the stick is lost" in a.text)
        assert not alarm.active  # the stick is back and centred
        assert not alarm.acknowledged  # but nobody has said so
    jumps = [abs(b.v - a.v) for a, b in pairwise(twists)]
    assert max(jumps) <= 2.0 * 0.02 + 1e-9


def test_an_unarmed_stick_may_be_lost_in_automatic_mode():
    session, _ = shared(SessionConfig(failing("", AT)), hand(2.0, 3.0))
    with session:
        drive(session, 4.0, Mode.AUTOMATIC)
        assert session.gated.gate.mode == GateMode.AUTOMATIC
        assert speed(session) > 0.4


def test_anyone_may_stop_and_only_the_driver_chooses_a_mode():
    def script(t: float) -> Stick:
        return Stick(0.0, 0.0) if t < 1.0 else Stick(0.8, 0.0)

    session, operator = shared(SessionConfig(failing("", AT)), script)
    with session:
        drive(session, 2.5, Mode.MANUAL)
        assert session.gated.gate.mode == GateMode.SHARED
        v = speed(session)
        assert 0.25 < v < 0.5  # 0.8 of the speed, less the share of nothing
        operator.ask(RequestKind.STOP)
        drive(session, 0.02 + BRAKING)
        assert speed(session) == 0.0
        assert session.gated.gate.reason == "stop by script"
        operator.ask(RequestKind.MODE, Mode.MANUAL)
        operator.ask(RequestKind.ACKNOWLEDGE, 0)
        operator.ask(RequestKind.MODE, 77)
        operator.ask(RequestKind.TAKE)
        drive(session, 0.1)
        assert operator.answers[1:] == [
            (2, False, "reset first: stop by script"),
            (3, True, ""),
            (4, False, "there is no such mode"),
            (5, False, "the loop does not do that"),
        ]


def test_the_route_is_driven_to_its_end_and_both_clocks_agree():
    with Session(SessionConfig(along_corridor(4.0))) as session:
        session.run(lambda loop: loop.driver.arrived or loop.gated.now() > 15.0, Mode.AUTOMATIC)
        truth = session.gated.truth()
        assert session.loop.driver.arrived
        assert truth.pose.x == pytest.approx(4.0, abs=0.05)
        assert abs(truth.pose.y) < 0.03
        assert truth.least_moving > 0.5
        session.end("the drive is over")
        assert standing(session.loop.seen.twist)
        assert session.summary()["arrived"]
        assert "STOPPED the drive is over" in session.line()


class Far(Scripted):
    """A driver without a stick, at the end of a link."""

    def __init__(self) -> None:
        super().__init__(lambda _: None, lambda: 0.0)
        self.age, self.scale = 0.02, 1.0

    def receive(self):
        said = super().receive()
        return said._replace(command=said.command._replace(speed_scale=self.scale), age=self.age)


@pytest.mark.parametrize("carry_on", [False, True])
def test_a_silent_driver_stops_an_automatic_robot_too_unless_it_may_carry_on(carry_on):
    operator = Far()
    plan = SessionConfig(failing("nothing", 1e9), loop=LoopParams(carry_on=carry_on))
    with Session(plan, operator) as session:
        operator.ask(RequestKind.MODE, Mode.AUTOMATIC)
        drive(session, 2.0)
        assert speed(session) > 0.4
        operator.scale = 0.5  # allows half the usual half a metre a second
        drive(session, 1.0)
        assert speed(session) == pytest.approx(0.25, abs=0.02)
        operator.age = 0.24
        drive(session, 0.1)
        assert speed(session) > 0.2  # late is not lost
        operator.age = 0.26
        drive(session, 0.02 + BRAKING)
        alarms = [alarm.text for alarm in session.loop.alarms.worst()]
        assert any("no command for 260 ms" in text for text in alarms)
        assert (speed(session) == 0.0) is not carry_on
        if not carry_on:
            operator.age = 0.02
            drive(session, 1.0)
            assert speed(session) == 0.0  # latched
