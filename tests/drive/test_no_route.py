"""A real robot whose site nobody named: no route, until one is drawn."""

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.drive.factory import own_robot
from cohelm.drive.on_topics import OnTopics
from cohelm.drive.operator_requests import OperatorRequests
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.bulk_messages import LineKind, Polyline
from cohelm.link.messages import Mode, RequestKind
from cohelm.loop.supervisor import NO_ROUTE
from tests.api import carts
from tests.drive.resuming import SessionJobs
from tests.drive.simulated_link import SimulatedLink, checked, chosen


class Unnamed:
    """A robot without a site, driven by stations in simulated time."""

    def __init__(self, folder) -> None:
        made = own_robot(carts.Simulated, model="sally")
        self.link = SimulatedLink(made.model, folder)
        self.lines: dict[LineKind, int] = {}
        """Points of the newest line of each kind that a page is shown."""
        publish = self.link.publish
        self.link.publish = lambda one: (self._look(one), publish(one))
        self.session = Session(SessionConfig(made), self.link.end)
        self.loop = self.session.loop
        self.link.clock = self.loop.gated.now
        self.desk = OperatorRequests(self.session, self.link, folder, SessionJobs)

    def _look(self, one) -> None:
        if isinstance(one, Polyline):
            self.lines[one.what] = len(one.points)

    def run(self, script) -> None:
        steps = iter(script)

        def until(loop) -> bool:
            self.desk.turn(loop)
            self.desk._jobs.turn()
            self.link.turn()
            return next(steps, "over") == "over"

        self.session.run(until)

    @property
    def x(self) -> float:
        return self.loop.seen.pose.x

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self.desk.close()
        self.session.close()
        self.link.close()


@pytest.fixture
def drive(tmp_path):
    with Unnamed(tmp_path) as made:
        yield made


def test_shared_without_a_route_is_the_stick_alone(drive):
    def script():
        anna, answer = yield from chosen(drive.link, Mode.SHARED)
        assert answer == (True, "")
        yield from range(150)
        assert drive.x == pytest.approx(0.0, abs=0.01)
        anna.stick = Stick(1.0, 0.0)
        yield from range(150)
        assert drive.x > 0.2

    drive.run(script())
    assert drive.lines[LineKind.REFERENCE] == drive.lines[LineKind.WAYPOINTS] == 0


def test_auto_without_a_route_is_refused_until_one_is_drawn(drive):
    def script():
        anna, answer = yield from chosen(drive.link, Mode.AUTOMATIC)
        assert answer == (False, NO_ROUTE)
        anna.propose(np.array([(1.5, 0.0)]))
        yield from range(100)
        assert [one.answer.granted for one in checked(anna)] == [True]
        assert drive.x == pytest.approx(0.0, abs=0.01)  # in hold
        assert drive.lines[LineKind.WAYPOINTS] == 2
        number = anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from range(400)
        assert anna.answers[number] == (True, "")
        assert drive.x > 1.3

    drive.run(script())


def test_waypoints_without_a_site_are_refused():
    with pytest.raises(CohelmError, match="name it with --scenario"):
        own_robot(carts.Simulated, changes=["reference.waypoints_m=[[0, 0], [5, 0]]"])


class Goals:
    """`ros.goals.Goals`, of which none comes."""

    ways = ("/goal_pose",)

    def way(self):
        return None

    def initial(self):
        return None

    def close(self) -> None:
        pass


def test_it_may_wait_in_automatic_mode_for_its_first_goal():
    topics = OnTopics(None, Goals())
    with Session(SessionConfig(own_robot(carts.Simulated, model="sally"))) as session:
        topics.begin(session, SessionJobs)

        def until(loop) -> bool:
            topics.turn(loop)
            return loop.gated.now() > 4.0

        session.run(until, Mode.AUTOMATIC)
        assert session.loop.supervisor.mode == Mode.AUTOMATIC
        assert session.loop.seen.pose.x == pytest.approx(0.0, abs=0.01)
        session.end("over")
    topics.close()
