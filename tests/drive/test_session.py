"""Margins and delay of a session's guard, and the start and end of a session."""

import os
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from cohelm.core.types import Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.session import Session, SessionConfig, driver_of
from cohelm.law.verdict import Verdict
from cohelm.link.messages import Mode
from cohelm.loop import planning
from cohelm.loop.driver import Driver
from cohelm.loop.planning import RemotePlanner
from cohelm.robot.keep.process import RemoteGatedRobot
from cohelm.robot.port import Readings
from tests.drive.wrapped import wrapped


@pytest.mark.parametrize(("kind", "steps"), [("kinematic", 2), ("twin", 4)])
def test_the_guard_has_margins_for_lidar_noise_and_predicts_the_whole_lag(kind, steps):
    """50 ms of delay; the twin's drives lag by 20 more, and speed follows a line through a step."""
    plan = SessionConfig(simulated("lab-guard", kind, real_time=False))
    driver = driver_of(plan, real_time=False)
    assert driver.pilot is not None
    room = 2.0 * (0.008 + 0.02)
    law = plan.robot.scenario.law
    rules = driver.pilot.settings.rules
    assert rules.hard_margin == pytest.approx(law.guard.hard_margin_m + room)
    assert rules.soft_margin == pytest.approx(law.guard.soft_margin_m + room)
    assert driver.pilot.planner.path_params.clearance == pytest.approx(
        law.path_params().clearance + room
    )
    assert driver.pilot.planner.replan_params.accept == pytest.approx(
        law.replan_params().accept + room
    )
    assert driver.pilot.planner.replan_params.slack == pytest.approx(
        law.replan_params().slack + 0.04
    )
    assert len(driver.pilot.sent) == steps


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_robot_with_slow_odometry_drives_as_well():
    """Between two readings the newest was too old for the gate: nothing ever passed."""
    plan = SessionConfig(simulated("lab-guard", real_time=False))
    model = plan.robot.model
    slow = model.odometry.model_copy(update={"rate_hz": 5.0})
    scenario = plan.robot.scenario.model_copy(
        update={"robot": model.model_copy(update={"odometry": slow})}
    )
    robot = replace(plan.robot, scenario=scenario)
    with Session(replace(plan, robot=robot)) as session:
        end = session.gated.now() + 5.0
        session.run(lambda loop: loop.gated.now() > end, Mode.AUTOMATIC)
        assert session.gated.gate.reason == ""
        assert session.gated.truth().pose.x - plan.robot.start.x > 0.5


@pytest.mark.slow  # nothing moves by it
@pytest.mark.xdist_group("realtime")
def test_after_a_drive_the_process_priority_is_restored():
    """What drew a picture after a drive kept every other process off its processor."""

    def ranks() -> set[tuple[int, int]]:
        tasks = [int(task.name) for task in Path("/proc/self/task").iterdir()]
        policy = [os.sched_getscheduler(t) & ~os.SCHED_RESET_ON_FORK for t in tasks]
        return set(zip(policy, (os.getpriority(os.PRIO_PROCESS, t) for t in tasks), strict=True))

    ordinary = {(os.SCHED_OTHER, os.getpriority(os.PRIO_PROCESS, 0))}
    with Session(SessionConfig(simulated("lab-guard"))) as session:
        if session.scheduling.startswith("ordinary"):
            pytest.skip("this user may not raise a process's priority")
        session.run(lambda loop: loop.timing.punctuality().periods > 5)
        assert not ranks() <= ordinary
    assert ranks() <= ordinary


@pytest.mark.slow  # nothing moves by it
@pytest.mark.xdist_group("realtime")
def test_odometry_that_drifts_while_the_start_compiles_raises_no_alarm(monkeypatch):
    """A gyroscope drifts by degrees meanwhile: the next scan contradicted the last one, and the
    robot took itself for carried away."""
    read, drift = RemoteGatedRobot.read, 0.0

    def compiling(*_: object) -> None:
        nonlocal drift
        drift = 0.1

    def drifted(gated: RemoteGatedRobot) -> Readings:
        readings = read(gated)
        odometry = readings.odometry
        if odometry is None:
            return readings
        pose = odometry.pose._replace(psi=odometry.pose.psi + drift)
        return readings._replace(odometry=odometry._replace(pose=pose))

    monkeypatch.setattr(Driver, "warm_up_planner", compiling)
    monkeypatch.setattr(RemoteGatedRobot, "read", drifted)
    with Session(SessionConfig(simulated("lab-guard"), patience=1.0)) as session:
        end = session.gated.now() + 1.0
        session.run(lambda loop: loop.gated.now() > end)
        assert session.loop.has_map
        assert not session.loop.seen.lost
        assert session.loop.alarms.worst() == ()


class Clock:
    """A gate process as far as a rehearsal needs one, in real time."""

    def now(self) -> float:
        return time.monotonic()

    def wait(self, until: float) -> None:
        time.sleep(max(until - time.monotonic(), 0.0))


def _slow(takes: float, task: object) -> object:
    """A planner that must compile first."""
    time.sleep(takes)
    return task


def test_only_the_start_waits_for_a_plan(monkeypatch):
    """It waited three minutes, whenever compiling took longer than a plan may."""
    monkeypatch.setattr(planning, "MAX_PLAN_AGE", 0.3)
    with Session(SessionConfig(simulated("lab-guard", real_time=False))) as session:
        session.run(lambda loop: loop.timing.punctuality().periods > 5)
        driver, seen = session.loop.driver, session.loop.seen
        driver._planning = RemotePlanner(partial(_slow, 0.6))
        begun = time.monotonic()
        driver.warm_up_planner(seen, Clock())
        assert 0.6 < time.monotonic() - begun < 60.0
        assert not driver.planner_late


def _numb(robot):
    robot.read = lambda: Readings(None, None)
    return robot


def test_a_robot_that_stands_reports_why_and_so_does_one_that_never_drove(monkeypatch):
    monkeypatch.setattr("cohelm.drive.session._READY", 2.0)

    class Numb(Simulated):
        def maker(self):
            return wrapped(super().maker(), _numb)

    made = simulated("lab-guard", real_time=False)
    with Session(SessionConfig(Numb(made.scenario, made.kind, False, made.seed))) as session:
        begun = session.loop.gated.now()
        session.run(lambda loop: loop.gated.now() - begun > 2.5, Mode.AUTOMATIC)
        assert session.state() == "idle: there is no odometry"
        assert session.summary()["not_begun"] == "there is no odometry"
    with Session(SessionConfig(Numb(made.scenario, made.kind, False, made.seed))) as session:
        begun = session.loop.gated.now()
        session.run(lambda loop: loop.gated.now() - begun > 1.0, Mode.AUTOMATIC)  # with --for 1
        assert session.summary()["not_begun"] == "there is no odometry"
    with Session(SessionConfig(made)) as session:
        session.run(lambda loop: loop.decision is not None, Mode.AUTOMATIC)
        assert session.state() == "automatic"
        session.loop.supervisor.pause("way", "waiting for a goal or path on /goal_pose")
        assert session.state() == "automatic: waiting for a goal or path on /goal_pose"
        session.loop.supervisor.resume("way")
        session.loop.seen = session.loop.seen._replace(lost=True, reason="nothing fits")
        assert session.state() == "automatic: lost: nothing fits"
        session.loop.seen = session.loop.seen._replace(lost=False, twist=Twist(0.0, 0.0))
        said = session.loop.log._words
        session.loop.log.words(said._replace(mode=Mode.AUTOMATIC, why="held back: a zone"))
        assert session.state() == "automatic: held back: a zone"
        session.loop.seen = session.loop.seen._replace(twist=Twist(0.3, 0.0))
        assert session.state() == "automatic"  # it does drive
        session.loop.decision = session.loop.decision._replace(nominal=Twist(0.5, 0.0))
        session.loop.seen = session.loop.seen._replace(twist=Twist(0.08, 0.0))
        assert session.state() == "automatic"  # for a moment only
        session._slow_since -= 2.1
        assert session.state() == "automatic: held back: a zone"  # it crawls
        session.loop.log.words(said._replace(mode=Mode.AUTOMATIC, why=""))
        for clearance, why in (
            (0.034, "an obstacle 0.03 m off"),
            (-0.1, "by its LiDARs an obstacle touches it, or is nearer than they can measure"),
        ):
            session.loop.decision = session.loop.decision._replace(
                verdict=Verdict.SHAPED, clearance_seen=clearance
            )
            assert session.state() == f"automatic: {why}"
        session.loop.seen = session.loop.seen._replace(twist=Twist(0.3, 0.0))
        assert session.state() == "automatic"
        session.loop.supervisor.choose(Mode.MANUAL)
        assert session.state() == "manual"  # and not as the gate calls it
        assert not session.stopped
        session.loop.gated.stop("somebody")
        assert session.stopped
        session.end("over")
        assert not session.stopped  # that is no news
        assert session.state().startswith("stopped: somebody")
        assert session.summary()["not_begun"] is None
