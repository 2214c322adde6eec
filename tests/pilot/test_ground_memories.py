"""Filter and collision monitor share no code, and remember the same ground."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.scan.deskew import NO_SWEEP
from cohelm.perceive.space.assumed import ASSUMED_FREE, turning_ground
from cohelm.perceive.space.cell_window import cell, holds
from cohelm.perceive.space.observed_cells import (
    KEPT,
    assumed_free,
    extent,
    no_cells,
    with_scan,
)
from cohelm.robot.collision_monitor.free_space import CELL, CORNER, HALF, STEADY, FreeSpace
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.sweep import outline
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import sight
from tests.few import first

SALLY = robot("sally")
LONG = SALLY.model_copy(
    update={
        "footprint_m": [[1.5, 1.0], [-1.5, 1.0], [-1.5, -1.0], [1.5, -1.0]],
        "lidar": SALLY.lidar.model_copy(update={"mount_x_m": 1.4}),
    }
)
BACK = SALLY.model_copy(  # its axle far back
    update={
        "footprint_m": [[1.2, 0.4], [-0.3, 0.4], [-0.3, -0.4], [1.2, -0.4]],
        "lidar": SALLY.lidar.model_copy(update={"mount_x_m": 1.1}),
    }
)
WITHIN = 1.0  # so far beyond its turning circle the filter is told of such ground [m]
APART = range(-3, 4)
"""Cells: to the monitor the edge of a view is unknown, as wide as a cell; so it knows later what is
in view, while the robot turns."""


def along(*to):
    """Poses from each pose straight to the next, every 7 cm or 0.1 rad: it looks at each."""
    found = [Pose(0.0, 0.0, 0.0)]
    for pose in to:
        here, goal = np.array(found[-1]), np.array(pose)
        way = np.hypot(*(goal - here)[:2])
        n = math.ceil(max(way / 0.07, abs(goal[2] - here[2]) / 0.1, 1.0))
        found += [Pose(*(here + (goal - here) * k / n)) for k in range(1, n + 1)]
    return found


DRIVES = {
    "ahead, and back": along((4.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "back from where it could just see": along((2.0, 0.0, 0.0), (-1.5, 0.0, 0.0)),
    "round a corner, and back": along((2.5, 0.0, 0.0), (2.5, 0.0, 1.57), (2.5, 2.5, 1.57),
                                      (2.5, -1.0, 1.57)),
    "with its back to what it saw": along((0.0, 0.0, 3.14), (-2.5, 0.0, 3.14), (1.0, 0.0, 3.14)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("model", "drive"),
    # BACK has no such ground about it as the others when it turns round: what the edge of the view
    # passed there, as wide as a cell for the monitor, is never looked at again.
    [(SALLY, drive) for drive in DRIVES]
    + first([(LONG, drive) for drive in DRIVES])
    + first([(BACK, drive) for drive in DRIVES if not drive.startswith("with its back")]),
)
def test_ground_that_the_filter_takes_as_known_passes_the_monitor(model, drive):
    lidar, shape = model.lidar.lidar(), outline(model.outline)
    sensor = Sensor(
        lidar.mount, lidar.first + lidar.step * np.arange(len(lidar.beams)), lidar.step, 0.06,
        0.02, 10.0, 0.0, 0.0,
    )  # fmt: skip
    monitors, ranges = FreeSpace(sensor, shape, WITHIN), np.full(len(lidar.beams), math.inf)
    free = shape.reach + ASSUMED_FREE
    kept, seen, _, side = extent([lidar], shape.reach, free, 0.0)
    here = Pose(0.0, 0.0, 0.0)
    assumed = turning_ground(model.outline, [lidar])
    filters = assumed_free(no_cells(side), here, model.outline, assumed)
    wrong, psi = 0, 0.0
    for pose in DRIVES[drive]:
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        eye = Pose(pose.x + c * lidar.mount.x, pose.y + s * lidar.mount.x, pose.psi)
        scan = NO_SWEEP._replace(lidar=lidar, ranges=ranges, sensor=eye, stamp=0.0)
        filters = with_scan(filters, scan, kept, seen)
        monitors.look(ranges, pose, 0.0, 0.0)
        turns, psi = pose.psi != psi, pose.psi
        for x, y in () if turns else monitors.unknown.points:
            wrong += all(
                holds(filters.which, cell(x) + i, cell(y) + j)
                for i in APART for j in APART
            )  # fmt: skip
    assert wrong == 0


@pytest.mark.parametrize(("reach", "away"), [(0.46, 0.3), (1.6, 1.4), (2.06, 1.9), (0.46, 1.4)])
def test_the_filter_forgets_ground_before_the_monitor_does(reach, away):
    """Which moves its window once the sensor has moved by STEADY, by whole cells."""
    lidar = SALLY.lidar.lidar()._replace(mount=Pose(away, 0.0, 0.0))
    kept = extent([lidar], reach, reach + ASSUMED_FREE, 0.0).kept
    sensor = Sensor(lidar.mount, np.zeros(2), 1.0, 0.06, 0.02, 10.0, 0.0, 0.0)
    shape = outline(np.array([[reach, 0.0], [0.0, 0.2], [-reach, 0.0], [0.0, -0.2]]))
    monitors = FreeSpace(sensor, shape, WITHIN).returns - away - 3.0 * CELL
    assert kept + STEADY + 2.0 * CORNER < monitors
    assert KEPT + STEADY + 2.0 * CORNER < CELL * HALF


@given(
    st.sampled_from([SALLY, LONG, BACK]), st.floats(0.3, 2.5), st.floats(-3.1, 3.1),
    st.floats(0.0, 3.1), st.floats(0.02, 1.0),
)  # fmt: skip
def test_ground_that_a_surface_covers_for_the_monitor_is_covered_for_the_filter(
    model, away, bearing, psi, long
):
    """A wall, some of it in view where the robot is switched on."""
    x, y = away * math.cos(bearing), away * math.sin(bearing)
    c, s = long * math.cos(psi), long * math.sin(psi)
    wall, here = np.array([[x - c, y - s, x + c, y + s]]), Pose(0.0, 0.0, 0.0)
    eyes, shape = Perception(model), outline(model.outline)
    ranges = np.empty(len(eyes.lidar.beams))
    sight(here, eyes.lidar, np.empty((0, 6)), wall, NO_GRID, ranges)
    eyes.take(0.0, Readings(Odometry(0.0, here, Twist(0.0, 0.0)), Scan(0.0, 0, ranges, 0.0)))
    bearings = eyes.lidar.first + eyes.lidar.step * np.arange(len(ranges))
    monitors = FreeSpace(
        Sensor(eyes.lidar.mount, bearings, eyes.lidar.step, 0.06, eyes.lidar.noise, 10.0, 0.0, 0.0),
        shape, WITHIN,
    )  # fmt: skip
    unknown = monitors.look(ranges, here, 0.0, 0.0)
    which = eyes._unobserved_space._cells.which
    for x, y in unknown.points:
        assert not all(holds(which, cell(x) + i, cell(y) + j) for i in APART for j in APART)
