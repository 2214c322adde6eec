"""A hanging planner or recorder is reported, and the loop continues."""

import os
import signal
from contextlib import contextmanager
from itertools import pairwise

import pytest

from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.loop.loop import Loop
from cohelm.loop.planning import MAX_PLAN_AGE
from cohelm.robot.keep.record_pipe import HUNG_AFTER
from tests.drive.faults import CORRIDOR
from tests.patience import OwnTime
from tests.robot.keep.test_processes import children

pytestmark = pytest.mark.xdist_group("realtime")

PATIENT = 4.0  # of the machine the tests run on, which may stand still for seconds [s]
SLACK = 1.0  # until an alarm is seen, beyond what is promised; all by the loop's own time [s]
HELD_UP = 1.0  # a loop that waits for one who hangs is held up for longer [s]


@contextmanager
def stopped(*pids: int):
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


def alarms(loop: Loop) -> set[str]:
    return {alarm.text for alarm in loop.alarms.worst() if alarm.active}


def told(loop: Loop, what: str) -> bool:
    return any(what in text for text in alarms(loop))


def drive(session: Session, seconds: float, mode: Mode = Mode.HOLD, until=lambda _: False) -> float:
    """How long it took until `until`, or `seconds`; nothing has held up the loop meanwhile."""
    with OwnTime() as own:
        periods = [own.now()]

        def over(loop: Loop) -> bool:
            periods.append(own.now())
            return until(loop) or own.now() > seconds

        session.run(over, mode)
        took = own.now()
    assert max(then - before for before, then in pairwise(periods)) < HELD_UP
    return took


def test_a_hanging_planner_or_recorder_is_reported_and_the_robot_continues(tmp_path):
    plan = SessionConfig(
        simulated(CORRIDOR, seed=2), record=tmp_path / "drive.mcap", patience=PATIENT
    )
    with Session(plan) as session:
        loop, helpers = session.loop, children(os.getpid())
        planner, recorder = helpers["cohelm planner"], helpers["cohelm recorder"]
        drive(session, 1.0, Mode.AUTOMATIC)
        assert not alarms(loop)
        before = loop.seen.pose.x
        with stopped(planner, recorder):
            took = drive(session, 10.0, until=lambda loop: told(loop, "path planner does not"))
            assert took < MAX_PLAN_AGE + SLACK
            took += drive(session, 10.0, until=lambda loop: told(loop, "recorder is too slow"))
            assert took < HUNG_AFTER + SLACK
            assert loop.supervisor.mode == Mode.AUTOMATIC
            assert loop.seen.pose.x > before + 0.3
            assert not loop.driver.planner_gone
        drive(session, 10.0, until=lambda loop: not alarms(loop))
        assert not alarms(loop)
        assert loop.supervisor.mode == Mode.AUTOMATIC
        session.end("enough")
        assert loop.gated.gate.reason == "enough"
    log = (tmp_path / "drive.log").read_text()
    for helper in ("the path planner does not answer", "the recorder is too slow"):
        assert f"! loop: {helper}" in log
        assert f"loop: over: {helper}" in log


@pytest.mark.slow
def test_without_a_route_the_loop_waits_for_no_plan():
    with Session(SessionConfig(simulated(CORRIDOR, seed=2), patience=PATIENT)) as session:
        loop, planner = session.loop, children(os.getpid())["cohelm planner"]
        drive(session, 1.0, Mode.AUTOMATIC)
        with stopped(planner):
            drive(session, 10.0, until=lambda loop: told(loop, "path planner does not"))
            loop.supervisor.choose(Mode.HOLD)
            drive(session, 1.0, until=lambda loop: not alarms(loop))
            assert not alarms(loop)
        drive(session, MAX_PLAN_AGE + 0.5)
        drive(session, 1.0, Mode.AUTOMATIC, until=lambda loop: bool(alarms(loop)))
        assert not alarms(loop)
        session.end("enough")
