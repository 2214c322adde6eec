"""Whether two scans can have been taken where the odometry says: the map is not asked."""

import math

import numpy as np
import pytest

from cohelm.core.frames import between
from cohelm.core.types import Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.keyframe import agreement, usable
from cohelm.perceive.scan.deskew import NO_SWEEP
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from tests.perceive.drives import CONES, LIDAR, WALLS

NONE = np.empty((0, 6))
HERE = Pose(4.0, 4.0, 0.0)


def seen(pose, number=0, discs=CONES, walls=WALLS, lidar=LIDAR):
    numbers = lidar.lidar()
    ranges = np.empty(len(numbers.beams))
    scan(pose, numbers, discs, walls, NO_GRID, 7, number, ranges)
    return ranges


@pytest.mark.parametrize("step", [Pose(0.0, 0.0, 0.0), Pose(0.3, 0.0, 0.0), Pose(0.2, 0.1, 0.3)])
def test_scans_from_where_the_odometry_says_do_not_contradict_each_other(step):
    there = Pose(HERE.x + step.x, HERE.y + step.y, step.psi)
    log = agreement(LIDAR.lidar(), seen(HERE), seen(there, 1), step)
    assert log > PARAMS.contradicted


def test_odometry_that_is_a_little_wrong_is_no_contradiction():
    there = Pose(HERE.x + 0.3, HERE.y, 0.0)
    said = Pose(0.3 * 1.03, 0.01, math.radians(0.3))
    log = agreement(LIDAR.lidar(), seen(HERE), seen(there, 1), said)
    assert log > PARAMS.contradicted


@pytest.mark.parametrize("by", [(2.0, 0.0), (-2.0, 0.0), (1.2, 0.0), (0.0, -2.0)])
def test_after_a_move_without_odometry_consecutive_scans_contradict_each_other(by):
    there = Pose(HERE.x + by[0], HERE.y + by[1], 0.0)
    log = agreement(LIDAR.lidar(), seen(HERE), seen(there, 1), Pose(0.0, 0.0, 0.0))
    assert log < PARAMS.contradicted
    true = agreement(LIDAR.lidar(), seen(HERE), seen(there, 1), between(HERE, there))
    assert true > log  # where it was moved to explains it


def test_along_a_corridor_without_features_nothing_contradicts():
    walls = np.array([[-50.0, -1.0, 50.0, -1.0], [-50.0, 1.0, 50.0, 1.0]])
    at, there = Pose(0.0, 0.0, 0.0), Pose(2.0, 0.0, 0.0)
    log = agreement(
        LIDAR.lidar(), seen(at, 0, NONE, walls), seen(there, 1, NONE, walls), Pose(0.0, 0.0, 0.0)
    )
    assert log > PARAMS.contradicted


@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_that_continues_where_the_scan_before_had_no_beam_is_no_contradiction(side):
    """Who turns leaves the scan's first beams, or its last, untold (`DeskewedScan.ranges`): the
    wall along which they look goes on there, much nearer than where the next beam ended."""
    walls = np.array([[-50.0, -1.0, 50.0, -1.0], [-50.0, 1.0, 50.0, 1.0]])
    half = math.radians(0.5 * LIDAR.field_of_view_deg)
    for off in np.linspace(-0.02, 0.02, 9):
        # the last beam that tells ends some 8 m along the wall
        at = Pose(0.0, 0.0, side * (half - 0.3 + off))
        turned = Pose(0.0, 0.0, -side * 0.2)
        there = Pose(0.0, 0.0, at.psi + turned.psi)
        before = seen(at, 0, NONE, walls)
        before[slice(0, 22) if side > 0 else slice(len(before) - 22, None)] = math.nan
        log = agreement(LIDAR.lidar(), before, seen(there, 1, NONE, walls), turned)
        assert log > PARAMS.contradicted


def test_an_empty_scan_contradicts_nothing_and_is_no_keyframe():
    nothing = np.full(LIDAR.beams, math.nan)
    assert agreement(LIDAR.lidar(), nothing, seen(HERE), Pose(0.0, 0.0, 0.0)) == 0.0
    assert not usable(NO_SWEEP._replace(ranges=nothing))
    assert usable(NO_SWEEP._replace(ranges=seen(HERE)))
