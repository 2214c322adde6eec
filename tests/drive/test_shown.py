"""Detour, faults and clearance that stations are sent."""

import numpy as np
import pytest

from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.bulk_messages import HealthReport, LineKind, Polyline
from cohelm.link.messages import Mode, RequestKind
from cohelm.link.operator import Scripted
from tests.drive.faults import CORRIDOR
from tests.drive.resuming import Drive
from tests.drive.simulated_link import CENTRED

POST = "obstacles=[{name: post, center_m: [3.0, 0.1], radius_m: 0.15}]"


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
            if drive.loop.driver.arrived:
                return
            yield

    with Drive(tmp_path, changes=[POST]) as drive:
        drive.run(script())
    ways = [line for line in shown if len(line)]
    assert ways
    assert all(np.hypot(*(line - (3.0, 0.1)).T).min() > 0.15 for line in ways)
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


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.AUTOMATIC])
def test_the_clearance_is_shown_whether_the_filter_acts_on_it_or_not(mode):
    made = simulated(CORRIDOR, "kinematic", real_time=False)
    operator = Scripted(lambda t: CENTRED, lambda: 0.0)
    with Session(SessionConfig(made), operator) as session:
        off: list[float] = []

        def look(loop) -> bool:
            if operator.statuses:
                shown = operator.statuses[-1].guarding.clearance
                off.append(shown - session.gated.truth().clearance)
            return loop.gated.now() > 4.0

        session.run(look, mode)
        assert session.loop.supervisor.mode == mode
    assert np.abs(off).max() < 0.08  # what is shown is a scan older
