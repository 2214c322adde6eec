"""Ground that nobody has seen is assumed free where a robot needs it to turn, and not where a thing
of which a part is in view may be."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.space.assumed import ASSUMED_FREE, turning_ground
from cohelm.perceive.space.cell_window import CELL, cell, holds
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import Lidar
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import sight

SALLY = robot("sally")


def model(front, rear, half, at, noise=0.0):
    """A robot with one LiDAR of 270° at x = at."""
    box = [[front, half], [-rear, half], [-rear, -half], [front, -half]]
    lidar = SALLY.lidar.model_copy(update={"mount_x_m": at, "noise_m": noise, "dropout": 0.0})
    return SALLY.model_copy(update={"footprint_m": box, "lidar": lidar})


def in_view(lidar: Lidar, x, y):
    bearing = np.arctan2(y - lidar.mount.y, x - lidar.mount.x) - lidar.mount.psi
    return np.abs((bearing + math.pi) % (2.0 * math.pi) - math.pi) <= -lidar.first


SHAPES = {
    "Sally": SALLY,
    "axle in the middle, LiDAR in front": model(0.5, 0.5, 0.3, 0.4),
    "axle far back": model(1.2, 0.3, 0.4, 1.1),
    "axle far in front": model(0.2, 1.2, 0.4, 0.1),
}


@pytest.mark.parametrize("which", SHAPES)
def test_the_ground_assumed_free_is_what_the_robot_needs_to_turn_and_look_and_no_more(which):
    """Turned in steps, it looks before each: what comes near it and was never in view."""
    robot_model = SHAPES[which]
    lidar, outline = robot_model.lidar.lidar(), robot_model.outline
    radius = turning_ground(outline, [lidar])
    side = np.arange(-1.7, 1.7, 0.02)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    rim = (np.hypot(x, y) > radius - 0.15) & (np.hypot(x, y) < robot_model.reach + 0.1)
    x, y = x[rim], y[rim]  # of what is nearer nothing is asked, nor is farther ground needed
    here = Pose(0.0, 0.0, 0.0)
    beside = np.array(
        [disc_clearance(here, outline, *at, 0.0) > 0.0 for at in zip(x, y, strict=True)]
    )
    x, y = x[beside], y[beside]
    needed = np.zeros(len(x), np.bool_)
    low, high = outline.min(axis=0) - 0.1, outline.max(axis=0) + 0.1  # no point outside is so near
    for way in (-1.0, 1.0):
        unseen = np.ones(len(x), np.bool_)
        for psi in way * np.arange(0.0, 2.0 * math.pi, 0.02):
            c, s = math.cos(psi), math.sin(psi)
            bx, by = c * x + s * y, c * y - s * x
            unseen &= ~in_view(lidar, bx, by)
            at = np.column_stack((bx, by))
            nearby = ((low < at) & (at < high)).all(axis=1)
            left = np.flatnonzero(unseen & ~needed & nearby)
            gaps = [
                disc_clearance(Pose(0.0, 0.0, psi), outline, x[k], y[k], 0.0) for k in left
            ]  # fmt: skip
            needed[left[np.array(gaps, dtype=float) < 0.1]] = True
    assert np.hypot(x, y)[needed].max() < radius
    assert radius <= robot_model.reach + ASSUMED_FREE + 1e-9


def test_a_robot_with_its_axle_far_back_assumes_less_than_its_turning_circle():
    long = SHAPES["axle far back"]
    assert turning_ground(long.outline, [long.lidar.lidar()]) < long.reach - 0.3
    for which in ("Sally", "axle far in front"):
        shape = SHAPES[which]
        assert turning_ground(shape.outline, [shape.lidar.lidar()]) == pytest.approx(
            shape.reach + ASSUMED_FREE, abs=1e-3
        )
    front, rear = (SALLY.lidar.lidar()._replace(mount=Pose(x, 0.0, psi)) for x, psi in
                   ((0.3, 0.0), (-0.3, math.pi)))  # fmt: skip
    assert turning_ground(SALLY.outline, [front, rear]) < 0.4  # the middle of its sides


def box(x, y, psi, long, wide):
    """The walls of a box, (4, 4)."""
    c, s = math.cos(psi), math.sin(psi)
    at = [(x + c * a - s * b, y + s * a + c * b) for a, b in
          ((long, wide), (-long, wide), (-long, -wide), (long, -wide))]  # fmt: skip
    return np.array([[*at[k - 1], *at[k]] for k in range(4)])


def inside(points, x, y, psi, long, wide):
    c, s = math.cos(psi), math.sin(psi)
    wx, wy = points[:, 0] - x, points[:, 1] - y
    return (np.abs(c * wx + s * wy) < long) & (np.abs(c * wy - s * wx) < wide)


def first_look(robot_model, walls, seed=0):
    """The eyes after a first scan among walls."""
    eyes = Perception(robot_model)
    ranges = np.empty(len(eyes.lidar.beams))
    sight(Pose(0.0, 0.0, 0.0), eyes.lidar, np.empty((0, 6)), walls, NO_GRID, ranges)
    near = np.isfinite(ranges)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, len(ranges)) * eyes.lidar.noise
    ranges[near] += noise[near]
    odometry = Odometry(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0))
    return eyes.take(0.0, Readings(odometry, Scan(0.0, 0, ranges, 0.0))), eyes, ranges


@given(
    st.sampled_from(["Sally", "axle in the middle, LiDAR in front", "axle far back"]),
    st.floats(0.3, 1.6), st.floats(-3.1, 3.1), st.floats(0.0, 3.1), st.floats(0.05, 1.0),
    st.floats(0.05, 0.3),
)  # fmt: skip
def test_of_a_box_that_the_edge_of_the_view_cuts_nothing_is_assumed_free(
    which, away, bearing, psi, long, wide
):
    robot_model = SHAPES[which]
    x, y = away * math.cos(bearing), away * math.sin(bearing)
    edges = box(x, y, psi, long, wide)
    t = np.linspace(0.0, 1.0, 41)[:, None]
    rim = np.concatenate([e[:2] + t * (e[2:] - e[:2]) for e in edges])
    gaps = [disc_clearance(Pose(0.0, 0.0, 0.0), robot_model.outline, *at, 0.0) for at in rim]
    lidar = robot_model.lidar.lidar()
    _, eyes, ranges = first_look(robot_model, edges)
    if min(gaps) < 0.02 or not np.isfinite(ranges[[0, -1]]).any():
        return
    cells = eyes._unobserved_space._cells
    side = np.arange(-1.5, 1.5, CELL)
    points = np.array([(a + 0.5 * CELL, b + 0.5 * CELL) for a in side for b in side])
    hidden = points[inside(points, x, y, psi, long, wide) & ~in_view(lidar, *points.T)]
    free = [holds(cells.which, cell(a), cell(b)) for a, b in hidden]
    assert not any(free)
