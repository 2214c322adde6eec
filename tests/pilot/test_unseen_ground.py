"""Where the only way leads over ground that nothing has seen, the robot goes and looks."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from tests.pilot.drives import SETTINGS

STRAIGHT = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [6.0, 0.0]]
HERE, STILL = Pose(0.5, 0.0, 0.0), Twist(0.0, 0.0)
BEFORE = np.column_stack((np.full(120, 1.8), np.linspace(-5.0, 0.8, 120)))
"""Stands across the route, and ends on its left."""


def around(*gaps):
    """What stands, and a ring of ground that nothing has seen but for bearings from, to [rad]."""
    angles = np.linspace(-math.pi, math.pi, 200)
    for low, high in gaps:
        angles = angles[(angles < low) | (angles > high)]
    ring = np.column_stack((0.5 + 1.6 * np.cos(angles), 1.6 * np.sin(angles)))
    ring = ring[ring[:, 0] < 1.7]
    return BEFORE, ring


def planned(stands, unseen):
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    obstacles = surroundings(points=np.vstack((stands, unseen)))
    border = slice(len(stands), len(obstacles.points))
    return pilot.planner(pilot.task(HERE, STILL, obstacles, border))


def all_stands(stands, unseen):
    return planned(np.vstack((stands, unseen)), np.empty((0, 2)))


def test_a_path_over_unobserved_ground_is_begun_where_there_is_no_other():
    assert all_stands(*around()).failed
    made = planned(*around())
    assert made.new
    assert not made.failed
    assert made.course.poses[:, 1].max() > 1.0  # past what stands, on the left


def test_a_path_over_observed_ground_is_preferred():
    seen = around((-3.0, -1.9), (0.9, 1.8))
    with_it, without = planned(*seen), all_stands(*seen)
    assert with_it.new
    assert with_it.course.poses == pytest.approx(without.course.poses)
