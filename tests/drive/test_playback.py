"""Playback of a recorded drive."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import cohelm
from cohelm.core.errors import CohelmError
from cohelm.core.row import ROW
from cohelm.core.types import Pose, Stick
from cohelm.drive.factory import simulated
from cohelm.drive.playback import Playback
from cohelm.drive.replayed import Replaying
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.shown import map_message, reference_lines
from cohelm.link.bulk_messages import LineKind, Map, Picture, Polyline
from cohelm.link.messages import Discs, Localised, Mode, RequestKind, ScanPart, Severity, Status
from cohelm.link.operator import Scripted
from cohelm.loop.status import scan_parts
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.record.file import About, RecordWriter
from cohelm.record.read import IncompleteRecord
from cohelm.record.ros2 import header, laser_scan
from cohelm.record.write import Recorder
from cohelm.robot.port import Encoded, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.station.robot_link import News
from tests.drive.faults import CORRIDOR
from tests.ports.adapters import sally


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Follows the corridor, led to the left from 2 s to 3 s, stopped by the driver at 4 s."""
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    robot = simulated(CORRIDOR, real_time=False)
    operator = Scripted(lambda t: Stick(0.0, 0.6 if 2.0 < t < 3.0 else 0.0), lambda: 0.0)
    with Session(SessionConfig(robot, record=path), operator) as session:
        gated = session.loop.gated
        operator._clock = gated.now
        session.run(lambda loop: gated.now() >= 4.0, Mode.SHARED)
        operator.ask(RequestKind.STOP)
        session.run(lambda loop: gated.now() >= 5.0)
        told = list(operator.statuses)
        known = map_from_geometry(robot.scenario.walls(), robot.start)
        shown = [map_message(known), *reference_lines(robot.scenario.reference.spline())]
    return path, told, shown


@pytest.fixture(scope="module")
def played(driven) -> Playback:
    """That drive, for tests that only look at it."""
    return Playback(driven[0])


def at(seen: Playback, t: float) -> dict:
    """The messages at a time of the robot's clock, by type; of lines, by what they are."""
    out = {}
    for news in seen.at(t - seen.start):
        out[getattr(news.message, "what", type(news.message))] = news.message
    return out


def test_numbers_and_texts_are_played_back_as_recorded(driven, played):
    _, told, _ = driven
    for k in (-1, -20, -49):  # standing, braking, and being stopped
        t = played._times[k]
        then, now = told[k], at(played, t)[Status]
        for name in ("pose", "applied", "nominal", "stick", "arming", "e_p", "reference",
                     "mode", "stopped", "why", "localised", "sigma", "speed_cap",
                     "authority", "verdict", "clearance_seen", "limiting", "h"):  # fmt: skip
            assert repr(getattr(now, name)) == repr(getattr(then, name)), (k, name)
        assert [a for a in now.alarms if a.number < 10_000] == list(then.alarms)


def test_a_drive_by_odometry_alone_is_played_back_as_one(tmp_path):
    path = tmp_path / "drive.mcap"
    robot = simulated("minimal", real_time=False)
    operator = Scripted(lambda _: Stick(0.0, 0.0), lambda: 0.0)
    with Session(SessionConfig(robot, record=path), operator) as session:
        gated = session.loop.gated
        operator._clock = gated.now
        session.run(lambda _: gated.now() >= 0.5, Mode.AUTOMATIC)
    assert operator.statuses[-1].localised == Localised.UNKNOWN
    assert at(Playback(path), 0.4)[Status].localised == Localised.UNKNOWN


def test_playback_shows_driver_and_events(played):
    leading = at(played, 2.9)[Status]
    assert (leading.lease.driver, leading.lease.driver_name) == (1, "script")
    assert leading.mode == Mode.SHARED
    assert leading.authority < 0.9
    assert leading.stopped == ""
    stopped = at(played, 4.5)[Status]
    assert stopped.stopped == "stop by script"
    words = [alarm.text for alarm in stopped.alarms]
    assert "stop by script" in words  # the alarm
    assert any("gate:" in word and "STOPPED" in word for word in words)
    assert any(a.severity == Severity.NOTICE and "requests STOP" in a.text for a in stopped.alarms)


def test_playback_shows_the_map_path_scan_and_obstacles_of_the_drive(driven, played):
    _, _, (grid, line, points) = driven
    seen = at(played, 2.0)
    assert seen[Map] == grid
    assert np.array_equal(seen[LineKind.REFERENCE].points, line.points)
    assert np.array_equal(seen[LineKind.WAYPOINTS].points, points.points)
    scan = seen[ScanPart]
    assert 1.8 < scan.taken <= 2.0
    known = scan.ranges[(scan.ranges > 0) & (scan.ranges < 65535)] / 1000.0
    assert 0.8 < known.min() < 1.6  # the corridor's walls
    assert seen[Discs].rows.shape[1] == 6
    # beams that hit do so where the map has walls
    k = np.flatnonzero((scan.ranges > 0) & (scan.ranges < 3000))
    bearing = scan.sensor.psi + scan.first + k * scan.step
    y = scan.sensor.y + scan.ranges[k] / 1000.0 * np.sin(bearing)
    assert np.median(np.abs(np.abs(y) - 1.5)) < 0.1


def test_a_recorded_scan_is_shown_as_it_was_live(driven):
    ranges = np.array([math.nan, math.inf, -math.inf, 1.0, 70.0])
    live = scan_parts(Scan(9.0, 1, ranges, 0.0), LidarModel().lidar(), Pose(0.0, 0.0, 0.0))
    assert live[0].ranges.tolist() == [65535, 65535, 0, 1000, 65534]
    record = Playback(driven[0])
    message = laser_scan(header(0, "laser"), Scan(9.0, 1, ranges, 0.0), LidarModel())
    record._add("/scan", 1e6, message)
    assert record._series["/scan"].all[-1].ranges.tolist() == live[0].ranges.tolist()


def test_playback_repeats_messages_only_after_seeking_back(driven):
    now = [0.0]
    link = Replaying(Playback(driven[0]), lambda: now[0])
    first = [type(news.message) for news in link.news()]
    assert Map in first
    assert Polyline in first
    now[0] += 0.05
    assert {type(news.message) for news in link.news()} <= {Status, ScanPart, Discs}
    link.play(False, 1.0, 4.5)
    link.news()
    link.play(False, 1.0, 1.0)
    (status,) = (n.message for n in link.news() if isinstance(n.message, Status))
    assert status.stopped == ""


def test_a_record_that_was_cut_short_is_shown_as_far_as_it_goes(driven, played, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(driven[0].read_bytes()[: driven[0].stat().st_size // 2])
    with pytest.warns(IncompleteRecord, match="ends too early"):
        shown = Playback(cut)
    assert 0.5 < shown.duration < played.duration
    empty = tmp_path / "empty.mcap"
    with empty.open("wb") as file:
        RecordWriter(file, About("drive", 0), sally()).finish()
    with pytest.raises(CohelmError, match="before its first control period"):
        Playback(empty)
    assert not math.isnan(played.start)


def test_the_cameras_pictures_are_shown_from_where_they_were_taken(played, tmp_path):
    path = tmp_path / "pictures.mcap"
    row = np.zeros((), dtype=ROW)
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", 10**18), sally())
        for k in range(20):
            row["t"], row["x"] = 5.0 + 0.1 * k, 0.05 * k
            made.period(row)
            if k % 5 == 0:
                made.write(Encoded(5.0 + 0.1 * k, k, b"picture %d" % k))
        made.finish()
    seen = Playback(path)
    (hello,) = seen.first()
    assert not math.isnan(hello.camera[0])
    for t, k in ((0.1, 0), (0.72, 5), (0.2, 0), (1.6, 15)):
        picture = at(seen, seen.start + t)[Picture]
        assert picture.jpeg == b"picture %d" % k
        assert picture.pose.x == pytest.approx(0.05 * k, abs=0.051)
    assert math.isnan(played.first()[0].camera[0])


def test_a_run_whose_scenario_is_damaged_in_its_record_is_refused_as_that(tmp_path):
    file = tmp_path / "record.mcap"
    made = cohelm.run("minimal", changes=["simulation.duration_s=1"])
    with Recorder(file) as recorder:
        recorder.write(made.trace)
    whole = file.read_bytes()
    assert whole.count(b"bumpers: []") == 1
    file.write_bytes(whole.replace(b"bumpers: []", b"bumpers: [["))
    said = r"the scenario in .*record.mcap can not be read: .*YAML"
    with pytest.warns(IncompleteRecord), pytest.raises(CohelmError, match=said):
        Playback(file)


def test_scans_of_two_lidars_are_sent_once_each():
    ranges = np.zeros(3, dtype=np.uint16)
    here = Pose(0.0, 0.0, 0.0)
    scans = [
        News(ScanPart(1, lidar, 0.0, here, 3, 0, 0.0, 0.1, ranges), 0.0, 0.0) for lidar in (0, 1)
    ]
    clock = iter(np.arange(0.0, 10.0, 0.5))
    record = SimpleNamespace(start=0.0, duration=9.0, first=list, at=lambda _: scans)
    link = Replaying(record, lambda: float(next(clock)))
    assert link.news() == scans
    assert link.news() == []
