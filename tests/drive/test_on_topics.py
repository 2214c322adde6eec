"""Goals, paths and initial poses on ROS 2 topics."""

from __future__ import annotations

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.drive.factory import simulated
from cohelm.drive.on_topics import OnTopics, TopicsConfig, on_topics
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode, RequestKind
from cohelm.plan.path_planner import Goal
from cohelm.ros.goals import Placed
from tests.drive.faults import CORRIDOR
from tests.drive.resuming import Drive, SessionJobs

AHEAD, IN_WALL, OUTSIDE = Goal(2.0, 0.5), Goal(3.0, 1.45), Goal(30.0, 0.0)


class Told:
    """`ros.goals.Goals` in a test's hands."""

    ways = ("/goal_pose",)

    def __init__(self) -> None:
        self.said: list[str] = []
        self.route = np.empty((0, 2))
        self.newest = self.place = None

    def way(self):
        made, self.newest = self.newest, None
        return None if made is None else ("/goal_pose", made)

    def initial(self):
        made, self.place = self.place, None
        return made

    def report(self, topic, what) -> None:
        self.note(f"{topic}: {what}")

    def note(self, text) -> None:
        self.said.append(text)

    def close(self) -> None:
        pass


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def drive(tmp_path, told):
    with Drive(tmp_path, topics=OnTopics(None, told)) as made:
        yield made


def anna_drives(drive: Drive):
    anna = drive.station("anna")
    yield from range(5)
    anna.ask(RequestKind.TAKE)
    yield from range(5)
    return anna


def test_a_goal_is_driven_in_the_mode_that_the_driver_chose(drive, told):
    def script():
        anna = yield from anna_drives(drive)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(50)
        first = drive.loop.driver
        told.newest = AHEAD
        yield from range(60)
        assert told.said == ["/goal_pose: accepted: the robot follows it"]
        assert drive.loop.driver is not first
        assert drive.loop.supervisor.mode == Mode.AUTOMATIC
        for _ in range(800):
            yield
            if drive.loop.driver.arrived:
                break
        pose = drive.loop.seen.pose
        assert (pose.x, pose.y) == pytest.approx(AHEAD, abs=0.2)

    drive.run(script())


def test_no_goal_moves_a_robot_that_is_in_hold(drive, told):
    def script():
        anna = yield from anna_drives(drive)
        told.newest = AHEAD
        yield from range(100)
        assert told.said == ["/goal_pose: accepted: the robot follows it"]
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(50)
        moved = drive.moved
        assert moved > 10
        anna.ask(RequestKind.STOP)
        yield from range(100)
        stood = drive.moved
        told.newest = np.array([(5.0, 0.0)])
        yield from range(100)
        assert len(told.said) == 2
        assert drive.moved == stood
        assert drive.loop.supervisor.mode == Mode.HOLD

    drive.run(script())  # which holds the rule of `resuming` besides


def test_a_goal_ends_with_the_lease_in_which_it_came(drive, told):
    def script():
        drive.beside.checking.takes = 30
        anna = yield from anna_drives(drive)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(50)
        first = drive.loop.driver
        told.newest = AHEAD
        yield from range(10)
        anna.ask(RequestKind.GIVE)
        yield from range(100)
        assert told.said == ["/goal_pose: the driver has changed since it came"]
        assert drive.loop.driver is first

    drive.run(script())


@pytest.mark.parametrize(
    ("where", "why"),
    [(IN_WALL, "is in a wall, or too near to one"), (OUTSIDE, "is not on the map")],
)
def test_a_goal_that_can_not_be_reached_changes_nothing(drive, told, where, why):
    def script():
        anna = yield from anna_drives(drive)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(50)
        first = drive.loop.driver
        told.newest = where
        yield from range(20)
        (said,) = told.said
        assert why in said
        assert drive.loop.driver is first
        assert not drive.loop.supervisor.paused

    drive.run(script())


def test_an_initial_pose_is_accepted_only_at_rest_and_on_the_map(drive, told):
    def script():
        anna = yield from anna_drives(drive)
        here = drive.loop.seen.pose
        for place, why in (
            (Pose(3.0, 1.51, 0.0), "3.0, 1.5 is in a wall of the map"),
            (Pose(50.0, 0.0, 0.0), "50.0, 0.0 is not on the map"),
            (Pose(here.x + 0.2, here.y, here.psi), "accepted: localizing from there"),
        ):
            told.place = Placed("/initialpose", place, 0.3)
            yield from range(2)
            assert told.said[-1] == f"/initialpose: {why}"
        yield from range(30)
        assert drive.loop.seen.pose.x == pytest.approx(here.x, abs=0.05)  # as the LiDAR sees it
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(50)
        told.place = Placed("/initialpose", here, 0.3)
        yield from range(2)
        assert "the robot is moving, and takes an initial pose only at rest" in told.said[-1]

    drive.run(script())


def test_of_a_flood_of_initial_poses_the_last_counts_and_it_is_said_once_a_second(
    drive, told, monkeypatch
):
    events = []
    monkeypatch.setattr(drive.loop.log, "event", lambda text, *_: events.append(text))

    def script():
        yield from range(5)
        here = drive.loop.seen.pose
        for k in range(150):  # every period, for three seconds
            told.place = Placed("/initialpose", Pose(here.x + 0.4 * (k % 2), here.y, here.psi), 0.3)
            yield
        assert not drive.loop.seen.lost
        yield from range(30)
        assert drive.loop.seen.pose.x == pytest.approx(here.x, abs=0.05)

    drive.run(script())
    accepted = "/initialpose: accepted: localizing from there"
    for said in (told.said, [text for text in events if text.startswith("/initialpose")]):
        assert said[0] == accepted
        assert len(said) <= 4
        assert sum(int(text.rpartition("(")[2].split()[0]) for text in said[1:]) > 90


def test_without_a_station_it_stands_until_the_first_goal(told):
    made = simulated(CORRIDOR, real_time=False, seed=2)
    topics = OnTopics(None, told)
    with Session(SessionConfig(made, localise=True)) as session:
        topics.begin(session, SessionJobs)
        begun = session.loop.gated.now()
        stood: list[bool] = []

        def until(loop) -> bool:
            topics._jobs.turn()
            topics.turn(loop)
            now = loop.gated.now() - begun
            if 1.0 <= now < 1.02:
                told.newest = IN_WALL
            if 2.0 <= now < 2.02:
                stood.append(loop.seen.odometry == pytest.approx((0.0, 0.0, 0.0), abs=0.02))
                told.newest = AHEAD
            return now > 25.0 or (loop.driver.arrived and now > 3.0)

        session.run(until, Mode.AUTOMATIC)
        pose = session.loop.seen.pose
        session.end("over")
    topics.close()
    assert stood == [True]
    assert [one.rpartition(" ")[2] for one in told.said] == ["one", "it"]
    assert (pose.x, pose.y) == pytest.approx(AHEAD, abs=0.2)


def test_options_of_ros2_robots_are_refused_for_others():
    made = simulated(CORRIDOR, real_time=False)
    with on_topics(made, TopicsConfig(), print) as topics:
        assert topics.path_requests() == ()
    for config in (
        TopicsConfig("earth"),
        TopicsConfig(ways=("/plan",)),
        TopicsConfig(initial="/i"),
    ):
        with (
            pytest.raises(CohelmError, match="are of a ROS 2 robot: add --ros2"),
            on_topics(made, config, print),
        ):
            pass


class Shown:
    """`ros.localized.Localized` in a test's hands."""

    def __init__(self) -> None:
        self.maps, self.takes = [], 0

    def draw(self, known) -> None:
        self.maps.append(known)

    def take(self, *_) -> None:
        self.takes += 1


def test_the_map_is_shown_once(tmp_path):
    shown = Shown()
    with Drive(tmp_path, topics=OnTopics(shown, None)) as drive:
        drive.run(range(20))
        known = drive.loop.perception.known
    assert shown.takes > 5
    (drawn,) = shown.maps
    assert (drawn.rows, drawn.columns) == known.gap.shape
