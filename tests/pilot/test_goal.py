"""The end of the route, when something is in its way."""

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.law.govern import CourseClock
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.replanning import Planner, Task
from cohelm.pilot.step import START
from cohelm.plan.course import course, route
from cohelm.sim.run import run
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import Body, world
from tests.pilot.drives import SALLY, SETTINGS


def ended(*bodies: Body, seconds: float):
    """The rows of a drive 4 m straight ahead."""
    setup = Setup(
        Pose(0.0, 0.0, 0.0), through([[0, 0], [2, 0], [4, 0]], 0.5), SALLY.outline, SALLY.bounds(),
        obstacles=world((list(bodies), np.empty((0, 4)))), names=("body",) * len(bodies), dt=0.02,
        duration=seconds,
    )  # fmt: skip
    return run(with_pilot(setup)).rows


def test_an_occupied_goal_is_waited_for_nearby_and_reached_when_it_is_free():
    parked = Body((4.0, 0.35, 0.0, 0.02, 0.25, 0.6))  # rolls away slowly
    rows = ended(parked, seconds=60.0)
    waits = (rows["t"] > 9.0) & (rows["t"] < 11.0)
    assert (rows["to_go"][waits] > 0.15).all()
    assert (rows["to_go"][waits] < 0.6).all()
    assert rows["arrived"][-1]
    assert rows["clearance"].min() > 0.0075


def test_beside_a_goal_that_stays_occupied_the_robot_stands():
    rows = ended(Body((4.0, 0.35, 0.0, 0.0, 0.25, 0.6)), seconds=30.0)
    assert not rows["arrived"][-1]
    late = rows[rows["t"] > 20.0]
    assert np.abs(late["applied_v"]).max() < 1e-3
    assert np.abs(late["applied_omega"]).max() < 1e-3
    assert late["to_go"].max() < 1.0


@pytest.mark.parametrize(("off", "new"), [(0.45, True), (0.05, False)])
def test_a_robot_that_was_kept_from_the_end_of_its_course_goes_there_after_all(off, new):
    """Beside its end, and looking along: the tracking law asks for nothing there."""
    line = through([[0, 0], [2, 0], [4, 0]], 0.5)
    way, followed = route(line), course(line, 0, True, SETTINGS.pace)
    state = START._replace(
        clock=CourseClock(line.duration, 0.0, 0.0), row=len(way.line) - 1, time=0.9
    )
    here = Pose(4.0, off, 0.0)
    task = Task(state, here, Twist(0.0, 0.0), surroundings(), followed, 9.0, False)
    made = Planner(way, SETTINGS)(task)
    assert made.new == new
    assert np.hypot(*(made.course.poses[-1, :2] - [4.0, 0.0])) < 0.06
