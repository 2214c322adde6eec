"""Detour, faults and clearance that stations are sent."""

import zlib

import numpy as np
import pytest

from cohelm.core.types import Pose, Stick
from cohelm.drive.factory import simulated
from cohelm.drive.recorder import Recording
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.shown import recordable
from cohelm.link.bulk_messages import Alarms, HealthReport, LineKind, Map, Polyline, Zone, ZoneMap
from cohelm.link.messages import Mode, RequestKind
from cohelm.link.operator import Scripted
from cohelm.link.rasters import drawable
from cohelm.link.recorded_status import Displayed
from cohelm.link.wire import Header, encode, from_robot
from cohelm.loop.status import DONE
from cohelm.record.messages import messages
from cohelm.robot.keep.record_pipe import RecordLine
from tests.drive.faults import CORRIDOR, along_corridor
from tests.drive.resuming import Drive
from tests.drive.simulated_link import CENTRED
from tests.few import first
from tests.robot.keep.robots import SALLY

POST = "obstacles=[{name: post, center_m: [2.0, 0.1], radius_m: 0.15}]"


def seen(station, what):
    """The newest of its kind that has come to a station, and forget it."""
    for key, message in list(station.bulk.slots.items()):
        if isinstance(message, Polyline) and message.what == what:
            return station.bulk.slots.pop(key).points
    return None


def test_the_detour_is_shown_while_it_is_driven(tmp_path):
    """The post stands on the way, and on no map."""
    shown = []

    def script():
        anna = drive.station("anna")
        yield from range(5)
        anna.ask(RequestKind.TAKE)
        yield from range(5)
        anna.ask(RequestKind.MODE, int(Mode.AUTOMATIC))
        for _ in range(1500):
            line = seen(anna, LineKind.DETOUR)
            if line is not None:
                shown.append(line)
            if len(shown) > 1 and len(shown[-1]) == 0 < len(shown[-2]):  # it is past the post
                return
            yield

    with Drive(tmp_path, changes=[POST]) as drive:
        drive.run(script())
    ways = [line for line in shown if len(line)]
    assert ways
    assert all(np.hypot(*(line - (2.0, 0.1)).T).min() > 0.15 for line in ways)
    assert len(shown[-1]) == 0


def test_faults_reported_by_the_robot_reach_the_station(tmp_path):
    said = []

    def script():
        anna = drive.station("anna")
        yield from range(5)
        drive.wheels.bumped = True
        for _ in range(10):
            said.extend(m for m in anna.bulk.slots.values() if isinstance(m, HealthReport))
            yield

    with Drive(tmp_path) as drive:
        drive.run(script())
    assert said[-1].faults == ("the bumper is pressed",)


def test_every_alarm_reaches_the_station_whole(tmp_path):
    said = []

    def script():
        anna = drive.station("anna")
        yield from range(5)
        for number in range(6):
            drive.loop.alarms.on(f"trouble {number}", f"{number} " + 30 * "so long ")
        for _ in range(10):
            said.extend(m for m in anna.bulk.slots.values() if isinstance(m, Alarms))
            yield

    with Drive(tmp_path) as drive:
        drive.run(script())
    assert [one.text for one in said[-1].all][:6] == [
        f"{number} " + 30 * "so long " for number in range(5, -1, -1)
    ]


@pytest.mark.parametrize("mode", first([Mode.AUTOMATIC, Mode.HOLD]))
def test_the_clearance_is_shown_whether_the_filter_acts_on_it_or_not(mode):
    made = simulated(CORRIDOR, "kinematic", real_time=False)
    operator = Scripted(lambda t: CENTRED, lambda: 0.0)
    with Session(SessionConfig(made), operator) as session:
        off: list[float] = []

        def look(loop) -> bool:
            if operator.statuses:
                shown = operator.statuses[-1].clearance_seen
                off.append(shown - session.gated.truth().clearance)
            return loop.gated.now() > 4.0

        session.run(look, mode)
        assert session.loop.supervisor.mode == mode
    assert np.abs(off).max() < 0.08  # what is shown is a scan older


def test_at_the_end_of_the_route_the_station_and_the_terminal_say_so():
    """In automatic mode, and in shared mode with a centred stick; not for a stick that steers."""
    made = along_corridor(2.0)
    stick = [CENTRED]
    operator = Scripted(lambda t: stick[0], lambda: 0.0)
    with Session(SessionConfig(made), operator) as session:
        said: list[tuple[bool, str]] = []

        def look(loop) -> bool:
            arrived = loop.driver.arrived
            said.extend((arrived, one.why) for one in operator.statuses[-1:])
            return loop.gated.now() > 8.0

        session.run(look, Mode.AUTOMATIC)
        assert said[-1] == (True, DONE)
        assert not any(why == DONE for arrived, why in said if not arrived)
        assert session.state() == f"automatic: {DONE}"
        assert session.loop.supervisor.choose(Mode.SHARED) == ""
        session.run(lambda loop: loop.gated.now() > 8.5, Mode.HOLD)
        assert session.state() == f"shared: {DONE}"
        stick[0] = Stick(0.0, 1.0)
        session.run(lambda loop: loop.gated.now() > 9.5, Mode.HOLD)
        assert operator.statuses[-1].why == ""


def large_map():
    """A building of 200 m with rough walls, too large for one message to a record."""
    rng, cells = np.random.default_rng(1), np.full((4001, 4000), 255, dtype=np.uint8)
    along = np.arange(4000)
    for k in range(0, 4000, 200):
        cells[k + 10 : k + 60, :] = 0
        for wall in (9, 60):
            cells[np.clip(k + wall + rng.integers(-2, 3, 4000), 0, 4000), along] = 100
            cells[along, np.clip(k + wall + rng.integers(-2, 3, 4000), 0, 3999)] = 100
    return Map(
        1, Pose(-3.0, 4.0, 0.5), 0.05, 4000, 4001, 0, 0, 4000, 4001, zlib.compress(cells.tobytes())
    ), cells  # fmt: skip


def test_a_map_that_no_browser_draws_at_once_is_sent_with_wider_cells():
    cells = np.full((3, 70_001), 255, dtype=np.uint8)
    cells[:, 8::16] = 0
    cells[1, 40_000] = 100
    wide = Map(
        1, Pose(-3.0, 4.0, 0.5), 0.05, 70_001, 3, 0, 0, 70_001, 3, zlib.compress(cells.tobytes())
    )  # fmt: skip
    shown = drawable(wide)
    assert isinstance(shown, Map)
    _, received = from_robot(encode(Header(1, 1, 0.0, 0.0, 0.0), shown), bulk=True)
    assert isinstance(received, Map)
    assert received.cells == shown.cells
    assert (shown.resolution, shown.origin) == (8 * 0.05, wide.origin)
    assert (shown.width, shown.height) == (shown.columns, shown.rows) == (8751, 1)
    drawn = np.frombuffer(zlib.decompress(shown.cells), dtype=np.uint8)
    assert drawn[5000] == 100
    assert drawn[:5].tolist() == [255, 0, 255, 0, 255]
    small, _ = large_map()
    assert drawable(small) is small


def test_of_zones_that_are_too_many_cells_to_draw_the_slowest_speed_counts():
    cells = np.zeros((2, 40_000), dtype=np.uint8)
    cells[0, :6] = (100, 30, 0, 0, 50, 0)
    cells[1, 7] = 90
    for what, expected in ((Zone.SPEED, [30, 50, 0]), (Zone.KEEP_OUT, [100, 100, 0])):
        given = cells if what == Zone.SPEED else np.where(cells > 0, 100, 0).astype(np.uint8)
        zones = ZoneMap(
            what, Pose(0.0, 0.0, 0.0), 0.05, 0.5, 40_000, 2, zlib.compress(given.tobytes())
        )
        shown = drawable(zones)
        assert (shown.columns, shown.rows) == (10_000, 1)
        assert list(zlib.decompress(shown.cells)[:3]) == expected


def test_a_large_map_is_recorded_with_wider_cells(tmp_path):
    made, cells = large_map()
    recording = Recording(tmp_path / "drive.mcap", SALLY)
    recording.begin(0)
    recording.keep()
    line = RecordLine(recording.loop)
    line(Displayed(1.0, made))
    assert line.dropped == 1
    line(Displayed(2.0, recordable(made)))
    assert line.dropped == 1
    assert recording.close()
    [(_, _, grid)] = messages(recording.path, ("/map",))
    assert (grid.info.width, grid.info.height) == (2000, 2001)
    assert grid.info.resolution == pytest.approx(0.1)
    rows, columns = np.nonzero(cells == 100)
    found = grid.data.reshape(2001, 2000)
    assert (found[rows // 2, columns // 2] == 100).all()
    assert np.count_nonzero(found == 100) <= len(rows)
    assert found[-1, 0] == -1
    assert found[15, 7] == 0


def test_what_fits_is_recorded_as_it_is():
    line = Polyline(LineKind.REFERENCE, np.zeros((5, 2), dtype=np.float32))
    small = Map(1, Pose(0.0, 0.0, 0.0), 0.05, 3, 2, 0, 0, 3, 2, zlib.compress(bytes(6)))
    assert recordable(line) is line
    assert recordable(small) is small
