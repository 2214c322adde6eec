"""To have arrived is to have come along the route, not to stand where it ends."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.law.reference import through
from cohelm.plan.course import nearly_done, route
from cohelm.scenario import build, load
from cohelm.scenario.model import Scenario
from cohelm.sim.run import run
from cohelm.study.metrics import measure

LOOP = """
name: loop
robot: sally
reference:
  speed_mps: 0.5
  waypoints_m: [[0, 0], [1.2, 0], [2, 0.8], [2, 1.6], [1.2, 2.4], [0, 2.4], [-0.8, 1.6],
    [-0.8, 0.8], [0, 0]]
law: {filter: guard}
"""


@pytest.fixture(scope="module")
def trace():
    return run(build.setup(load.parse(LOOP, Scenario, "loop")))


def test_a_route_that_closes_on_itself_is_driven_all_round_before_it_counts_as_done(trace):
    found = measure(trace)
    assert found.reached
    assert found.path_length_m > 7.0
    assert found.duration_s > 14.0


def test_it_ends_there_and_not_after_a_second_round(trace):
    assert math.hypot(trace.rows["x"][-1], trace.rows["y"][-1]) < 0.2
    assert measure(trace).path_length_m < 10.0


def test_a_run_that_is_cut_short_has_not_arrived_however_near_the_end_of_the_route_it_began():
    short = LOOP + "simulation: {duration_s: 2.0}\n"
    found = measure(run(build.setup(load.parse(short, Scenario, "short"))))
    assert not found.reached
    assert found.duration_s == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("length", [0.05, 0.3, 1.0, 5.0, 80.0])
@pytest.mark.parametrize("near", [0.05, 0.1, 1.0])
def test_on_no_route_has_it_arrived_before_it_set_off(length, near):
    reference = through(np.array([[0.0, 0.0], [length, 0.0]]), 0.5)
    line = route(reference).line
    assert 1 <= nearly_done(line, near) <= len(line) - 1


def test_what_may_be_left_over_is_what_a_cut_corner_leaves():
    line = route(through(np.array([[0.0, 0.0], [50.0, 0.0]]), 0.5)).line
    first = nearly_done(line, 0.1)
    assert math.dist(line[first], line[-1]) == pytest.approx(2.1, abs=0.2)


def test_the_twin_goes_all_round_too():
    text = LOOP + "simulation: {plant: twin}\n"
    setup = build.setup(load.parse(text, Scenario, "loop"))
    found = measure(run(setup))
    assert found.reached
    assert found.path_length_m > 7.0
    assert setup.start == pytest.approx(Pose(0.0, 0.0, setup.start.psi))
