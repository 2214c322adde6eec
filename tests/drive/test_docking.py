"""Docking and undocking; whatever ends it, the robot holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Stick, Twist
from cohelm.drive.factory import simulated
from cohelm.drive.playback import Playback
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.until_ended import goal_of
from cohelm.link.bulk_messages import Docks
from cohelm.link.messages import DockPhase, Mode, RequestKind
from cohelm.loop.docking import Docking
from cohelm.plan.docks import Dock
from cohelm.record.write import Recorder
from cohelm.robot.collision_monitor.fields import CRAWL
from cohelm.robot.gate.modes import GateMode
from cohelm.scenario import build, load
from cohelm.sim.run import pieces
from cohelm.study.single import scene
from tests.drive.resuming import Drive
from tests.drive.simulated_link import CENTRED, checked

SHORT = (
    "docks=[{name: short, x_m: 0.45, y_m: 0, heading_rad: 0, approach_m: 0.45, margin_m: 0.075, "
    "speed_mps: 0.3, within_s: 10}, {name: far, x_m: 9, y_m: 0, heading_rad: 0, margin_m: 0.08}]"
)


def waits(periods: int):
    yield from range(periods)


def until(drive: Drive, done, most: int = 400):
    for _ in range(most):
        if done():
            return
        yield
    raise AssertionError("it takes too long")


def events(drive: Drive) -> list[str]:
    """What the loop tells from now on."""
    told: list[str] = []
    event = drive.loop.log.event
    drive.loop.log.event = lambda text, serious=False: (told.append(text), event(text, serious))
    return told


@pytest.fixture
def drive(tmp_path):
    with Drive(tmp_path, changes=[SHORT]) as made:
        yield made


def test_a_driver_docks_and_undocks_without_a_mode_change_in_between(drive):
    loop, docking, told = drive.loop, drive.loop.supervisor.docking, events(drive)
    fastest, clear = [0.0], [math.inf]

    def here() -> tuple[DockPhase, int]:
        return docking.phase(loop.seen)

    def goes(on: bool) -> bool:
        fastest[0] = max(fastest[0], abs(drive.gated.truth().twist.v))
        clear[0] = min(clear[0], loop.seen.pose.x)
        return docking.on is on

    def script():
        anna, bert = drive.station("anna"), drive.station("bert")
        yield from waits(10)
        anna.ask(RequestKind.TAKE)
        wrong = bert.ask(RequestKind.DOCK, 1)
        yield from waits(10)
        assert bert.answers[wrong] == (False, "you are not the driver")
        assert here() == (DockPhase.STAGED, 1)
        asked = [
            anna.ask(RequestKind.UNDOCK),
            anna.ask(RequestKind.DOCK, 2),
            anna.ask(RequestKind.DOCK, 3),
        ]
        yield from waits(5)
        anna.stick = Stick(0.5, 0.0)
        yield from waits(10)
        asked.append(anna.ask(RequestKind.DOCK))
        yield from waits(5)
        anna.stick = CENTRED
        yield from waits(20)
        assert [anna.answers[number][1] for number in asked] == [
            "it is at the start of short's approach",
            "far: its approach is 8.0 m away",
            "there is no dock 3, only 2",
            "release the stick first",
        ]  # fmt: skip
        assert drive.moved == 0
        anna.ask(RequestKind.DOCK)
        yield from until(drive, lambda: goes(True))
        assert loop.supervisor.mode == Mode.AUTOMATIC
        assert drive.gated.gate.mode == GateMode.AUTOMATIC
        assert here() == (DockPhase.DOCKING, 1)
        anna.propose([(4.0, 0.3), (6.0, 0.0)])
        yield from waits(10)
        (said,) = checked(anna)
        assert said.answer.reason == "it is docking at short: hold it first"
        yield from until(drive, lambda: goes(False))
        assert here() == (DockPhase.DOCKED, 1)
        assert loop.supervisor.mode == Mode.HOLD
        yield from waits(60)
        at = drive.gated.truth().pose
        assert at == pytest.approx((0.45, 0.0, 0.0), abs=0.03)
        again = anna.ask(RequestKind.DOCK)
        yield from waits(50)
        assert anna.answers[again] == (False, "it is docked at short already")
        assert drive.gated.truth().pose == at
        anna.ask(RequestKind.UNDOCK)
        yield from until(drive, lambda: goes(True))
        assert here() == (DockPhase.UNDOCKING, 1)
        yield from until(drive, lambda: goes(False))
        yield from waits(40)
        assert here() == (DockPhase.STAGED, 1)
        assert drive.gated.truth().pose == pytest.approx((0.0, 0.0, 0.0), abs=0.07)
        assert loop.supervisor.mode == Mode.HOLD
        assert fastest[0] == pytest.approx(0.3, abs=0.02)

    drive.run(script())
    assert "docking at short" in told
    assert any(text.startswith("docking at short ended: docked at short, ") for text in told)
    assert "undocking from short ended: short is left" in told
    assert not [alarm.text for alarm in loop.alarms.worst()]


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ("hold", "mode HOLD"),
        ("automatic", "mode AUTOMATIC"),
        ("stop", "stop by bert (2)"),
        ("release", "mode HOLD"),
        ("bump", "the robot reports: the bumper is pressed"),
        ("stick", "the stick was deflected"),
    ],
)
def test_docking_that_was_ended_does_not_resume(drive, ends, said):
    loop, told = drive.loop, events(drive)

    def script():
        anna, bert = drive.station("anna"), drive.station("bert")
        yield from waits(10)
        anna.ask(RequestKind.TAKE)
        yield from waits(10)
        anna.ask(RequestKind.DOCK)
        yield from waits(40)
        assert loop.supervisor.docking.on
        match ends:
            case "hold" | "automatic":
                anna.ask(RequestKind.MODE, Mode[ends.upper()])
            case "stop":
                bert.ask(RequestKind.STOP)
            case "release":
                anna.ask(RequestKind.GIVE, bert.number)
            case "bump":
                drive.wheels.bumped = True
            case "stick":
                anna.stick = Stick(0.0, 0.3)
        yield from waits(10)
        assert not loop.supervisor.docking.on
        assert loop.supervisor.mode == (Mode.AUTOMATIC if ends == "automatic" else Mode.HOLD)
        anna.stick, drive.wheels.bumped = CENTRED, False
        yield from waits(60)
        assert (drive.gated.truth().twist.v == 0.0) is (ends != "automatic")

    drive.run(script())
    assert f"docking at short ended: {said}" in told
    alarms = [alarm.text for alarm in loop.alarms.worst()]
    assert ("docking at short: the stick was deflected" in alarms) is (ends == "stick")


# ---- what ends it by itself, without a robot --------------------------------------------------

DOCK = Dock("charger", Pose(2.0, 0.0, 0.0), 1.0, 0.08, 0.15, 40.0)


@pytest.fixture(scope="module")
def settings():
    made = simulated("minimal", real_time=False)
    scenario, model = made.scenario, made.model
    return scenario.law.settings(model.outline, model.bounds(), 0.5, 0.02)


class Seen:
    """As much of it as docking looks at."""

    def __init__(self, x: float, y: float = 0.0, psi: float = 0.0, lost: bool = False) -> None:
        self.pose, self.lost = Pose(x, y, psi), lost
        self.movers = np.empty((0, 6))

    def with_somebody(self, x: float, y: float) -> Seen:
        self.movers = np.array([(x, y, 0.0, 0.5, 0.2, 0.2)])
        return self


def over(docking: Docking, now: float, seen: Seen, v: float = 0.15, stick: Stick = CENTRED) -> str:
    ended = docking.ended(now, seen, Twist(v, 0.0), stick, False)  # pyright: ignore
    return "" if ended is None else ended.why


@pytest.fixture
def docking(settings):
    made = Docking([DOCK], settings, 0.05)
    made.begin(10.0, 1, Seen(1.0), False)  # pyright: ignore
    return made


def test_docking_continues_while_nothing_is_wrong(docking):
    assert over(docking, 20.0, Seen(1.5, 0.1, 0.1)) == ""
    assert docking.cap == (0.15, "docking at charger")


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        (Seen(1.5, lost=True), "lost on the map"),
        (Seen(1.5, 0.35), "off its approach by 0.35 m, 0°"),
        (Seen(1.5, 0.0, 0.8), "off its approach by 0.00 m, 46°"),
        (Seen(math.nan), "off its approach by nan m, 0°"),
        (Seen(2.0, 0.01, -0.02), "docked at charger, +0.0, +1.0 cm, -1.1° off"),
    ],
)
def test_docking_ends_by_itself(docking, seen, said):
    assert over(docking, 20.0, seen) == said


def test_docking_ends_on_timeout_or_without_progress(docking):
    assert over(docking, 49.9, Seen(1.5)) == ""
    assert over(docking, 50.1, Seen(1.5)) == "not done within 40 s"
    assert over(docking, 51.0, Seen(1.5), v=0.0) == "not done within 40 s"
    docking.begin(60.0, 1, Seen(1.5), False)
    assert over(docking, 61.9, Seen(1.5), v=0.0) == ""
    assert over(docking, 62.1, Seen(1.5), v=0.0) == "blocked, at -50, +0 cm from it"
    docking.begin(70.0, 1, Seen(1.98), False)
    assert over(docking, 71.0, Seen(1.98), v=0.0) == ""
    assert over(docking, 72.1, Seen(1.98), v=0.0).startswith("docked at charger, -2.0")


def test_docking_ends_for_a_mover_in_the_corridor_but_not_for_one_noisy_scan(docking):
    somebody = Seen(1.2).with_somebody(2.0, 0.3)
    assert over(docking, 20.0, Seen(1.2)) == ""
    assert over(docking, 20.1, somebody) == ""
    assert over(docking, 20.14, Seen(1.2)) == ""
    assert over(docking, 20.2, somebody) == ""
    assert over(docking, 20.4, somebody) == "its corridor is occupied"
    docking.begin(30.0, 1, Seen(1.2), True)  # backwards he is in nobody's way
    assert over(docking, 30.4, somebody) == ""
    assert over(docking, 30.5, Seen(1.2).with_somebody(0.7, 0.0)) == ""
    assert over(docking, 30.6, Seen(1.2).with_somebody(0.7, 0.0)) == "its corridor is occupied"


@pytest.mark.parametrize("stick", [Stick(0.2, 0.0), Stick(0.0, -0.2), Stick(math.nan, 0.0)])
def test_docking_ends_when_the_stick_is_deflected(docking, stick):
    assert over(docking, 20.0, Seen(1.5), stick=stick) == "the stick was deflected"


@pytest.mark.parametrize(
    ("robot", "speed", "reason"),
    [
        ("sally", CRAWL, "undocking from charger, unseen"),
        ("sally-rear", 0.15, "undocking from charger"),
        ("turtlebot4", 0.15, "undocking from charger"),
    ],
)
def test_a_robot_without_rear_sensor_undocks_at_a_crawl(robot, speed, reason):
    made = simulated("minimal", real_time=False, changes=[f"robot={robot}"])
    model = made.model
    own = made.scenario.law.settings(model.outline, model.bounds(), 0.5, 0.02)
    out = Docking([DOCK], own, 0.05, [lidar.lidar() for lidar in model.lidars])
    out.begin(0.0, 1, Seen(2.0), True)  # pyright: ignore
    assert out.cap == (speed, reason)
    within = 40.0 * 0.15 / speed
    assert over(out, within - 0.1, Seen(1.5)) == ""
    assert over(out, within + 0.1, Seen(1.5)) == f"not done within {within:g} s"
    out.begin(0.0, 1, Seen(1.0), False)  # pyright: ignore
    assert out.cap == (0.15, "docking at charger")


def test_without_docks_docking_is_refused(settings):
    none = Docking([], settings, 0.05)
    assert none.refusal(0, Seen(1.0), CENTRED, False) == "this site has no dock"  # pyright: ignore
    assert none.phase(Seen(1.0)) == (DockPhase.AWAY, 0)  # pyright: ignore


def test_a_lost_or_misaligned_robot_does_not_dock(docking):
    docking.finish(docking.last)
    refusal = docking.refusal
    said = refusal(1, Seen(1.0, lost=True), CENTRED, False)
    assert said == "the robot is not localized on the map"
    said = refusal(1, Seen(1.0, 0.25), CENTRED, False)
    assert said == "charger: drive onto its approach line first"
    said = refusal(0, Seen(1.0, 0.25), CENTRED, False)
    assert said == "the robot is not at a dock's approach: drive it there first"
    assert refusal(0, Seen(-9.0), CENTRED, True) == "the robot is not at a dock"
    assert refusal(0, Seen(1.0), CENTRED, False) == ""
    longest = Dock("a" * 24, *DOCK[1:])  # a status has no more room than for that
    docking.docks = (longest,)
    for seen in (Seen(1.0, 0.25), Seen(-9.0), Seen(2.0), Seen(1.0)):
        for number in (0, 1):
            for backwards in (False, True):
                assert len(refusal(number, seen, CENTRED, backwards).encode()) <= 64


def test_an_unknown_dock_is_refused_with_the_known_names():
    plan = SessionConfig(simulated("dock", real_time=False))
    assert goal_of(plan, Mode.AUTOMATIC, False, "charger") == 1
    assert goal_of(plan, Mode.AUTOMATIC, False, "") == 0
    with pytest.raises(CohelmError, match="--dock: no dock is called 'x'; there are: charger"):
        goal_of(plan, Mode.AUTOMATIC, False, "x")
    none = SessionConfig(simulated("minimal", real_time=False))
    with pytest.raises(CohelmError, match="no dock is called 'x', and this scenario has none"):
        goal_of(none, Mode.AUTOMATIC, False, "x")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["kinematic", "twin"])
@pytest.mark.parametrize("seed", [1, 2])
def test_sally_enters_a_narrow_bay_only_for_docking(kind, seed):
    made = simulated("dock", kind, real_time=False, seed=seed)
    with Session(SessionConfig(made)) as session:
        loop = session.loop
        session.run(lambda _: bool(loop.supervisor.docking.last.why), dock=1)
        assert session.summary()["docked"] is True
        truth = loop.gated.truth()
        assert truth.least_moving > 0.0355  # half of the hard margin is the promise
        assert loop.supervisor.docking.docks[0].off(truth.pose) == pytest.approx(
            (0.0, 0.0, 0.0), abs=0.04
        )
        loop.supervisor.docking.last = loop.supervisor.docking.last._replace(why="")
        assert loop.supervisor.dock(backwards=True) == ""
        session.run(lambda _: bool(loop.supervisor.docking.last.why))
        assert loop.supervisor.docking.last == ("charger is left", True)
        assert loop.gated.truth().least_moving > 0.0355


def test_a_replay_shows_the_docks(tmp_path):
    setup = build.setup(load.scenario("dock", ["simulation.duration_s=0.1"]))
    with Recorder(tmp_path / "run.mcap", scene(setup)) as recorder:
        for piece in pieces(setup):
            recorder.write(piece)
    played = Playback(tmp_path / "run.mcap")
    (docks,) = (one for one in played.first() if isinstance(one, Docks))
    assert [(dock.name, dock.pose, dock.approach) for dock in docks.all] == [
        ("charger", (4.5, 0.0, 0.0), 1.3)
    ]
