"""Requests for paths: who may make them, and their limits."""

import numpy as np
import pytest

from cohelm.link.messages import Mode, RequestKind
from tests.drive.resuming import Drive
from tests.drive.simulated_link import checked

WAY = [(2.0, 0.0), (5.0, 0.2)]


@pytest.fixture
def drive(tmp_path):
    with Drive(tmp_path) as made:
        yield made


def begun(drive: Drive):
    anna, bert, cleo = (drive.station(name) for name in ("anna", "bert", "cleo"))
    yield from range(5)
    anna.ask(RequestKind.TAKE)
    yield from range(5)
    return anna, bert, cleo


def test_no_observer_displaces_the_path_request_of_the_driver_or_of_another(drive):
    """Each check takes half a second; bert has ten checked each second, from before on."""
    drive.beside.checking.takes = 25

    def script():
        anna, bert, cleo = yield from begun(drive)
        said = {anna: [], bert: [], cleo: []}
        own = []
        for period in range(300):
            if period % 5 == 0:
                bert.propose(WAY, only_check=True)
            if period == 40:
                cleo.propose(WAY, only_check=True)
                own = [anna.propose(WAY, only_check=True), anna.propose(WAY)]
            for station, all_ in said.items():
                all_ += [(period, c.answer) for c in checked(station)]
            yield
        assert [a.number for _, a in said[anna]] == own[::-1]  # to go before to check
        assert all(a.granted for _, a in said[anna])
        assert said[anna][0][0] <= 40 + 3 * 26
        assert [a.granted for _, a in said[cleo]] == [True]
        assert 3 <= len(said[bert]) <= 12  # the newest, as there was time

    drive.run(script())


def test_a_path_that_was_not_checked_in_time_is_answered_with_the_reason(drive):
    drive.beside.checking.takes = 400

    def script():
        _, bert, cleo = yield from begun(drive)
        bert.propose(WAY, only_check=True)
        yield from range(3)
        cleo.propose(WAY, only_check=True)
        yield from range(300)
        (said,) = checked(cleo)
        assert said.answer.reason == "there was no time to check it: send it again"

    drive.run(script())


def test_a_path_of_too_many_waypoints_is_refused_with_a_reason(drive):
    def script():
        anna, *_ = yield from begun(drive)
        anna.propose(np.column_stack((np.linspace(1.0, 5.0, 300), np.zeros(300))))
        yield from range(10)
        (said,) = checked(anna)
        assert said.answer.reason == "more than 256 waypoints: leave some out"

    drive.run(script())


def test_a_path_of_an_observer_is_checked_and_never_followed(drive):
    def script():
        anna, bert, _ = yield from begun(drive)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(30)
        first = drive.loop.driver
        bert.propose(WAY)
        yield from range(60)
        (said,) = checked(bert)
        assert said.answer.reason == "you are not the driver"
        assert drive.loop.driver is first
        assert drive.loop.supervisor.mode == Mode.AUTOMATIC

    drive.run(script())
