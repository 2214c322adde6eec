"""What is foretold of the drive back onto a course is what the robot then does."""

import numpy as np
import pytest

from cohelm.core.types import Pose, Stick, Twist
from cohelm.law.reference import through
from cohelm.pilot.pilot import NOTHING_NEAR, Pilot
from cohelm.pilot.replanning import clock_on_entry
from cohelm.pilot.rollout import roll_out
from cohelm.plan.course import course, route
from cohelm.robot.kinematics import arc
from tests.pilot.drives import DT, SETTINGS, drive

TURN = [[0.0, 0.0], [2.0, 0.0], [3.0, 0.4], [3.5, 1.5], [3.5, 3.0]]


@pytest.mark.parametrize("beside", [-0.3, 0.0, 0.3])
def test_the_robot_drives_as_predicted(beside):
    reference = through(TURN, 0.5)
    pose, twist = Pose(1.0, beside, 0.4), Twist(0.4, 0.0)
    own = course(reference, 0, True, SETTINGS.pace)
    clock = clock_on_entry(own, route(reference), 0, pose, twist)
    predicted = roll_out(own, clock, pose, twist, 2.5, SETTINGS)
    pilot = Pilot(reference, SETTINGS)
    pilot.state = pilot.state._replace(clock=clock)
    driven = []
    for k in range(400):
        d = pilot.step(k * DT, pose, twist, Stick(0.0, 0.0), NOTHING_NEAR)
        twist = d.safe
        pose = arc(pose, twist, DT)
        driven.append(pose)
    assert np.hypot(*np.diff(predicted[:, :2], axis=0).T).sum() == pytest.approx(2.5, abs=0.2)
    way = np.array(driven)
    corner = 0.46 * (way[:, 2:] - predicted[:, 2])  # how far the outline's corner is off by it
    off = np.hypot(way[:, :1] - predicted[:, 0], way[:, 1:2] - predicted[:, 1]) + np.abs(corner)
    assert off.min(axis=0).max() < 0.04


def test_a_path_that_ends_is_rolled_out_to_its_end():
    reference = through([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]], 0.5)
    own = course(reference, 0, True, SETTINGS.pace)
    pose = Pose(0.0, 0.0, 0.0)
    clock = clock_on_entry(own, route(reference), 0, pose, Twist(0.0, 0.0))
    predicted = roll_out(own, clock, pose, Twist(0.0, 0.0), 4.0, SETTINGS)
    assert 0.8 < predicted[-1, 0] < 1.1


def test_a_door_behind_an_obstacle_is_driven_through_in_the_middle():
    """Back on the route in front of the door, the robot would swing out into a post."""
    half = 0.29 + 0.08
    posts = [(3.0, half, 3.0, 5.0), (3.0, -half, 3.0, -5.0)]
    for away in (1.4, 1.6, 1.8):
        d = drive([[0, 0], [1.5, 0], [3, 0], [4.5, 0], [6, 0]], [(3.0 - away, 0.02, 0.1)], posts)
        assert d.arrived
        assert d.clearances.min() > 0.06
