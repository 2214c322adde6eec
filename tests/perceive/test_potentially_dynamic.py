"""Objects that may set off are reported to the guard before their motion is proved."""

import math

import numpy as np
import pytest

from cohelm.core.frames import compose, inverse
from cohelm.core.types import RADIUS, VX, VY, Pose, Twist, X, Y, disc, discs
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.scan.deskew import NO_SWEEP
from cohelm.perceive.space.free_space_memory import NEAR, appeared, empty_memory, with_scan
from cohelm.perceive.track.params import PotentiallyDynamicParams
from cohelm.perceive.track.potentially_dynamic import discs_of_points, grown
from cohelm.scenario import load
from tests.perceive.drives import CONES, LIDAR, TOUR, WALLS, along, drive

SALLY = load.robot("sally").model_copy(update={"lidar": LIDAR})
HERE = Pose(3.0, -1.0, 0.0)


@pytest.fixture(scope="module")
def lab():
    return map_from_geometry(WALLS, HERE, CONES[:, [X, Y, RADIUS]])


def posed(ranges, sensor, stamp):
    """A sweep of a LiDAR at a pose."""
    return NO_SWEEP._replace(ranges=ranges, sensor=sensor, stamp=stamp, lidar=LIDAR.lidar())


def standing(seconds, pose=HERE):
    n = round(seconds / 0.02)
    return [pose] * (n + 1), [Twist(0.0, 0.0)] * n


def watch(path, around, known=None, start=HERE):
    """Moment and Seen, scan by scan; with `known`, from this place on its map."""
    perception = Perception(SALLY, known, start if known else None)
    for moment in drive(*path, 0, around=around):
        seen = perception.take(moment.now, moment.readings)
        if moment.scanned:
            yield moment, seen


def reached(moment, seen, x, y, radius, after=0.3):
    """How far a disc's nearest point to the robot is beyond the reported ones, `after` on."""
    frame = compose(moment.truth, inverse(seen.pose))
    c, s = math.cos(frame.psi), math.sin(frame.psi)
    away = math.hypot(x - HERE.x, y - HERE.y)
    px, py = x + radius * (HERE.x - x) / away, y + radius * (HERE.y - y) / away
    d = seen.obstacles.discs
    at = d[:, :2] + after * d[:, 2:4]
    wx, wy = frame.x + c * at[:, 0] - s * at[:, 1], frame.y + s * at[:, 0] + c * at[:, 1]
    grown = d[:, RADIUS] + seen.obstacles.velocity_error * after
    grown += 0.5 * seen.obstacles.max_acceleration * after * after
    return float(np.min(np.hypot(wx - px, wy - py) - grown, initial=9.0))


@pytest.mark.parametrize("speed", [0.3, 0.8, 1.2])
def test_a_walker_on_free_ground_is_covered_at_once(speed):
    """A walker comes out from behind a pillar of the map, on which the robot knows its place."""
    pillar = disc(4.2, -0.1, 0.3)
    lab = map_from_geometry(WALLS, HERE, np.array([[4.2, -0.1, 0.3]]))

    def at(t):
        return 4.5, 0.2 - speed * (t - 0.5)

    def around(t):
        return discs(pillar, disc(*at(t), 0.25))

    checked = 0
    for moment, seen in watch(standing(0.5 + 1.6 / speed), around, lab):
        x, y = at(moment.now + 0.3)
        if -1.2 < y < -0.5:
            checked += 1
            assert reached(moment, seen, x, y, 0.25) < 0.0
    assert checked >= 4


def test_three_walkers_shoulder_to_shoulder_are_covered(lab):
    """Together they are too wide for a body. Who walks where another has just stood is told a
    moment later."""

    def around(t):
        y = -2.8 + 0.5 * t
        return discs(*(disc(4.3 + 0.04 * k, y + 0.6 * k, 0.31) for k in range(3)))

    short = []
    for moment, seen in watch(standing(3.0), around, lab):
        if moment.now < 1.0:
            continue
        for x, y, *_, radius, _ in around(moment.now + 0.3):
            if math.hypot(x - HERE.x, y - HERE.y) < 1.9:
                by = reached(moment, seen, x, y, radius)
                if by >= 0.0:
                    short.append(by)
    assert len(short) <= 2
    assert all(by < 0.12 for by in short)


def test_on_the_map_no_point_is_potentially_dynamic(lab):
    poses, twists = along(TOUR)
    reported = [
        len(seen.obstacles.discs)
        for _, seen in watch((poses[:1000], twists[:999]), CONES, lab, poses[0])
    ]
    assert len(reported) > 90
    assert sum(n > 0 for n in reported) <= 1


def test_a_stopped_mover_may_set_off_again_and_is_static_in_the_end():
    def around(t):
        return discs(disc(4.5, -2.6 + 1.0 * min(t, 1.6), 0.25))

    reported = [(m.now, s) for m, s in watch(standing(15.5), around)]
    beside = [s for t, s in reported if 5.8 < t < 9.0]
    assert beside
    for seen in beside:
        assert len(seen.obstacles.discs) > 0
        assert seen.obstacles.max_acceleration.min() >= 1.0
        assert np.hypot(seen.obstacles.discs[:, VX], seen.obstacles.discs[:, VY]).max() < 0.15
    assert len(reported[-1][1].obstacles.discs) == 0


def test_without_a_map_what_always_stood_is_not_potentially_dynamic():
    for _, seen in watch(standing(2.0), np.vstack([CONES, [disc(4.2, -1.2, 0.2)]])):
        assert len(seen.obstacles.discs) == 0


NOTHING = np.empty((0, 2))


def test_ground_keeps_what_was_free_and_when():
    lidar = LIDAR.lidar()
    n = len(lidar.beams)
    open_ = posed(np.full(n, 3.0), Pose(0.0, 0.0, 0.0), 1.0)
    walled = posed(np.full(n, 1.0), Pose(0.0, 0.0, 0.0), 5.0)
    free_space = with_scan(empty_memory(), open_, NOTHING, 1.0, NEAR)
    assert appeared(free_space, 1.5, 0.0, 0.5)
    assert not appeared(free_space, 1.5, 0.0, 1.5)
    assert not appeared(free_space, -1.5, 0.0, 0.5)
    later = with_scan(free_space, walled, NOTHING, 5.0, NEAR)
    assert appeared(later, 1.5, 0.0, 0.5)
    assert not appeared(later, 1.5, 0.0, 2.0)
    assert appeared(later, 0.5, 0.0, 2.0)
    far = with_scan(later, posed(np.full(n, 3.0), Pose(6.4, 0.0, 0.0), 6.0), NOTHING, 6.0, NEAR)
    assert not appeared(far, 1.5, 0.0, 0.5)


def test_what_stood_before_its_ground_was_seen_free_has_not_come():
    """Not even where it was seen free by looking along it; after a while it is forgotten."""
    lidar = LIDAR.lidar()
    open_ = posed(np.full(len(lidar.beams), 3.0), Pose(0.0, 0.0, 0.0), 1.0)
    wall = np.array([[1.5, 0.0]])
    short = posed(np.full(len(lidar.beams), 1.5), Pose(0.0, 0.0, 0.0), 1.0)
    free_space = empty_memory()
    for k in range(9):
        free_space = with_scan(free_space, short, wall, 1.0 + 0.1 * k, NEAR)
    free_space = with_scan(free_space, open_, NOTHING, 2.0, NEAR)
    assert not appeared(free_space, 1.5, 0.0, 0.5)
    assert not appeared(free_space, 1.55, 0.05, 0.5)
    assert appeared(free_space, 1.5, 0.2, 0.5)
    free_space = with_scan(free_space, open_, NOTHING, 12.5, NEAR)
    assert appeared(free_space, 1.5, 0.0, 2.5)


def test_a_walker_through_a_cell_has_not_stood_there():
    lidar = LIDAR.lidar()
    open_ = posed(np.full(len(lidar.beams), 3.0), Pose(0.0, 0.0, 0.0), 1.0)
    short = posed(np.full(len(lidar.beams), 1.5), Pose(0.0, 0.0, 0.0), 1.0)
    free_space = with_scan(empty_memory(), open_, NOTHING, 1.0, NEAR)
    for k in range(3):
        free_space = with_scan(free_space, short, np.array([[1.5, 0.0]]), 1.1 + 0.1 * k, NEAR)
    assert appeared(with_scan(free_space, open_, NOTHING, 2.0, NEAR), 1.5, 0.0, 0.5)


def test_a_thin_wall_that_is_driven_through_by_its_door_has_not_come():
    door = np.array([[4.2, -4.0, 4.2, -1.5], [4.2, -0.5, 4.2, 2.9]])
    path = along([[3.0, -1.0], [5.6, -1.0]])
    perception = Perception(SALLY, None, None)
    reported = 0
    for moment in drive(*path, 0, around=CONES[:0], walls=np.vstack([WALLS, door])):
        reported += len(perception.take(moment.now, moment.readings).obstacles.discs)
    assert reported == 0


def test_the_spread_of_a_disc_covers_every_velocity_and_acceleration():
    rng = np.random.default_rng(0)
    dynamic = PotentiallyDynamicParams()
    for _ in range(200):
        speed, push = rng.uniform(0.0, dynamic.fastest), rng.uniform(0.0, 1.0)
        age, after = rng.uniform(0.0, 0.3), rng.uniform(0.0, 1.0)
        more, off = grown(np.array([speed]), push, age)
        strayed = speed * (age + after) + 0.5 * push * (age + after) ** 2
        assert strayed == pytest.approx(more[0] + off[0] * after + 0.5 * push * after**2)


def test_a_point_that_has_stood_is_reported_smaller_and_slower():
    points = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 1.0]])
    found, off = discs_of_points(points, 0.1, 1.0, PotentiallyDynamicParams())
    assert found[0, RADIUS] > 2.0 * found[1, RADIUS]
    assert off == pytest.approx(
        [PotentiallyDynamicParams().fastest + 0.1, PotentiallyDynamicParams().creeping + 0.1]
    )
