"""Another outline counts at once, and the one before until a motion is let through with both."""

import math

import numpy as np
from hypothesis import example, given, strategies as st

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.monitor import CollisionMonitor
from cohelm.robot.collision_monitor.sweep import around
from cohelm.robot.footprint import hull
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import described
from cohelm.robot.monitor import UNRESTRICTED
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot

SALLY = robot("sally")
BOW = float(SALLY.outline[:, 0].max())
STILL, AHEAD = Twist(0.0, 0.0), Twist(0.3, 0.0)
LONG = np.array([(BOW + 0.3, 0.1), (-0.3, 0.2), (-0.3, -0.2), (BOW + 0.3, -0.1)])
SHORT = np.array([(0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.25, -0.2)])


def readings(t, twist, outline, reach):
    """A wall ahead, so far from the origin."""
    lidar = SALLY.lidar.lidar()
    bearings = lidar.first + lidar.step * np.arange(SALLY.lidar.beams)
    ranges = np.full(len(bearings), math.inf)
    front = np.abs(bearings) < 0.5
    ranges[front] = (reach - lidar.mount.x) / np.cos(bearings[front])
    scan = Scan(t, round(50 * t), ranges, 0.0)
    odometry = Odometry(t, Pose(0.0, 0.0, 0.0), twist)
    return Readings(odometry, scan, outline=outline)


class Watched:
    """A monitor, period by period."""

    def __init__(self):
        self.monitor = CollisionMonitor(described(SALLY, rules(SALLY, 0.02)))
        self.t = 0.0

    def asks(self, twist, outline=None, reach=3.0, applied=STILL):
        self.t = round(self.t + 0.02, 2)
        self.monitor.observe(self.t, readings(self.t, STILL, outline, reach), applied)
        return self.monitor.restrict(self.t, twist)


def test_a_longer_outline_counts_at_once():
    it = Watched()
    assert it.asks(AHEAD, None, BOW + 0.35) == UNRESTRICTED
    assert it.asks(AHEAD, LONG, BOW + 0.35).share < 1.0
    assert it.asks(Twist(-0.05, 0.0), LONG, BOW + 0.35) == UNRESTRICTED


def test_a_shorter_one_counts_when_it_stands_or_a_motion_was_let_through():
    near = BOW + 0.02
    moving = Twist(0.1, 0.0)
    it = Watched()
    assert it.asks(AHEAD, None, near, moving).share < 1.0
    assert it.asks(AHEAD, SHORT, near, moving).share < 1.0  # both count
    assert it.asks(AHEAD, SHORT, near, moving).share < 1.0
    before = it.asks(AHEAD, SHORT, near, STILL).share  # it stands: from here on the short one
    assert before > 0.0
    free = Watched()
    free.asks(AHEAD, None, 3.0, moving)
    free.asks(AHEAD, SHORT, 3.0, moving)
    free.asks(AHEAD, SHORT, 3.0, moving)
    assert free.monitor._shape.corners is free.monitor._outline


def turned_once(corners):
    """Whether it goes round once, to the left at each corner."""
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.remainder(np.roll(angles, -1) - angles, 2.0 * math.pi)
    return (turns < math.pi).all() and math.isclose(turns.sum(), 2.0 * math.pi)


@example([(0.0, 0.0), (0.0, 1.0), (0.0, 2.0), (-0.3, 0.0)])  # went round twice: begun in an edge
@given(
    st.lists(
        st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=4, max_size=30, unique=True
    )
)
def test_the_hull_of_each_layer_is_the_same(points):
    given_points = np.array([*points, (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
    for made in (around(given_points), hull(given_points)):
        edges = np.roll(made, -1, axis=0) - made
        off = given_points[:, None] - made[None]
        left = edges[None, :, 0] * off[..., 1] - edges[None, :, 1] * off[..., 0]
        assert left.min() >= -1e-4
        assert turned_once(made)
        assert all((np.abs(given_points - corner).max(axis=1) < 1e-6).any() for corner in made)
