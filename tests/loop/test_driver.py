"""The driver: manual mode, and the obstacles given to the planner."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cohelm.core.types import Pose, Stick, Twist, disc
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.loop.driver import Driver
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.behavior import EVADING
from cohelm.pilot.pilot import Pilot
from cohelm.plan.zones import Zoned, Zones
from tests.pilot.drives import DT, SETTINGS

HERE = Pose(0.0, 0.0, 0.0)
SEEN = Seen(
    0.0, HERE, np.eye(3), 1.0, False, "", HERE, Twist(0.0, 0.0), HERE, HERE, surroundings(),
    slice(0, 0), math.inf, np.empty((0, 6)),
)  # fmt: skip


@pytest.mark.parametrize("gently", [False, True])
def test_in_manual_mode_with_a_centred_stick_there_is_no_evasion_and_no_desired_pose(gently):
    """Not with evasion on either, as it is by default: somebody walks at the standing robot."""
    assert SETTINGS.evasion.horizon > 0.0
    driver = Driver(None, SETTINGS, 0.0, None)
    for k in range(150):
        walker = disc(2.0 - 0.8 * k * DT, 0.0, 0.25, 0.75, -0.8, 0.0)
        obstacles = surroundings([walker], [1.0])
        seen = SEEN._replace(pose=Pose(0.0, 0.0, math.pi / 2), obstacles=obstacles)
        driver.update_twist(Twist(0.0, 0.0))
        d = driver.by_hand(k * DT, seen, Stick(0.0, 0.0), gently)
        assert d.safe == (0.0, 0.0)
        assert d.behavior != EVADING
        assert np.isnan([*d.desired, d.e_p, d.tau]).all()  # it follows no path
        driver.record_applied(d.safe)


@pytest.mark.parametrize("measured", [Twist(0.5, 0.0), Twist(-0.3, 0.0), Twist(0.0, 0.9)])
def test_as_long_as_the_robot_moves_otherwise_than_commanded_the_measured_twist_counts(measured):
    """On a slope, or sliding: the guard must not take it for slower than it is."""
    driver, found = Driver(None, SETTINGS, 0.1, None), []
    for k in range(200):
        given = Twist(measured.v + 0.01 * (k % 3), measured.omega)  # it is noisy
        found.append(driver.update_twist(given) == given)
        driver.record_applied(Twist(0.0, 0.0))
    assert not any(found[:7])
    assert all(found[7:])
    for _ in range(3):
        later = driver.update_twist(Twist(0.05, 0.0))
    assert later == Twist(0.0, 0.0)


def test_the_planner_gets_unobserved_space_apart_from_obstacles_and_zones():
    stands, unseen, zones = np.ones((3, 2)), np.full((2, 2), 5.0), np.full((4, 2), 9.0)
    tasks = []
    planning = SimpleNamespace(plan=lambda now: None, offer=lambda now, task: tasks.append(task))
    route = through(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]), 0.5)
    driver = Driver(Pilot(route, SETTINGS), SETTINGS, 0.0, planning)
    driver.zones = Zoned(Zones(), SETTINGS.outline, 0.5, SETTINGS.limits)
    driver.zones.points = lambda pose: zones
    obstacles = surroundings(points=np.vstack((stands, unseen)))
    for now, blind in ((0.0, slice(3, 5)), (1.0, slice(5, 5))):
        seen = SEEN._replace(obstacles=obstacles, unobserved=blind)
        driver.follow(now, driver.with_zones(seen), Stick(0.0, 0.0))
    for task in tasks:
        assert task.obstacles.points.tolist() == np.vstack((stands, unseen, zones)).tolist()
    assert tasks[0].obstacles.points[tasks[0].unobserved].tolist() == unseen.tolist()
    assert len(tasks[1].obstacles.points[tasks[1].unobserved]) == 0


@pytest.mark.parametrize("period", [0.1, 0.2, 0.4])
def test_a_plan_is_requested_as_often_as_the_scenario_says(period):
    times = []
    planning = SimpleNamespace(plan=lambda now: None, offer=lambda now, task: not times.append(now))
    route = through(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]), 0.5)
    driver = Driver(Pilot(route, SETTINGS), SETTINGS, 0.0, planning, plan_period=period)
    for k in range(100):
        driver.follow(k * DT, SEEN, Stick(0.0, 0.0))
    assert np.diff(times) == pytest.approx(period)


def test_movers_are_evaluated_in_the_period_in_which_a_scan_comes():
    """Not up to a tenth of a second later, as it happens to be when the robot is switched on."""
    driver = Driver(Pilot(through([(0.0, 0.0), (4.0, 0.0)], 0.5), SETTINGS), SETTINGS, 0.0, None)
    assert driver.pilot is not None
    scans = 0
    for k in range(100):
        comes = k % 5 == 3
        scans += comes
        seen = SEEN._replace(obstacles=surroundings([disc(2.0, 1.0, 0.3, 0.8, -0.2, 0.0)], [1.0]))
        driver.follow(k * DT, seen._replace(scans=scans), Stick(0.0, 0.0))
        assert k < 5 or (driver.pilot.state.evasion.since == 0.0) == comes
