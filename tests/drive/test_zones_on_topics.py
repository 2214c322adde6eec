"""Zones from ROS 2 topics that change while driving."""

from __future__ import annotations

import numpy as np
import pytest

from cohelm.core.frames import placed
from cohelm.core.types import Pose, Twist
from cohelm.drive import path_check_process
from cohelm.drive.factory import simulated
from cohelm.drive.jobs import InlineJobs
from cohelm.drive.on_topics import OnTopics
from cohelm.drive.path_check_process import RemoteChecking
from cohelm.drive.rerouting import checker_of
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.zones_on_topics import ZonesOnTopics
from cohelm.link.bulk_messages import Zone, ZoneMap
from cohelm.link.messages import Mode, RequestKind, Severity
from cohelm.plan.path_planner import Goal
from cohelm.plan.zones import CELL, Zoned, covering
from cohelm.ros.masks import KEEP_OUT, PERCENT, FilterMask
from cohelm.ros.port import Received
from cohelm.scenario.zones import masked
from tests.drive.faults import CORRIDOR, along_corridor
from tests.drive.resuming import Drive
from tests.few import first
from tests.patience import looks
from tests.ros.costmap_filters import grid, info

SIDE, LOW = 0.1, (-3.0, -4.0)
FAR = (9.0, 1.0, 10.0, 2.0)
"""A zone that is in nobody's way."""
ACROSS = (1.5, -1.5, 2.3, 0.1)
"""Of the corridor, all but 1.4 m on the left."""
SHUT = (2.2, -1.5, 3.0, 1.5)


def cells(*boxes, value=100):
    """Of a mask of the corridor, with boxes (x1, y1, x2, y2) marked."""
    made = np.zeros((80, 160), np.int8)
    for box in boxes:
        x1, y1, x2, y2 = (round(v / SIDE) for v in np.subtract(box, (*LOW, *LOW)))
        made[y1:y2, x1:x2] = value
    return made


def keep_out(*boxes):
    return FilterMask("/info", "/mask", KEEP_OUT, 0.0, 1.0, cells(*boxes), SIDE, Pose(*LOW, 0.0))


class Topics:
    """A transport that carries what a test says."""

    def __init__(self) -> None:
        self._ends = []

    def subscribe(self, topic, kind, qos, hear):
        self._ends.append((topic, hear))
        return lambda: None

    def endpoints(self):
        return []

    def say(self, topic, message) -> None:
        for one, hear in list(self._ends):
            if one == topic:
                hear(Received(message, 0.0))

    def mask(self, *boxes, **keys) -> None:
        self.say("/mask", grid(cells(*boxes), SIDE, (*LOW, 0.0), **keys))


class Ride:
    """Along the corridor with one keep-out mask on topics; `at` says what comes when."""

    def __init__(self, *boxes, at=lambda ride, loop: None, seconds=40.0, end=4.0) -> None:
        self.topics, self.said, self.poses, self.modes = Topics(), [], [], []
        made = along_corridor(end)
        used = keep_out(*boxes)
        zones = ZonesOnTopics(self.topics, (used,), "map", "/", InlineJobs(), self.said.append)
        topics, self.body = OnTopics(None, None, zones=zones), covering(made.model.outline, CELL)
        with Session(SessionConfig(made, zones=masked([used]))) as session:
            topics.attend(session)
            self.topics.say("/info", info("mask"))
            self.topics.mask(*boxes)
            assert not self.said
            self.session, begun = session, session.loop.gated.now()

            def until(loop) -> bool:
                self.t = loop.gated.now() - begun
                self.poses.append(loop.gated.truth().pose)
                at(self, loop)
                topics.turn(loop)
                return loop.driver.arrived or self.t > seconds

            session.run(until, Mode.AUTOMATIC)
            self.arrived, self.loop = session.loop.driver.arrived, session.loop
            session.end("over")
        topics.close()

    def depths(self, *boxes):
        """Of the true outline in such zones, once a period [m]."""
        depth = masked([keep_out(*boxes)]).keep_out.depth
        return np.array([depth.at(placed(self.body, pose)).max() for pose in self.poses])


def once(when, do):
    """Called in each period, does it in the first one in which `when` is true."""
    done = []

    def at(ride, loop) -> None:
        if not done and when(ride, loop):
            done.append(True)
            ride.at = len(ride.poses)
            do(ride)

    return at


def test_a_zone_that_appears_while_driving_is_avoided_without_a_stop():
    def when(_, loop):
        return loop.seen.twist.v > 0.3

    ride = Ride(FAR, at=once(when, lambda ride: ride.topics.mask(ACROSS)))
    assert ride.said == ["/mask has changed: its zones are being loaded"]
    assert ride.arrived
    assert ride.depths(ACROSS).max() == 0.0
    assert not ride.loop.supervisor.paused


def test_a_zone_too_near_to_stop_for_is_adopted_after_braking():
    here, paused = (0.9, -1.5, 2.3, 0.1), []

    def at(ride, loop):
        drop(ride, loop)
        paused.append((loop.supervisor.paused, loop.driver.zones))

    drop = once(lambda _, loop: loop.seen.pose.x > 0.45, lambda ride: ride.topics.mask(here))
    ride = Ride(FAR, at=at)
    why = "the zones have changed: braking for them"
    waits = [zones for said, zones in paused if said == why]
    assert waits
    assert set(waits) == {paused[0][1]}  # those before count meanwhile
    assert paused[-1][1] is not paused[0][1]
    assert ride.depths(here).max() < 0.2  # at its edge
    assert ride.arrived


def test_a_zone_that_appears_under_the_robot_can_only_be_left():
    here = (-1.0, -1.5, 1.6, 1.5)
    drop = once(lambda _, loop: loop.seen.pose.x > 0.45, lambda ride: ride.topics.mask(here))
    ride = Ride(FAR, at=drop, end=3.5)
    depths = ride.depths(here)[ride.at :]
    assert depths[0] > 0.5
    assert depths.max() < depths[0] + 0.15
    assert ride.arrived
    assert depths[-1] == 0.0


def test_a_removed_zone_no_longer_blocks():
    ride = Ride(SHUT, at=once(lambda ride, _: ride.t > 4.5, lambda ride: ride.topics.mask()))
    assert ride.poses[ride.at].x < SHUT[0]
    assert ride.arrived
    (told,) = [one for one in ride.session.zone_maps if one.what == Zone.KEEP_OUT]
    assert (told.rows, told.columns) == (0, 0)


@pytest.mark.parametrize(
    ("spoil", "why"),
    first([
        (lambda t: t.mask(ACROSS, frame="odom"), "/mask: it is in the frame 'odom', and the map's"),
        (lambda t: t.say("/mask", grid(cells(ACROSS), SIDE, (90.0, 0.0, 0.0))),
         "the keep-out zones lie beside the map, from 90.0"),
        (lambda t: t.say("/mask", grid(cells(ACROSS, value=30), SIDE, (*LOW, 0.0))),
         "/mask (named by /info): no cell is occupied, so no zone is marked"),
        (lambda t: t.say("/info", info("mask", PERCENT, 100.0, -1.0)),
         "/info was a filter of type 0, and now of one of type 1: start the drive again"),
        (lambda t: t.say("/info", info("elsewhere")),
         "/info names /elsewhere now, and nothing came there yet"),
    ], 3),
)  # fmt: skip
def test_an_unusable_mask_is_reported_once_and_changes_nothing(tmp_path, spoil, why):
    topics, said = Topics(), []
    zones = ZonesOnTopics(topics, (keep_out(FAR),), "map", "/", InlineJobs(), said.append)
    with Drive(tmp_path, topics=OnTopics(None, None, zones=zones)) as drive:
        zones.attend(drive.session)
        topics.say("/info", info("mask"))
        topics.mask(FAR)
        drive.run(range(5))
        before = drive.loop.driver.zones
        spoil(topics)
        spoil(topics)
        drive.run(range(5))
        (sentence,) = said
        assert sentence.startswith(why)
        assert sentence.endswith("; the earlier zones still apply")
        assert drive.loop.driver.zones is before
        (alarm,) = [one for one in drive.loop.alarms.worst() if one.text == sentence]
        assert (alarm.active, alarm.severity) == (True, Severity.WARNING)
        topics.say("/info", info("mask"))
        topics.mask(ACROSS)
        drive.run(range(5))
        assert drive.loop.driver.zones is not before
        assert not any(one.active for one in drive.loop.alarms.worst() if one.text == sentence)


def test_new_zones_that_can_not_be_made_are_an_alarm(tmp_path, monkeypatch):
    """Whoever changed them is told, whatever the reason is."""

    def fails(*_):
        raise MemoryError("Unable to allocate 3.73 GiB")

    topics, said = Topics(), []
    zones = ZonesOnTopics(topics, (keep_out(FAR),), "map", "/", InlineJobs(), said.append)
    with Drive(tmp_path, topics=OnTopics(None, None, zones=zones)) as drive:
        zones.attend(drive.session)
        topics.say("/info", info("mask"))
        before = drive.loop.driver.zones
        monkeypatch.setattr("cohelm.drive.zones_on_topics.check", fails)
        topics.mask(ACROSS)
        drive.run(range(5))
        why = "MemoryError: Unable to allocate 3.73 GiB; the earlier zones still apply"
        assert said == [why]
        assert why in [one.text for one in drive.loop.alarms.worst() if one.active]
        assert drive.loop.driver.zones is before


def test_stations_show_new_zones_and_paths_are_checked_against_them(tmp_path):
    topics = Topics()
    zones = ZonesOnTopics(topics, (keep_out(FAR),), "map", "/", InlineJobs(), print)
    with Drive(tmp_path, topics=OnTopics(None, None, zones=zones)) as drive:
        zones.attend(drive.session)
        anna = drive.station("anna")
        drive.run(range(5))
        anna.ask(RequestKind.TAKE)
        topics.say("/info", info("mask"))
        topics.mask(ACROSS)
        drive.run(range(10))
        told = drive.link.bulk._published
        assert told[ZoneMap, Zone.KEEP_OUT].rows > 0
        assert told[ZoneMap, Zone.SPEED].rows == 0
        judge = drive.desk._rerouting._checking._judge
        assert judge(Goal(1.9, -0.5), Pose(0.0, 0.0, 0.0)).why.endswith("is in a keep-out zone")
        shown = [one for one in drive.desk._drawn if isinstance(one, ZoneMap)]
        assert tuple(shown) == drive.session.zone_maps


def test_a_path_planned_before_the_zones_came_is_checked_against_them(tmp_path):
    topics = Topics()
    zones = ZonesOnTopics(topics, (keep_out(FAR),), "map", "/", InlineJobs(), print)
    with Drive(tmp_path, topics=OnTopics(None, None, zones=zones)) as drive:
        zones.attend(drive.session)
        drive.run(range(5))
        reference = drive.session.plan.robot.scenario.reference.spline()
        made = drive.desk._rerouting._build(reference)
        topics.say("/info", info("mask"))
        topics.mask(ACROSS)
        drive.run(range(5))
        first = drive.loop.driver
        drive.desk._rerouting._adopt(drive.loop, made, reference)
        assert drive.loop.driver is made
        assert made.zones is first.zones is not None


def test_zones_are_adopted_where_the_robot_can_stop_and_at_once_while_it_is_lost():
    with Session(SessionConfig(simulated(CORRIDOR, real_time=False))) as session:
        driver, here = session.loop.driver, Pose(1.05, 0.0, 0.0)
        zones, settings = masked([keep_out(ACROSS)]), driver.settings
        other = [
            Zoned(zones, settings.outline, settings.gains.u_d, settings.limits) for _ in range(3)
        ]
        driver._twist = Twist(0.5, 0.0)
        assert not driver.set_zones(other[0], here)
        assert driver.zones is None
        assert driver.set_zones(other[1], Pose(0.0, 0.0, 0.0))
        assert driver.set_zones(other[2], None)
        assert driver.zones is other[2]


def test_a_new_checker_runs_in_a_new_process(monkeypatch):
    monkeypatch.setattr(path_check_process, "_AGAIN", 300.0)  # of one that failed
    made = simulated(CORRIDOR, real_time=False)
    plan = SessionConfig(made)
    checking = RemoteChecking(checker_of(plan, None))
    here, goal = Pose(0.0, 0.0, 0.0), Goal(1.9, -0.5)

    def answer():
        assert any(checking.ready for _ in looks(60.0, 0.02, 0.5))
        checking.begin(0.0, goal, here)
        return next(filter(None, (checking.result(0.0) for _ in looks(60.0, 0.02, 0.5))))

    try:
        assert answer().reference is not None
        zones = masked([keep_out(ACROSS)])
        checking.set_checker(checker_of(SessionConfig(made, zones=zones), None))
        assert answer().why == "the goal 1.9, -0.5 is in a keep-out zone"
    finally:
        checking.close()
