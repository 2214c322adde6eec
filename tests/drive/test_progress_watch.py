"""A robot that gets no farther on its route says so to its operator."""

import pytest

from cohelm.drive import progress_watch
from cohelm.drive.progress_watch import WITHIN
from cohelm.link.messages import Mode, RequestKind
from tests.drive.resuming import Drive
from tests.few import first

POST = "obstacles=[{name: post, center_m: [3.0, 0.1], radius_m: 0.15}]"
WALL = "obstacles=[{name: post, center_m: [2.5, 0.0], radius_m: 1.4}]"
SHORT = "reference.waypoints_m=[[0, 0], [2.5, 0], [5, 0]]"
PERIODS = 50  # a second
SOON = 4.0  # told of after so long, where nobody counts the true number of seconds [s]
SAID = f"no farther on the route for {WITHIN:.0f} s"


def told(drive) -> list[bool]:
    """Whether each alarm of it is active."""
    return [one.active for one in drive.loop.alarms.worst() if one.text.startswith(SAID)]


def started(drive, mode):
    anna = drive.station("anna")
    yield from range(5)
    anna.ask(RequestKind.TAKE)
    yield from range(5)
    anna.ask(RequestKind.MODE, int(mode))
    yield from range(5)
    return anna


@pytest.mark.parametrize(
    ("mode", "within"), first([(Mode.AUTOMATIC, SOON), (Mode.SHARED, SOON), (Mode.SHARED, WITHIN)])
)
def test_an_operator_is_told_that_the_robot_gets_no_farther(tmp_path, monkeypatch, mode, within):
    monkeypatch.setattr(progress_watch, "WITHIN", within)

    def script():
        anna = yield from started(drive, mode)
        yield from range(int(within * PERIODS) - 10)  # it has the mode since a few
        assert told(drive) == []
        for _ in range(40 * PERIODS):
            if told(drive):
                break
            yield
        assert told(drive) == [True]
        yield from range(PERIODS)
        assert told(drive) == [True]
        anna.ask(RequestKind.MODE, int(Mode.HOLD))
        yield from range(PERIODS)
        assert told(drive) == [False]  # its cause is gone

    with Drive(tmp_path, changes=[WALL]) as drive:
        drive.run(script())
        assert told(drive) == [False]


def test_a_robot_that_gets_by_or_has_arrived_does_not_say_so(tmp_path, monkeypatch):
    monkeypatch.setattr(progress_watch, "WITHIN", SOON)  # what is not told then is not told later

    def script():
        yield from started(drive, Mode.AUTOMATIC)
        for _ in range(PERIODS * 40):
            if drive.loop.driver.arrived:
                break
            yield
        assert drive.loop.driver.arrived
        yield from range(int(PERIODS * (SOON + 1.0)))

    with Drive(tmp_path, changes=[POST, SHORT]) as drive:
        drive.run(script())
        assert told(drive) == []
