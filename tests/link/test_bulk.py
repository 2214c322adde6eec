"""Bulk messages over real sockets on this machine."""

from __future__ import annotations

import hashlib
import os
import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.link.bulk_messages import (
    Checked,
    Digest,
    Fetch,
    HealthReport,
    LineKind,
    Picture,
    Piece,
    Polyline,
    Records,
    Waypoints,
)
from cohelm.link.congestion import FASTEST, SLOWEST, TARGET, CongestionControl
from cohelm.link.keys import Keys, pair_here
from cohelm.link.messages import Answer, RequestKind
from cohelm.link.robot_bulk import both_ends
from cohelm.link.robot_end import PATH_LIFE
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StationEnd
from tests.link.ends import STATUS, answered, until

HERE = "127.0.0.1"


class Both:
    def __init__(self, folder) -> None:
        self.robot_keys, self.keys = pair_here()
        self.robot, self.down = both_ends(self.robot_keys, HERE, 0, folder)
        self.port = self.robot.address[1]
        self.station = StationEnd(self.keys, HERE, self.port)
        self.up = self.stream(self.keys, self.station.session)
        self.news: list[object] = []

    def stream(self, keys: Keys, session: int) -> StationBulk:
        return StationBulk(keys, HERE, self.port, session)

    def turn(self) -> None:
        self.robot.send_status(STATUS)
        self.robot.receive()
        self.news += self.up.news()

    def got(self, of: type) -> list:
        return [message for message in self.news if type(message) is of]

    def drive(self) -> None:
        answered(self.station, RequestKind.TAKE, turn=self.turn)


@pytest.fixture
def both(tmp_path):
    both = Both(tmp_path)
    until(lambda: both.station.status() and both.up.connected, turn=both.turn)
    yield both
    for part in (both.up, both.station, both.down, both.robot):
        part.close()


def test_published_messages_reach_all_and_late_subscribers(both):
    line = Polyline(LineKind.REFERENCE, np.random.default_rng(1).random((5000, 2), np.float32))
    both.down.publish(line)
    both.down.publish(HealthReport(0.5, ("the left wheel squeaks",)))
    until(lambda: both.got(Polyline) and both.got(HealthReport), turn=both.turn)
    assert np.array_equal(both.got(Polyline)[0].points, line.points)
    with both.stream(both.keys, 77) as late:
        news: list[object] = []
        until(lambda: any(type(m) is Polyline for m in news), turn=lambda: news.extend(late.news()))


def test_of_pictures_only_the_newest_is_sent_and_shown(both):
    for number in range(50):
        both.down.publish(Picture(number, 1.0, Pose(0.0, 0.0, 0.0), os.urandom(20_000)))
    seen = []
    until(
        lambda: seen and seen[-1].number == 49,
        turn=lambda: seen.extend(p for p in [both.up.picture()] if p),
    )
    assert [p.number for p in seen] == sorted({p.number for p in seen})
    assert len(seen) < 25
    assert both.up.picture() is None


def test_only_the_drivers_waypoints_are_accepted_and_answered(both):
    way = np.array([[1.0, 2.0], [3.0, 4.0]])
    both.up.send(Waypoints(1, way, False))
    until(lambda: both.got(Checked), turn=both.turn)
    assert both.got(Checked)[0] == Checked(Answer(1, False, "you are not the driver"), 65535)
    both.drive()
    both.up.send(Waypoints(2, way, False))
    both.up.send(Waypoints(3, way + 1.0, True))
    proposed = []
    until(lambda: len(proposed) == 2, turn=lambda: proposed.extend(both.down.proposed()))
    assert np.array_equal(proposed[0].what.points, way)
    assert np.array_equal(proposed[1].what.points, way + 1.0)
    both.down.reply(proposed[0].client, Checked(Answer(2, False, "0.1 m from a wall"), 1))
    until(lambda: len(both.got(Checked)) == 2, turn=both.turn)
    assert both.got(Checked)[1].worst == 1


@pytest.mark.parametrize(("late", "accepted"), [(0.5, True), (PATH_LIFE + 0.5, False)])
def test_waypoints_that_waited_for_a_connection_are_not_followed_later(both, late, accepted):
    """Sent while the stream was down, by a driver who may have given up on them long ago."""
    both.drive()
    clock = SimpleNamespace(back=late)
    with StationBulk(
        both.keys, HERE, both.port, both.station.session, lambda: time.monotonic() - clock.back
    ) as up:
        up.send(Waypoints(7, np.array([[1.0, 2.0], [3.0, 4.0]]), False))
        clock.back = 0.0
        proposed = []
        answers = []

        def turn() -> None:
            both.turn()
            proposed.extend(both.down.proposed())
            answers.extend(one for one in up.news() if isinstance(one, Checked))

        until(lambda: proposed or answers, turn=turn)
    if accepted:
        assert [one.what.number for one in proposed] == [7]
    else:
        assert [one.answer for one in answers] == [
            Answer(7, False, "the waypoints are too old: send them again")
        ]


def test_waypoints_from_before_the_lease_are_not_followed(both):
    """Of a client that was given the lease, and could not know that it had it."""
    both.drive()
    why = both.robot.path_refusal(both.robot.driver, time.monotonic())
    assert why == ""
    both.robot._given_at = time.monotonic() + 0.5
    why = both.robot.path_refusal(both.robot.driver, time.monotonic())
    assert why == "you were not the driver yet"


def test_observers_may_have_waypoints_checked(both):
    both.up.send(Waypoints(1, np.zeros((2, 2)), True))
    until(both.down.proposed, turn=both.turn)


def test_a_record_is_fetched_whole_and_nothing_else_can_be(both, tmp_path):
    content = os.urandom(700_000)
    (tmp_path / "run.mcap").write_bytes(content)
    (tmp_path / "secret.txt").write_text("no")
    both.up.send(Fetch(""))
    until(lambda: [r for r in both.got(Records) if r.all], turn=both.turn)
    assert [info.name for info in both.got(Records)[-1].all] == ["run.mcap"]
    both.up.send(Fetch("run.mcap"))
    until(lambda: both.got(Digest), turn=both.turn)
    sha256 = hashlib.sha256(content).digest()
    assert both.got(Digest) == [Digest("run.mcap", len(content), sha256, "")]
    both.up.send(Fetch("run.mcap", 0, 400_000))
    both.up.send(Fetch("run.mcap", 400_000, 400_000))
    until(lambda: any(not p.data for p in both.got(Piece)), turn=both.turn)
    assert b"".join(p.data for p in both.got(Piece)) == content
    for name in ("secret.txt", "../run.mcap", "/etc/passwd", "nothing.mcap"):
        both.news.clear()
        both.up.send(Fetch(name))
        until(lambda: both.got(Digest), turn=both.turn)
        assert both.got(Digest)[0].why == "the robot has no such record"
        both.up.send(Fetch(name, 0, 10))
        until(lambda: both.got(Piece), turn=both.turn)
        assert both.got(Piece) == [Piece(name, 0, b"")]


def test_the_robot_sends_no_more_of_a_record_than_requested(both, tmp_path):
    (tmp_path / "run.mcap").write_bytes(os.urandom(700_000))
    both.up.send(Fetch("run.mcap", 100_000, 50_000))
    until(lambda: sum(len(p.data) for p in both.got(Piece)) == 50_000, turn=both.turn)
    both.up.send(Fetch("run.mcap", 150_000, 1))  # goes on
    until(lambda: sum(len(p.data) for p in both.got(Piece)) == 50_001, turn=both.turn)
    both.up.send(Fetch("run.mcap", 600_000, 10))  # begins anew
    until(lambda: sum(len(p.data) for p in both.got(Piece)) == 50_011, turn=both.turn)
    time.sleep(0.2)
    both.turn()
    assert sum(len(p.data) for p in both.got(Piece)) == 50_011
    assert [p.offset for p in both.got(Piece)] == [100_000, 132_768, 150_000, 600_000]


@pytest.mark.parametrize("offset", [700_000, 2**63, 2**64 - 1])
def test_a_part_beyond_a_records_end_is_empty(both, tmp_path, caplog, offset):
    (tmp_path / "run.mcap").write_bytes(os.urandom(1000))
    both.up.send(Fetch("run.mcap", offset, 10))
    until(lambda: both.got(Piece), turn=both.turn)
    assert both.got(Piece) == [Piece("run.mcap", offset, b"")]
    assert "an error in the link" not in caplog.text


def test_an_unpaired_station_gets_nothing(both):
    stranger = pair_here("stranger")[1]._replace(trusted=both.keys.trusted)
    both.down.publish(HealthReport(0.5, ()))
    with both.stream(stranger, 5) as stream:
        time.sleep(0.5)
        assert not stream.news()
    wrong_robot = both.keys._replace(trusted=pair_here()[1].trusted)
    with both.stream(wrong_robot, 5) as stream:
        time.sleep(0.5)
        assert not stream.connected


def test_slow_and_silent_connections_do_not_block_a_station(both):
    held = [socket.create_connection((HERE, both.port)) for _ in range(30)]
    for sock in held:
        sock.send(b"\x16\x03")
    with both.stream(both.keys, 9) as late:
        until(lambda: late.connected, within=5.0)
    both.down.publish(HealthReport(0.25, ()))
    until(lambda: both.got(HealthReport), turn=both.turn)
    for sock in held:
        sock.close()


def test_bulk_slows_down_while_datagrams_are_delayed_and_speeds_up_again():
    pace, now = CongestionControl(0.0), 0.0
    for _ in range(100):
        now += 0.11
        pace.observe(0.1, 0.1, now)
    assert pace.rate == FASTEST
    for _ in range(100):
        now += 0.11
        pace.observe(0.1 + 3.0 * TARGET, 0.1, now)
    assert pace.rate == SLOWEST
    assert pace.allowed(now + 100.0) <= 2048  # a pause is not made up for
    before = pace.rate
    pace.observe(float("nan"), 0.1, now + 1.0)
    assert pace.rate == before
