"""Over DDS: glass that a sonar sees, a bumper that is pressed, a drop that a Create 3 tells of."""

from __future__ import annotations

import time

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__Point32 as Point32,
    geometry_msgs__msg__Polygon as Polygon,
    geometry_msgs__msg__PolygonStamped as PolygonStamped,
)

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from cohelm.record.ros2 import header
from cohelm.ros.mismatch import POLYGON
from cohelm.ros.port import LATCHED
from tests.ros.stage import stage, until

pytestmark = [pytest.mark.xdist_group("realtime"), pytest.mark.slow]
FRONT = 0.36
"""From Sally's origin to her bow [m]."""


def said(made, words: str) -> bool:
    return until(lambda: any(words in one for one in list(made.filter.said)), 5.0)


def test_it_stops_before_a_wall_that_only_a_sonar_sees():
    """It crawls: its LiDAR has shown nothing at all."""
    near = np.array([[-60, -3, 1.2, -3], [1.2, -3, 1.2, 3], [1.2, 3, -60, 3]], np.float64)
    with stage(near, robot="touching", begins="glass") as made:
        assert made.drives(0.1)
        assert made.stands(30.0)
        assert 0.5 < made.base.truth().pose.x + FRONT < 1.2
        assert said(made, "limited by an obstacle 0."), made.filter.said


@pytest.mark.parametrize(
    ("fault", "words"),
    [("bump", "the front bumper is pressed"), ("drop", "the left cliff sensor sees no floor")],
)
def test_driven_against_it_latches_and_after_a_reset_only_backs(fault, words):
    with stage(robot="touching") as made:
        assert made.drives(0.4)
        made.base.fault(fault)
        assert made.stands(2.0)
        assert made.filter.latched
        assert said(made, words)
        made.filter.node._resets.request(time.monotonic())
        assert until(lambda: not made.filter.latched, 5.0)
        where = made.base.truth().pose.x
        time.sleep(1.0)
        assert made.base.truth().pose.x == pytest.approx(where, abs=0.005)  # still asked for 0.4
        assert made.drives(-0.2)
        assert until(lambda: made.base.truth().pose.x < where - 0.1)


def test_without_bumper_messages_it_stands_and_names_the_bumper():
    with stage(robot="touching") as made:
        assert made.drives(0.4)
        made.base.fault("no bumper")
        assert made.stands()
        assert said(made, "no message from the front bumper")
        made.base.fault("")
        assert made.drives(0.3)


def box(front: float, frame: str = "base_link"):
    corners = [(front, 0.26), (-0.36, 0.26), (-0.36, -0.26), (front, -0.26)]
    return PolygonStamped(header(0, frame), Polygon([Point32(x, y, 0.0) for x, y in corners]))


def test_a_footprint_that_grows_while_it_drives_counts_at_once_and_bad_ones_stop_it():
    with stage(footprint="/footprint") as made:
        told = made.theirs.publish("/footprint", POLYGON, LATCHED)
        assert made.drives(0.4)
        assert until(lambda: made.base.truth().pose.x > 1.0)
        told.send(box(0.66))
        assert until(lambda: made.filter.node._shape._next[:, 0].max() > 0.6, 3.0)
        assert until(lambda: made.filter.node._shape._now is made.filter.node._shape._next, 3.0)
        assert made.speed() > 0.2  # it fits, and so it drives on
        assert made.stands(20.0)
        assert 4.0 - 0.3 < made.base.truth().pose.x + 0.66 < 4.0
        told.send(box(0.36))
        assert until(lambda: made.speed() > 0.05)  # on, with the small one
        assert made.stands(20.0)
        assert 4.0 - 0.3 < made.base.truth().pose.x + 0.36 < 4.0
        told.send(box(0.36, "odom"))
        assert said(made, "it is in the frame 'odom', and an outline is in that of the base")
        assert made.filter.latched


def test_one_that_grows_into_a_wall_stops_it():
    with stage(footprint="/footprint") as made:
        told = made.theirs.publish("/footprint", POLYGON, LATCHED)
        assert made.drives(0.4)
        assert until(lambda: made.base.truth().pose.x > 3.2)
        told.send(box(0.82))  # 2 cm into it
        assert said(made, "outline change: both outlines apply until the new one fits")
        assert made.stands(5.0)
        assert made.base.truth().pose.x + 0.36 < 3.8
        assert not made.filter.latched
        told.send(box(0.36))
        assert made.drives(-0.2)
