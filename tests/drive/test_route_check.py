"""The route that a drive begins with is checked on its map, as edited routes are."""

from collections.abc import Generator
from contextlib import contextmanager, nullcontext

import pytest

from cohelm.drive.factory import simulated
from cohelm.drive.operate import End, mode_and_stick
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.until_ended import drive_here
from cohelm.link.messages import Mode, RequestKind, Severity
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from tests.drive.faults import CORRIDOR
from tests.drive.resuming import Drive
from tests.drive.simulated_link import checked, chosen

OUTSIDE = ["reference.waypoints_m=[[0, 0], [2, 0], [4, 9]]"]
THROUGH = ["reference.waypoints_m=[[0, 0], [2, 0], [3, 9], [4, 0]]"]
GOAL = "waypoint 3, the goal of the route, can not be reached: the goal 4.0, 9.0 is not on the map"


@pytest.mark.parametrize("takes", [0, 40])
def test_a_goal_that_can_not_be_reached_is_an_alarm_and_no_automatic_mode(tmp_path, takes):
    """takes: periods of a check; it is under way when the mode is chosen."""
    with Drive(tmp_path, changes=OUTSIDE) as drive:
        drive.beside.checking.takes = takes

        def script():
            anna, answer = yield from chosen(drive.link, Mode.AUTOMATIC)
            assert answer == ((False, GOAL) if takes == 0 else (True, ""))
            yield from range(150)
            alarm, *_ = drive.loop.alarms.worst()
            assert (alarm.text, alarm.severity, alarm.active) == (GOAL, Severity.ALARM, True)
            assert drive.loop.supervisor.mode == Mode.HOLD
            assert drive.moved == 0
            anna.propose([(1.5, 0.0)])
            yield from range(200)
            assert [one.answer.granted for one in checked(anna)] == [True]
            assert not any(one.active for one in drive.loop.alarms.worst())
            anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
            yield from range(100)
            assert drive.moved > 50

        drive.run(script())


def test_in_shared_mode_such_a_route_is_the_stick_alone(tmp_path):
    with Drive(tmp_path, changes=OUTSIDE) as drive:

        def script():
            _, answer = yield from chosen(drive.link, Mode.SHARED)
            assert answer == (True, "")
            yield from range(100)
            assert drive.moved == 0
            assert drive.session.state().startswith("shared: waypoint 3")

        drive.run(script())


def test_a_waypoint_that_can_not_be_reached_is_a_warning(tmp_path):
    """The goal can, so it drives there."""
    with Drive(tmp_path, changes=THROUGH) as drive:

        def script():
            yield from chosen(drive.link, Mode.AUTOMATIC)
            yield from range(100)
            (alarm,) = drive.loop.alarms.worst()
            assert alarm.severity == Severity.WARNING
            assert "waypoint 3 is not on the map" in alarm.text
            assert drive.moved > 50

        drive.run(script())


@pytest.mark.parametrize("fails", ["check", "mistake"])
def test_a_check_that_fails_holds_nobody_up(tmp_path, fails):
    with Drive(tmp_path) as drive:
        drive.beside.fails = fails

        def script():
            yield from chosen(drive.link, Mode.AUTOMATIC)
            yield from range(60)
            assert drive.moved > 20
            assert drive.loop.alarms.worst() == ()

        drive.run(script())
    assert drive.session.route_problem.startswith("the route could not be checked on the map: ")


class UntilChecked(End):
    """Ends a drive when the check has found something."""

    session: Session | None = None

    @property
    def reason(self) -> str:
        return "" if self.session is None else self.session.route_problem

    @reason.setter
    def reason(self, _: str) -> None: ...

    @contextmanager
    def of(self, session: Session) -> Generator[None]:
        self.session = session
        yield


def driven(changes: list[str], real_time: bool, seconds: float, stop: End | None = None) -> dict:
    """On a map that is not the site's own."""
    made = simulated(CORRIDOR, real_time=real_time, changes=changes)
    mode, stick = mode_and_stick(made, "automatic")
    known = map_from_geometry(made.scenario.walls(), made.start)
    plan = SessionConfig(made, known=known)
    begun = stop.of if isinstance(stop, UntilChecked) else lambda _: nullcontext()
    return drive_here(plan, mode, stick, stop or End([]), seconds, begun=begun)


def test_without_a_station_it_is_in_the_summary():
    summary = driven(OUTSIDE, False, 3.0)
    assert summary["route"] == summary["not_begun"] == GOAL
    summary = driven(THROUGH, False, 3.0)
    assert "waypoint 3 is not on the map" in summary["route"]
    assert summary["not_begun"] is None
    assert driven([], False, 1.0)["route"] is None


@pytest.mark.xdist_group("realtime")
def test_in_real_time_a_process_of_its_own_checks_it():
    assert driven(OUTSIDE, True, 40.0, UntilChecked([]))["not_begun"] == GOAL
