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
    points = np.vstack((BEFORE, ring))
    return surroundings(points=points), (len(BEFORE), len(points))


def planned(seen, unseen):
    pilot = Pilot(through(STRAIGHT, 0.5), SETTINGS)
    return pilot.plan(HERE, STILL, seen) if unseen is None else pilot.planner(
        pilot.task(HERE, STILL, seen, unseen)
    )  # fmt: skip


def test_a_way_over_unseen_ground_is_begun_where_there_is_no_other():
    seen, unseen = around()
    assert planned(seen, None).failed
    made = planned(seen, unseen)
    assert made.new
    assert not made.failed
    assert made.course.poses[:, 1].max() > 1.0  # past what stands, on the left


def test_a_way_over_ground_that_was_seen_is_taken_before_any_other():
    seen, unseen = around((-3.0, -1.9), (0.9, 1.8))
    with_it, without = planned(seen, unseen), planned(seen, None)
    assert with_it.new
    assert with_it.course.poses == pytest.approx(without.course.poses)


def test_what_stands_is_not_gone_through():
    """Nothing is unseen but what is: a ring of things stays one."""
    seen, unseen = around()
    assert planned(seen, (unseen[1], unseen[1])).failed
