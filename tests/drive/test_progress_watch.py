"""A robot that gets no farther on its route says so to its operator."""

import pytest

from cohelm.drive.progress_watch import WITHIN
from cohelm.link.messages import Mode, RequestKind
from tests.drive.resuming import Drive
from tests.few import first

POST = "obstacles=[{name: post, center_m: [3.0, 0.1], radius_m: 0.15}]"
WALL = "obstacles=[{name: post, center_m: [2.5, 0.0], radius_m: 1.4}]"
PERIODS = 50  # a second
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


@pytest.mark.parametrize("mode", first([Mode.AUTOMATIC, Mode.SHARED]))
def test_an_operator_is_told_that_the_robot_gets_no_farther(tmp_path, mode):
    def script():
        anna = yield from started(drive, mode)
        yield from range(int(WITHIN * PERIODS))
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


def test_a_robot_that_gets_by_or_has_arrived_does_not_say_so(tmp_path):
    def script():
        yield from started(drive, Mode.AUTOMATIC)
        for _ in range(PERIODS * 40):
            if drive.loop.driver.arrived:
                break
            yield
        assert drive.loop.driver.arrived
        yield from range(int(PERIODS * (WITHIN + 5.0)))

    with Drive(tmp_path, changes=[POST]) as drive:
        drive.run(script())
        assert told(drive) == []
