"""An outline that changes while driving is used once the robot can stop with it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pytest

from cohelm.core.types import Pose, Stick, Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.playback import Playback
from cohelm.drive.rerouting import checker_of
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.bulk_messages import Hello
from cohelm.link.messages import Mode, RequestKind
from cohelm.link.operator import Scripted
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.base import Robot
from cohelm.robot.clearance import segment_clearance
from cohelm.robot.footprint import hull
from cohelm.robot.port import Readings
from cohelm.scenario.load import load_robot
from tests.drive.faults import along_corridor
from tests.drive.resuming import Drive
from tests.drive.wrapped import wrapped

ARM = 0.3
"""So much longer is the robot with its arm out [m]."""
RESHAPED, ALONE = "the outline has changed", "the earlier outline no longer applies"


class Arm:
    """A robot that says which outline it has."""

    def __init__(self, robot) -> None:
        self.robot, self.outline = robot, None

    def __getattr__(self, name):
        return getattr(self.robot, name)

    def read(self):
        outline = self.outline
        return self.robot.read()._replace(outline=None if outline is None else outline.copy())


@dataclass(frozen=True)
class WithArm(Simulated):
    def maker(self):
        return wrapped(super().maker(), Arm)


def corridor(end: float, start: float = 7.0) -> WithArm:
    made = along_corridor(end, start)
    return WithArm(made.scenario, made.kind, False, made.seed)


def longer(outline, ahead: float = ARM, beside: float = 0.0):
    tips = [[outline[:, 0].max() + ahead, y * (0.1 + beside)] for y in (-1.0, 1.0)]
    wide = [[0.0, y * (np.abs(outline[:, 1]).max() + beside)] for y in (-1.0, 1.0)]
    return hull(np.vstack((outline, tips, wide)))


class Ride:
    """Ahead in manual mode, or along the route; `at` changes the outline."""

    def __init__(self, end=10.3, at=lambda ride: None, mode=Mode.AUTOMATIC, seconds=40.0) -> None:
        made = corridor(end)
        self.events, self.reasons, self.least = [], [], np.inf
        walls = made.scenario.walls()
        stick = Scripted(lambda t: Stick(1.0 if t > 0.5 else 0.0, 0.0), lambda: self.t)
        self.t = 0.0
        with Session(SessionConfig(made), stick if mode == Mode.MANUAL else None) as session:
            loop = self.loop = session.loop
            self.arm, begun = loop.gated._robot, loop.gated.now()
            self.file = made.model.outline
            event, words = loop.log.event, loop.log.words
            loop.log.event = lambda text, *more: self.events.append(text) or event(text, *more)
            loop.log.words = lambda said: self.reasons.append(said.why) or words(said)

            def until(loop) -> bool:
                self.t = loop.gated.now() - begun
                at(self)
                pose = loop.gated.truth().pose
                now = self.file if self.arm.outline is None else self.arm.outline
                self.gap = min(segment_clearance(pose, now, *wall) for wall in walls)
                self.least = min(self.least, self.gap)
                self.pose, self.speed = pose, loop.seen.twist.v
                return loop.driver.arrived or self.t > seconds

            session.run(until, mode)
            self.arrived = loop.driver.arrived
            session.end("over")

    def told(self, words: str) -> int:
        """How often."""
        return sum(words in one for one in self.events)


def at_speed(change):
    def at(ride) -> None:
        if ride.arm.outline is None and ride.loop.seen.twist.v > 0.3:
            ride.arm.outline = change(ride.file)

    return at


@functools.cache
def unchanged() -> Ride:
    """To the wall with the outline of its file."""
    return Ride(10.5, seconds=15.0)


def test_with_an_extended_arm_the_route_ends_earlier_by_the_arm():
    """To a wall that it reaches with its arm and not with its file's outline."""
    short, long = unchanged(), Ride(10.5, at_speed(longer), seconds=15.0)
    assert short.told(RESHAPED) == 0
    assert (long.told(RESHAPED), long.told(ALONE)) == (1, 1)
    assert short.pose.x - long.pose.x > 0.7 * ARM
    assert long.least > 0.015
    assert not any("outline changes" in why for why in long.reasons)


def test_an_outline_in_which_it_can_not_stop_makes_it_brake_with_the_reason():
    """Grown 5 cm before a wall, at speed: the larger outline would be in the wall."""

    def at(ride) -> None:
        if ride.arm.outline is None and 11.0 - ride.loop.seen.pose.x < 0.36 + ARM + 0.15:
            ride.arm.outline = longer(ride.file)

    ride = Ride(10.5, at, Mode.MANUAL, seconds=11.0)
    assert ride.told(RESHAPED) == 1
    assert any(
        "outline change: both outlines apply until the new one fits" in w for w in ride.reasons
    )
    assert ride.told(ALONE) == 1  # as it stands
    assert abs(ride.speed) < 0.05


def test_a_shrinking_outline_is_adopted_as_late_as_a_growing_one():
    """The larger one counts until a motion is certified: then it goes as near as the small one."""

    def at(ride) -> None:
        if ride.arm.outline is None and ride.t > 0.2:
            ride.arm.outline = longer(ride.file)
        elif ride.t > 3.0 and len(ride.arm.outline) != len(ride.file):
            ride.arm.outline = ride.file

    ride, short = Ride(10.5, at, seconds=15.0), unchanged()
    assert (ride.told(RESHAPED), ride.told(ALONE)) == (2, 2)
    assert ride.pose.x == pytest.approx(short.pose.x, abs=0.05)


@pytest.fixture
def drive(tmp_path):
    with Drive(tmp_path) as made:
        yield made


def following(drive):
    """Anna has the lease, and has the robot follow its course."""
    anna = drive.station("anna")
    yield from range(5)
    anna.ask(RequestKind.TAKE)
    yield from range(5)
    anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
    return anna


def test_stations_and_plans_and_new_paths_use_the_present_outline(drive):
    shown = []
    drive.link.reshape = lambda outline: shown.append(outline)

    def script():
        anna = yield from following(drive)
        yield from range(40)
        wide = longer(drive.gated.model.outline, 0.0, 0.3)
        drive.wheels.outline = wide
        yield from range(40)
        assert len(shown) == 1
        assert np.array_equal(shown[0], wide)
        loop, first = drive.loop, drive.loop.driver
        task = first.pilot.task(loop.seen.pose, Twist(0, 0), loop.seen.obstacles)
        assert np.array_equal(task.outline, wide)
        assert np.array_equal(drive.beside.checking._judge.outline, wide)
        anna.propose([(4.0, 0.0), (7.0, 0.2)])
        yield from range(80)
        assert loop.driver is not first
        assert loop.supervisor.driver is loop.driver
        assert loop._reporter.driver is loop.driver
        assert np.array_equal(loop.driver.settings.outline, wide)
        assert np.array_equal(loop.driver.pilot.settings.outline, wide)

    drive.run(script())


def test_a_path_is_checked_against_the_present_outline():
    made = along_corridor(6.0)
    plan, narrow = SessionConfig(made), np.array([[2.0, 0.9], [4.0, 0.9]])
    known = map_from_geometry(made.scenario.walls(), made.start)
    here = Pose(0.0, 0.0, 0.0)
    assert checker_of(plan, known)(narrow, here).reference is not None
    wide = longer(made.model.outline, 0.0, 0.3)
    said = checker_of(plan, known, wide)(narrow, here)
    assert said.reference is None
    assert "on the path to 2: an obstacle" in said.why


class Own(Robot):
    """Says an outline that is none, or one the other way round."""

    outline = None

    def read(self):
        return Readings(outline=self.outline)

    def send(self, twist):
        pass

    def stop(self):
        pass


def test_the_outline_from_a_custom_robot_is_validated_on_receipt():
    adapter = RobotAdapter(own := Own(load_robot("sally")))
    own.outline = own.model.outline[::-1]
    assert np.array_equal(np.sort(adapter.read().outline, axis=0), np.sort(own.outline, axis=0))
    assert adapter.read().health.faults == ()
    before = adapter.read().outline
    own.outline = np.array([[0.1, np.nan], [0.2, 0.1], [0.0, 0.1]])
    read = adapter.read()
    assert read.outline is before
    assert "must be finite numbers" in read.health.faults[0]
    adapter.close()


def test_the_path_of_a_new_driver_is_the_reported_one(drive):
    """Progress was told of the way before."""

    def script():
        anna = yield from following(drive)
        yield from range(130)
        before = drive.loop._reporter._progress()
        assert before > 0.1
        anna.propose([(4.0, 0.0), (7.0, 0.2)])
        yield from range(80)
        assert drive.loop._reporter._progress() < before

    drive.run(script())


@dataclass(frozen=True)
class Docks(WithArm):
    """Before a bay that leaves it 11 cm on either side, of which it keeps 7.5."""


def test_a_dock_that_no_longer_fits_is_reported_and_refused_in_advance():
    made = simulated("dock", real_time=False)
    made = Docks(made.scenario, made.kind, False, made.seed)
    said, refused = {}, {}
    with Session(SessionConfig(made)) as session:
        loop, arm = session.loop, session.loop.gated._robot
        begun, file = loop.gated.now(), made.model.outline

        def until(loop) -> bool:
            t = round(loop.gated.now() - begun, 2)
            arm.outline = longer(file, 0.0, 0.09) if 1.0 < t < 3.0 else file
            said[t] = {a.text: a.active for a in loop.alarms.worst()}
            if t in (0.5, 2.0, 4.0):
                refused[t] = loop.supervisor.dock(1)
            if t == 0.52:  # it docks, and may not go on with another outline
                assert loop.supervisor.docking.on
            return t >= 4.5

        session.run(until, Mode.HOLD)
    why = "with its present outline, on its approach, at 4.10, 0.00, the robot has 2 cm to"
    assert refused[0.5] == "" == refused[4.0]
    assert refused[2.0].startswith(f"charger: {why}")
    assert said[2.0][f"no docking at charger: {why} a wall, less than margin_m, 0.075"]
    assert any(
        text.startswith("docking at charger: with its present outline") for text in said[2.0]
    )
    assert said[4.4] == dict.fromkeys(said[2.0], False)


def test_a_route_that_no_longer_fits_is_reported_in_advance():
    told = {}

    def at(ride) -> None:
        at_speed(longer)(ride)
        if ride.arm.outline is not None and ride.loop.seen.pose.x > 8.0:
            ride.arm.outline = ride.file
        for alarm in ride.loop.alarms.worst():
            told.setdefault(alarm.text, []).append((ride.loop.seen.pose.x, alarm.active))

    Ride(10.5, at, seconds=30.0)
    (text,) = told
    assert text.startswith("with its present outline the route has no clearance at 10.")
    assert told[text][0][0] < 7.5
    assert told[text][-1][1] is False  # it has another one now
    assert not any("route" in a.text for a in Ride(10.5, seconds=1.0).loop.alarms.worst())


def test_a_replay_draws_the_outline_that_the_robot_had_at_each_time(tmp_path):
    path = tmp_path / "arm.mcap"
    made = corridor(10.5)
    with Session(SessionConfig(made, record=path)) as session:
        arm, file = session.loop.gated._robot, made.model.outline
        arm_out = longer(file)

        def until(loop) -> bool:
            arm.outline = arm_out if loop.gated.now() > 1.0 else None
            return loop.gated.now() > 2.0

        session.run(until, Mode.AUTOMATIC)
        session.end("over")
    played = Playback(path)

    def drawn(t: float):
        told = [one.message for one in played.at(t - played.start)]
        (hello,) = (one for one in told if isinstance(one, Hello))
        return hello.outline

    assert drawn(0.5) == pytest.approx(file)
    assert drawn(1.9) == pytest.approx(arm_out)
    assert drawn(0.6) == pytest.approx(file)  # and back
    assert played.at(1.5)[1].message is played.at(1.6)[1].message  # told once
