"""Unobserved ground is reported out of view, and nowhere else."""

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike

from cohelm.core.frames import between, compose, inverse, placed
from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.perceive.scan.deskew import NO_SWEEP
from cohelm.perceive.space.cell_window import CELL
from cohelm.perceive.space.unobserved import UnobservedSpace
from cohelm.robot.clearance import point_gap
from cohelm.robot.model import LimitsModel
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import Lidar
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import sight
from cohelm.study.campaign.suites import equipped
from tests.few import first

SALLY = robot("sally")
WALLS = np.array([[-4.0, -3.0, 4.0, -3.0], [-4.0, 3.0, 4.0, 3.0]])


def driven(
    poses: list[Pose], discs: np.ndarray | None = None, model=SALLY,
    velocity: ArrayLike = (0.0, 0.0),
) -> Seen:  # fmt: skip
    """What is known after a scan from each pose, 0.1 s apart; discs go with a velocity."""
    return watched(poses, discs, model, velocity)[-1]


def watched(
    poses: list[Pose], discs: np.ndarray | None = None, model=SALLY,
    velocity: ArrayLike = (0.0, 0.0),
) -> list[Seen]:  # fmt: skip
    """What is known after each of these scans."""
    eyes = Perception(model)
    seen: list[Seen] = []
    for k, pose in enumerate(poses):
        ranges = np.empty(len(eyes.lidar.beams))
        there = np.empty((0, 6)) if discs is None else discs.copy()
        there[:, :2] += 0.1 * k * np.array(velocity)
        sight(pose, eyes.lidar, there, WALLS, NO_GRID, ranges)
        readings = Readings(
            Odometry(0.1 * k, pose, Twist(0.0, 0.0)), Scan(0.1 * k, k, ranges, 0.0), None, None
        )
        seen.append(eyes.take(0.1 * k, readings))
    return seen


def ahead(way: float, speed: float = 0.05) -> list[Pose]:
    return [Pose(speed * k, 0.0, 0.0) for k in range(round(way / speed) + 1)]


def blind(seen: Seen) -> np.ndarray:
    return seen.obstacles.points[seen.unobserved]


def in_view(points: np.ndarray, lidar: Lidar, pose: Pose) -> np.ndarray:
    """An independent oracle: whether the bearing of points lies in the field of view."""
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    x, y = pose.x + c * lidar.mount.x, pose.y + s * lidar.mount.x
    bearing = np.arctan2(points[:, 1] - y, points[:, 0] - x) - pose.psi
    bearing = (bearing + math.pi) % (2 * math.pi) - math.pi
    return np.abs(bearing) < math.radians(134.0)


@pytest.mark.parametrize(
    ("to", "later"),
    [
        (Pose(0.0, 0.0, 0.0), 0.1), (Pose(1.7, 0.9, 2.0), 0.1), (Pose(0.0, 0.0, 0.0), -50.0),
        (Pose(0.0, 0.0, 0.0), 3.0), (Pose(1.4, -0.3, 1.5), 3.0), (Pose(0.2, 0.0, 0.0), 3.0),
    ],
)  # fmt: skip
def test_odometry_that_jumps_or_begins_anew_moves_neither_robot_nor_what_is_behind_it(to, later):
    """The gate has stopped the robot then; after the reset it backs off by what it remembers."""
    post = np.array([[0.6, 0.45, 0.0, 0.0, 0.05, 0.0]])  # is passed by, and left behind
    eyes, start = Perception(SALLY), Pose(0.0, 0.0, 0.0)

    def look(stamp: float, number: int, at: Pose, reported: Pose) -> Seen:
        ranges = np.empty(len(eyes.lidar.beams))
        sight(at, eyes.lidar, post, WALLS, NO_GRID, ranges)
        odometry = Odometry(stamp, reported, Twist(0.0, 0.0))
        return eyes.take(stamp, Readings(odometry, Scan(stamp, number, ranges, 0.0)))

    def behind(seen: Seen) -> tuple[np.ndarray, int]:
        there = placed(seen.obstacles.points, inverse(seen.odometry))
        near = np.hypot(there[:, 0] + 0.75, there[:, 1] - 0.45) < 0.15
        return there[near], len(blind(seen))

    stamp, at = 100.0, start
    for k in range(28):
        stamp, at = 100.0 + 0.1 * k, Pose(0.05 * k, 0.0, 0.0)
        seen = look(stamp, k, at, at)
    before, unobserved = behind(seen)
    assert len(before) > 2
    assert not unobserved
    for k in range(3):
        moved = Pose(at.x + 0.01 * k, at.y, at.psi)
        seen = look(stamp + later + 0.1 * k, 28 + k, moved, compose(to, between(at, moved)))
        after, unobserved = behind(seen)
        assert len(after) == len(before)
        assert after == pytest.approx(before - [0.01 * k, 0.0], abs=0.006)
        assert not unobserved
        reported = compose(to, between(at, moved))
        assert compose(seen.odom_received, reported) == pytest.approx(seen.odometry, abs=1e-9)
    assert seen.pose == pytest.approx((at.x + 0.02, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("stamp", "duration"), first([(20.0, math.nan), (4.0, 0.0), (20.0, math.inf)], 2)
)
def test_a_scan_from_nobody_knows_where_changes_nothing_that_is_remembered(stamp, duration):
    """Its time is no number, or from before all odometry that is kept."""
    eyes, at = Perception(SALLY), Pose(0.0, 0.0, 0.0)
    post = np.array([[0.6, 0.45, 0.0, 0.0, 0.05, 0.0]])
    ranges = np.empty(len(eyes.lidar.beams))
    for k in range(1001):
        at = Pose(min(0.005 * k, 1.2), 0.0, 0.0)
        scan = None
        if k % 5 == 0:
            sight(at, eyes.lidar, post, WALLS, NO_GRID, ranges)
            scan = Scan(0.02 * k, k, ranges.copy(), 0.0)
        odometry = Odometry(0.02 * k, at, Twist(0.0, 0.0))
        before = eyes.take(0.02 * k, Readings(odometry, scan))
    sight(Pose(0.6, 0.0, 0.0), eyes.lidar, post, WALLS, NO_GRID, ranges)
    after = eyes.take(20.0, Readings(odometry, Scan(stamp, 2000, ranges, duration)))
    assert np.array_equal(after.obstacles.points, before.obstacles.points)


def test_a_robot_that_was_switched_on_may_turn_but_not_back_away():
    points = blind(driven([Pose(0.0, 0.0, 0.0)]))
    assert len(points)
    assert not in_view(points, SALLY.lidar.lidar(), Pose(0.0, 0.0, 0.0)).any()
    away = np.hypot(*points.T)
    assert away.min() > SALLY.reach + 0.15
    behind = points[np.abs(points[:, 1]) < 0.3]
    assert behind[:, 0].max() == pytest.approx(-(SALLY.reach + 0.2), abs=0.1)
    gaps = np.sort(behind[:, 1])
    assert np.diff(gaps).max() <= 0.051  # no gap that a post would fit through


def test_it_may_back_over_ground_that_it_has_driven_over_or_seen():
    start = blind(driven([Pose(0.0, 0.0, 0.0)]))
    later = blind(driven(ahead(2.0)))
    lane = np.abs(later[:, 1]) < 0.29
    assert not len(later) or 2.0 - later[lane, 0].max(initial=-9.0) > 1.4
    assert len(start) > 0


def test_a_turn_on_the_spot_shows_all_that_is_around():
    turns = [Pose(0.0, 0.0, 0.1 * k) for k in range(64)]
    points = blind(driven(turns))
    assert not len(points)


LONG = SALLY.model_copy(
    update={
        "footprint_m": [[1.5, 1.0], [-1.5, 1.0], [-1.5, -1.0], [1.5, -1.0]],
        "track_m": 1.6,
        "lidar": SALLY.lidar.model_copy(update={"mount_x_m": 1.4}),
    }
)
"""Its rear is farther from its LiDAR than the memory of a smaller robot reaches."""


def test_a_long_robot_that_was_switched_on_may_turn_but_not_back_away():
    points = blind(driven([Pose(0.0, 0.0, 0.0)], model=LONG))
    away = np.hypot(*points.T)
    assert away.min() == pytest.approx(LONG.reach + 0.2, abs=0.1)
    behind = np.sort(points[points[:, 0] < -1.6, 1])
    assert np.diff(behind).max() <= 0.051
    assert behind[0] < -1.0 < 1.0 < behind[-1]


def test_a_long_robot_may_turn_and_back_over_ground_that_it_has_driven_over_or_seen():
    later = blind(driven(ahead(7.0, 0.1), model=LONG))
    away = np.hypot(*(later - (7.0, 0.0)).T)
    assert away.min(initial=9.0) > LONG.reach + 0.9


@pytest.mark.parametrize("mount", first([1.4, 0.0]))
@pytest.mark.parametrize("gap", [0.1, 0.5, 1.0, 1.3])
def test_what_appears_before_a_long_robot_may_move_as_before_a_small_one(gap, mount):
    """A leg, from behind a pillar say, wherever the LiDAR is."""
    lidar = LONG.lidar.model_copy(update={"mount_x_m": mount})
    eyes = Perception(LONG.model_copy(update={"lidar": lidar}))
    leg = np.array([[1.5 + gap + 0.05, 0.2, 0.0, 0.0, 0.05, 0.5]])
    here, ranges = Pose(0.0, 0.0, 0.0), np.empty(len(eyes.lidar.beams))
    for k in range(16):
        sight(here, eyes.lidar, leg if k == 15 else np.empty((0, 6)), WALLS, NO_GRID, ranges)
        odometry = Odometry(0.1 * k, here, Twist(0.0, 0.0))
        seen = eyes.take(0.1 * k, Readings(odometry, Scan(0.1 * k, k, ranges, 0.0)))
        assert len(seen.obstacles.discs) == 0 or k == 15
    assert np.hypot(*(seen.obstacles.discs[:, :2] - leg[0, :2]).T).min() < 0.1


def test_a_long_robot_of_which_a_load_is_taken_off_or_put_on_keeps_what_it_has_seen():
    eyes, ranges = Perception(SALLY), np.full(len(SALLY.lidar.lidar().beams), math.inf)

    def look(k: int, at: Pose) -> np.ndarray:
        odometry = Odometry(0.1 * k, at, Twist(0.0, 0.0))
        return blind(eyes.take(0.1 * k, Readings(odometry, Scan(0.1 * k, k, ranges, 0.0))))

    for k in range(63):
        assert len(look(k, Pose(0.0, 0.0, 0.1 * k))) == 0 or k < 60
    for k, outline in enumerate((LONG.outline, SALLY.outline, LONG.outline), 63):
        eyes.reshape(outline)
        away = np.hypot(*look(k, Pose(0.0, 0.0, 0.0)).T)
        assert away.min(initial=9.0) > 2.4  # as far as a turn shows


@pytest.mark.parametrize(("speed", "brakes"), [(1.0, 2.0), (2.0, 1.0), (3.0, 0.5)])
def test_ground_that_nothing_has_seen_is_reported_as_far_as_the_robot_needs_to_stop(speed, brakes):
    limits = LimitsModel(
        speed_mps=speed, acceleration_mps2=brakes, yaw_rate_radps=1.0, yaw_acceleration_radps2=9.0
    )
    lidar = SALLY.lidar.model_copy(update={"mount_x_m": -0.3})  # looks ahead from its rear
    fast = SALLY.model_copy(update={"limits": limits, "lidar": lidar})
    needs = speed * 0.1 + speed**2 / (2.0 * brakes)
    memory = 2.7 + 0.3 - 0.36  # behind the rear: of what it drove over
    back = [Pose(6.0 - 0.1 * k, 0.0, 0.0) for k in range(20)]
    for pose, seen in zip(back, watched([*ahead(6.0, 0.1), *back], model=fast)[61:], strict=True):
        lane = blind(seen)[np.abs(blind(seen)[:, 1]) < 0.2, 0]
        if len(lane):
            assert pose.x - 0.36 - lane.max() > min(needs, memory) - 0.15
            return
    pytest.fail("it is not reported")


def test_what_stands_in_the_ground_that_was_seen_hides_no_hole_in_it():
    """A post that was passed: the ground around it was seen, so only the post is reported."""
    post = np.array([[0.8, 0.7, 0.0, 0.0, 0.05, 0.5]])
    seen = driven(ahead(2.5), post)
    near = np.hypot(*(blind(seen) - (0.8, 0.7)).T) < 0.3
    assert not near.any()
    standing = seen.obstacles.points[: seen.unobserved.start]
    assert (np.hypot(*(standing - (0.8, 0.7)).T) < 0.06).any()


WALKER = np.array([[1.5, 0.75, 0.0, 0.0, 0.25, 0.7]])
"""Walks back along the robot's left side; gone from view at x = -0.4 m or so."""


def standing(n: int) -> list[Pose]:
    """Turned once round, to have seen all there is, and then n scans of standing."""
    return [Pose(0.0, 0.0, 0.1 * k) for k in range(63)] + [Pose(0.0, 0.0, 0.0)] * n


@pytest.mark.parametrize("speed", first([0.8, 0.4, 1.2]))
def test_a_mover_that_goes_behind_the_robot_may_be_anywhere_there(speed: float):
    gone = round((1.9 / speed + 3.0) / 0.1)  # 3 s are enough to have come back from anywhere
    start = WALKER.copy()
    start[0, 0] += 6.3 * speed
    points = blind(driven(standing(gone), start, velocity=(-speed, 0.0)))
    assert not in_view(points, SALLY.lidar.lidar(), Pose(0.0, 0.0, 0.0)).any()
    beside = [point_gap(SALLY.outline, x, y) for x, y in points.tolist()]
    assert 0.03 <= min(beside) < 0.08  # the whole way round it, and nothing in it
    later = blind(driven(standing(gone + 120), start, velocity=(-speed, 0.0)))
    assert not len(later)


def test_a_mover_that_has_just_gone_behind_the_robot_is_not_everywhere_there_at_once():
    """It has to walk there first, so the other side of the robot is still free."""
    start = WALKER.copy()
    start[0, 0] += 6.3 * 1.2
    points = blind(driven(standing(18), start, velocity=(-1.2, 0.0)))
    assert len(points)
    assert (points[:, 1] > -0.2).all()


def test_a_mover_behind_the_robot_is_not_beside_it_before_it_can_have_turned_back():
    """At 1.2 m/s, with 1 m/s^2 at most, it is 0.9 m behind the robot's middle at least when it
    has been out of view for 0.8 s."""
    start = WALKER.copy()
    start[0, 0] += 6.3 * 1.2
    left = round((1.9 / 1.2 + 0.8) / 0.1)
    points = blind(driven(standing(left), start, velocity=(-1.2, 0.0)))
    assert len(points)
    assert points[:, 0].max() < -0.5


@pytest.mark.parametrize("rate", [10.0, 7.0, 40.0])
def test_however_often_it_is_scanned_a_mover_out_of_view_spreads_at_its_speed(rate: float):
    """In all directions: no slower than that, and no faster than by an eighth; to a cell and a
    half."""
    lidar, ranges, speed = SALLY.lidar.lidar(), np.full(720, math.inf), 1.3
    space, sweep = UnobservedSpace(SALLY.outline, [lidar], 0.3), NO_SWEEP._replace(stamp=-1.0)
    for psi in (2.1, -2.1, 0.0):  # to have seen the ground all round
        here = Pose(0.0, 0.0, psi)
        sweep = sweep._replace(
            ranges=ranges, pose=here, sensor=compose(here, lidar.mount), lidar=lidar
        )
        space.points(sweep, (sweep,), np.empty((0, 6)), speed)
    scans = round(0.4 * rate)
    for k in range(scans + 1):  # at first it is where it left the view, then it may be anywhere
        mover = np.array([[-1.2, 0.0, 0.0, 0.0, 1.1 if k else 0.2, 0.3 if k else 0.2]])
        sweep = sweep._replace(stamp=k / rate)
        space.points(sweep, (sweep,), mover, speed)
    cells = (np.mgrid[-50:51, -50:51].reshape(2, -1).T + 0.5) * CELL
    out = ~in_view(cells, lidar, here) & (cells[:, 0] < -0.5)
    found = space.possibly_occupied(here)
    may = np.array([np.abs(found - one).max(axis=1).min() < 1e-6 for one in cells])
    away = np.hypot(cells[:, 0] + 1.2, cells[:, 1])
    way = speed * scans / rate
    assert may[out & (away < 0.2 + way - 1.5 * CELL)].all()
    assert not may[away > 0.2 + 1.125 * way + 1.5 * CELL].any()


CROSSES = np.array([[-1.4, 3.0 + 0.8 * 6.3, 0.0, 0.0, 0.25, 0.7]])


def test_a_mover_that_reappears_on_the_other_side_leaves_no_possibly_occupied_ground():
    """Across behind the robot, from its left to its right, where it is seen again."""
    assert len(blind(driven(standing(45), CROSSES, velocity=(0.0, -0.8))))
    assert not len(blind(driven(standing(75), CROSSES, velocity=(0.0, -0.8))))


@pytest.mark.parametrize(
    ("place", "velocity"), [((-1.6, 0.2), (0.5, 0.0)), ((-1.6, -0.9), (0.55, 0.15))]
)
def test_an_object_where_a_mover_went_out_of_view_may_move(
    place: tuple[float, float], velocity: tuple[float, float]
):
    """Another has gone there before. No scan has seen the ground free that it walks on, which would
    prove that it moves."""
    x, y = np.array(place) - 6.0 * np.array(velocity)
    both = np.vstack((WALKER, [[x, y, 0.0, 0.0, 0.35, 0.7]]))
    turning = [Pose(0.0, 0.0, -0.128 * k) for k in range(14)]
    poses = [Pose(0.0, 0.0, 0.0)] * 60 + turning
    known = watched(poses, both, velocity=np.array([[-0.8, 0.0], velocity]))
    looks = 0
    for k in range(60, len(poses)):
        px, py = x + 0.1 * k * velocity[0], y + 0.1 * k * velocity[1]
        if in_view(np.array([[px, py]]), SALLY.lidar.lidar(), poses[k])[0]:
            looks += 1
            reported = known[k].obstacles.discs
            assert len(reported), f"nothing is reported of it at {0.1 * k:.1f} s"
            gap = np.hypot(reported[:, 0] - px, reported[:, 1] - py) - reported[:, 4]
            assert gap.min() < 0.35, f"nothing is reported of it at {0.1 * k:.1f} s"
    assert looks >= 4


@pytest.mark.parametrize("turn", first([0.5, 0.3, 0.7]))
def test_a_wall_at_the_edge_of_the_view_does_not_keep_ground_possibly_occupied_for_ever(
    turn: float,
):
    """A mover goes behind the robot; then the robot turns, and an unknown wall comes into view
    there. When the mover is forgotten, the ground is no longer possibly occupied."""
    wall = np.array([[-1.3 + 0.1 * k, -1.0, 0.0, 0.0, 0.06, 0.1] for k in range(15)])
    both = np.vstack((WALKER, wall))
    velocity = np.vstack(([[-0.8, 0.0]], np.zeros((15, 2))))
    turning = [Pose(0.0, 0.0, -0.1 * k) for k in range(round(turn / 0.1) + 1)]
    poses = [Pose(0.0, 0.0, 0.0)] * 60 + turning + [turning[-1]] * 150
    assert len(blind(watched(poses, both, velocity=velocity)[-1])) == len(
        blind(watched(poses, wall)[-1])
    )


def test_what_stood_there_before_stands_when_it_is_seen_again():
    """A post behind the robot, and a mover that went that way: after a turn only the mover may
    move."""
    post = np.array([[-0.9, -0.9, 0.0, 0.0, 0.1, 0.1]])
    both = np.vstack((CROSSES, post))
    velocity = np.array([[0.0, -0.8], [0.0, 0.0]])
    turn = [Pose(0.0, 0.0, -0.1 * k) for k in range(20)]
    for seen in watched(standing(45) + turn, both, velocity=velocity)[108:]:
        away = np.hypot(*(seen.obstacles.discs[:, :2] - post[0, :2]).T)
        assert not (away < 0.15).any()


def test_of_two_movers_behind_the_robot_one_reappears_and_one_may_still_be_there():
    both = np.vstack((CROSSES, WALKER + np.array([6.3 * 0.8, 0, 0, 0, 0, 0])))
    velocity = np.array([[0.0, -0.8], [-0.8, 0.0]])
    assert len(blind(driven(standing(75), both, velocity=velocity)))


def test_a_mover_far_away_leaves_no_possibly_occupied_ground():
    start = WALKER + np.array([5.04, 1.75, 0.0, 0.0, 0.0, 0.0])
    assert not len(blind(driven(standing(40), start, velocity=(-0.8, 0.0))))


def test_a_mover_that_leaves_the_view_far_away_and_heads_here_may_be_behind_the_robot():
    start = np.array([[-2.5 - 0.2 * 6.3, 4.6 + 0.8 * 6.3, 0.0, 0.0, 0.25, 0.7]])
    assert not len(blind(driven(standing(15), start, velocity=(0.2, -0.8))))
    assert len(blind(driven(standing(60), start, velocity=(0.2, -0.8))))


def test_ground_that_is_observed_is_no_longer_possibly_occupied():
    start = WALKER + np.array([5.04, 0.0, 0.0, 0.0, 0.0, 0.0])
    turn = [Pose(0.0, 0.0, 0.1 * k) for k in range(63)]
    poses = standing(60) + turn  # it has long moved on by then
    assert not len(blind(driven(poses, start, velocity=(-0.8, 0.0))))


def test_an_all_round_lidar_leaves_no_space_unobserved():
    assert len(blind(driven(ahead(1.0), model=equipped(robot("sally"), "twin-all-round")))) == 0


def test_a_lidar_of_unknown_mount_observes_no_ground():
    assert SALLY.lidar is not None
    eyes = Perception(SALLY.lidar.lidar())
    ranges = np.full(len(eyes.lidar.beams), 3.0)
    here = Odometry(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0))
    assert len(blind(eyes.take(0.0, Readings(here, Scan(0.0, 0, ranges, 0.0))))) == 0
