"""A drive becomes a map: near the truth, with loops closed, on a grid that shows the walls."""

import math

import numpy as np
import pytest
import shapely

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.perceive.graph import Link, solved
from cohelm.perceive.raster import raster
from cohelm.perceive.survey import Survey, glimpses
from cohelm.robot.port import Odometry, Scan
from tests.perceive.drives import CONES, LIDAR, TOUR, WALLS, along, drive

HOME = [(-0.5, -1.75), (-0.6, -0.5), (-0.5, 0.8), (0.0, 2.5)]


def recorded(path, seed=0, **more):
    """Odometry, scans, and the true pose at any time of a drive."""
    odometry, scans, truth = [], {}, {}
    for moment in drive(*path, seed, **more):
        odometry.append(moment.readings.odometry)
        truth[round(moment.now, 2)] = moment.truth
        scan = moment.readings.scan
        if scan is not None:
            scans[scan.number] = scan
    return odometry, list(scans.values()), truth


def errors(found, true):
    """Distances after the best rigid fit (ATE), headings after it [m, rad]."""
    a, b = np.array(found), np.array(true)
    ma, mb = a[:, :2].mean(axis=0), b[:, :2].mean(axis=0)
    u, _, v = np.linalg.svd((a[:, :2] - ma).T @ (b[:, :2] - mb))
    turn = v.T @ np.diag([1.0, np.linalg.det(v.T @ u.T)]) @ u.T
    off = (a[:, :2] - ma) @ turn.T + mb - b[:, :2]
    angle = math.atan2(turn[1, 0], turn[0, 0])
    heading = (a[:, 2] + angle - b[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.hypot(*off.T), heading, (turn, mb - turn @ ma)


@pytest.fixture(scope="module")
def tour():
    odometry, scans, truth = recorded(along(TOUR + HOME))
    seen = glimpses(LIDAR.lidar(), odometry, scans)
    survey = Survey(LIDAR.lidar())
    for glimpse in seen:
        survey.add(glimpse)
    return survey.finished(), seen, [truth[round(g.stamp, 2)] for g in seen]


def test_the_trajectory_in_the_lab_is_true_within_centimetres(tour):
    made, seen, truth = tour
    off, heading, _ = errors(made.poses, truth)
    assert np.sqrt((off**2).mean()) < 0.03
    assert np.abs(heading).max() < math.radians(0.6)
    drifted, _, _ = errors([g.odometry for g in seen], truth)
    assert np.sqrt((off**2).mean()) < 0.2 * np.sqrt((drifted**2).mean())


def test_coming_home_closes_loops_with_the_beginning(tour):
    made, _, _ = tour
    assert any(a < 50 and b > len(made.poses) - 150 for a, b in made.loops)


def test_occupied_cells_lie_on_true_walls_and_every_wall_has_some(tour):
    made, seen, truth = tour
    _, _, (turn, shift) = errors(made.poses, truth)
    drawn = raster(made.poses, [g.points for g in seen], LIDAR.lidar().mount, 0.05)
    cells = np.argwhere(drawn.occupied())[:, ::-1] + 0.5
    world = (cells * 0.05 + drawn.origin[:2]) @ turn.T + shift
    walls = shapely.unary_union([
        *(shapely.LineString([(a, b), (c, d)]) for a, b, c, d in WALLS),
        *(shapely.Point(x, y).buffer(r).exterior for x, y, _, _, r, _ in CONES),
    ])  # fmt: skip
    off = shapely.distance(shapely.points(world), walls)
    assert np.quantile(off, 0.95) < 0.06
    assert off.max() < 0.3
    cloud = shapely.MultiPoint(world).buffer(0.1)
    seen_share = walls.intersection(cloud).length / walls.length
    assert seen_share > 0.8  # the corridor's west end is behind the robot all the time


def test_free_cells_are_where_nothing_is(tour):
    made, seen, truth = tour
    _, _, (turn, shift) = errors(made.poses, truth)
    drawn = raster(made.poses, [g.points for g in seen], LIDAR.lidar().mount, 0.1)
    cells = (np.argwhere(drawn.free())[:, ::-1] + 0.5) * 0.1 + drawn.origin[:2]
    world = cells @ turn.T + shift
    inside = shapely.union(shapely.box(-1, -4, 14, 3), shapely.box(-3.5, 3, 16.5, 5)).buffer(0.12)
    assert shapely.contains(inside, shapely.points(world)).mean() > 0.995


def test_a_robot_that_stands_makes_one_place():
    still = [Pose(3.0, -1.0, 0.0)] * 101
    odometry, scans, _ = recorded((still, [Twist(0.0, 0.0)] * 100), drift=0.0)
    survey = Survey(LIDAR.lidar())
    for glimpse in glimpses(LIDAR.lidar(), odometry, scans):
        survey.add(glimpse)
    assert len(survey.finished().places) == 1


def test_a_false_loop_is_outvoted():
    poses = [Pose(0.3 * k, 0.0, 0.0) for k in range(20)]
    firm = np.diag([1e4, 1e4, 1e5])
    steps = [Link(k, k + 1, Pose(0.3, 0.0, 0.0), firm, False) for k in range(19)]
    wrong = Link(2, 17, Pose(0.0, 1.0, 0.5), firm, True)
    assert np.allclose(solved(poses, [*steps, wrong]), poses, atol=0.05)


def test_a_loop_corrects_what_has_drifted():
    true = [Pose(math.cos(a), math.sin(a), a + math.pi / 2) for a in np.linspace(0, 2 * np.pi, 21)]
    from cohelm.perceive.frames import between, compose

    drifted = [true[0]]
    links = []
    for k in range(20):
        step = between(true[k], true[k + 1])
        step = Pose(1.02 * step.x, step.y, step.psi + 0.01)
        drifted.append(compose(drifted[-1], step))
        links.append(Link(k, k + 1, step, np.diag([1e3, 1e3, 1e3]), False))
    links.append(Link(0, 20, between(true[0], true[20]), np.diag([1e5, 1e5, 1e5]), True))
    before = math.hypot(drifted[20].x - true[20].x, drifted[20].y - true[20].y)
    after = solved(drifted, links)[20]
    assert math.hypot(after.x - true[20].x, after.y - true[20].y) < 0.2 * before


def test_a_drive_whose_scans_and_odometry_never_meet_is_refused():
    odometry = [Odometry(0.02 * k, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)) for k in range(10)]
    scans = [Scan(100.0, 0, np.full(720, 3.0), 0.0)]
    with pytest.raises(CohelmError, match="no scan came while there was odometry"):
        glimpses(LIDAR.lidar(), odometry, scans)


def test_nothing_but_open_space_can_not_be_mapped():
    with pytest.raises(CohelmError, match="nothing to map"):
        Survey(LIDAR.lidar()).finished()
