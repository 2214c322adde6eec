"""Which ground counts as looked at, held against asking beam by beam."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cohelm.core.types import Pose, Twist
from cohelm.robot.collision_monitor.free_space import (
    CELL,
    CORNER,
    HALF,
    STEADY,
    TURNED,
    FreeSpace,
    unknown_to_all,
)
from cohelm.robot.collision_monitor.odometry import PoseHistory
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.collision_monitor.source import MonitorSource
from cohelm.robot.collision_monitor.surroundings import BESIDE, NOTHING
from cohelm.robot.collision_monitor.sweep import outline
from cohelm.robot.collision_monitor.switched_on import VOUCHED
from cohelm.robot.port import Readings, Scan

BOX = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
SHAPE = outline(BOX)
WITHIN = 0.6
BEAMS = 720
HERE = Pose(0.0, 0.0, 0.0)


def sensor(view_deg=270.0, mount=Pose(0.3, 0.0, 0.0), beams=BEAMS):  # noqa: B008, a value
    step = math.radians(view_deg) / (beams - 1)
    bearings = step * (np.arange(beams) - 0.5 * (beams - 1))
    return Sensor(mount, bearings, step, 0.06, 0.02, 10.0, 0.0, 0.0)


def empty():
    return np.full(BEAMS, math.inf)


def of_discs(discs, s, pose):
    """What it measures among discs (x, y, radius): in closed form."""
    c, sn = math.cos(pose.psi), math.sin(pose.psi)
    x, y = pose.x + c * s.mount.x - sn * s.mount.y, pose.y + sn * s.mount.x + c * s.mount.y
    angles = pose.psi + s.mount.psi + s.bearings
    ranges = empty()
    for disc_x, disc_y, radius in discs:
        along = (disc_x - x) * np.cos(angles) + (disc_y - y) * np.sin(angles)
        aside = (disc_y - y) * np.cos(angles) - (disc_x - x) * np.sin(angles)
        hit = (np.abs(aside) < radius) & (along > 0.0)
        near = along - np.sqrt(np.maximum(radius**2 - aside**2, 0.0))
        ranges = np.where(hit, np.minimum(ranges, near), ranges)
    return ranges


def polar(point, s, pose):
    """Bearing and distance of a point from the sensor."""
    c, sn = math.cos(pose.psi), math.sin(pose.psi)
    x, y = c * (point[0] - pose.x) + sn * (point[1] - pose.y), \
        c * (point[1] - pose.y) - sn * (point[0] - pose.x)  # fmt: skip
    x, y = x - s.mount.x, y - s.mount.y
    return math.remainder(math.atan2(y, x) - s.mount.psi, 2.0 * math.pi), math.hypot(x, y)


def in_view(point, s, pose, ranges, slack):
    """Whether a beam went there; with slack [m] asked generously, without it strictly."""
    bearing, far = polar(point, s, pose)
    spare = math.asin(min(abs(slack) / max(far, 1e-9), 1.0)) * (1 if slack > 0.0 else -1)
    if not s.bearings[0] - spare <= bearing <= s.bearings[-1] + spare:
        return False
    near = np.abs(s.bearings - bearing) <= max(abs(spare), s.step)
    beams = ranges[near] if near.any() else ranges[[0, -1]]
    return bool((beams.max() if slack > 0.0 else beams.min()) > far - slack)


def unknown_at(points, found):
    """Which points lie in an unknown cell."""
    points = np.asarray(points)
    if not len(found):
        return np.zeros(len(points), dtype=bool)
    return np.abs(points[:, None] - found[None]).max(axis=2).min(axis=1) <= 0.5 * CELL


def test_where_it_is_switched_on_the_ground_about_it_is_vouched_for_and_no_other_behind():
    found = FreeSpace(sensor(), SHAPE, WITHIN).look(empty(), HERE, 0.0, 3.0)
    far = np.hypot(*found.points.T)
    assert far.min() > SHAPE.reach + VOUCHED - CELL
    assert far.min() < SHAPE.reach + VOUCHED + CELL
    assert far.max() < 0.3 + 0.3 + SHAPE.reach + WITHIN + CELL
    assert (found.errors == -math.inf).all()
    assert (found.margins == CORNER).all()
    assert (found.seen == 3.0).all()
    behind = np.array([[-0.9, 0.0], [-0.8, 0.3], [-0.8, -0.3]])
    assert unknown_at(behind, found.points).all()
    seen = np.array([[0.9, 0.0], [0.3, 0.9], [-0.2, 0.9], [-0.2, -0.9]])
    assert not unknown_at(seen, found.points).any()


@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(-0.8, 0.8)),
        min_size=2, max_size=8,
    ),
    st.lists(
        st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.05, 0.3)), max_size=5
    ),
    st.sampled_from([(0.3, 0.0, 0.0), (0.1, -0.1, 0.4), (-0.2, 0.0, math.pi)]),
)  # fmt: skip
def test_ground_is_unknown_if_and_only_if_no_beam_went_there(moves, discs, mount):
    """But for a cell at its borders, where it is unknown."""
    s = sensor(mount=Pose(*mount))
    it, pose, before = FreeSpace(s, SHAPE, WITHIN), HERE, []
    unknown = NOTHING
    for forward, aside, turn in moves:
        pose = Pose(pose.x + forward, pose.y + aside, pose.psi + turn)
        ranges = of_discs(discs, s, pose)
        found = it.look(ranges, pose, 0.0, 0.0)
        unknown = unknown if found is None else found
        if found is not None:
            before.append((pose, ranges))
    angles = np.linspace(0.0, 2.0 * math.pi, 40)
    rings = [SHAPE.reach + 0.05, SHAPE.reach + 0.25, SHAPE.reach + WITHIN - 0.1]
    around = np.array([(r * math.cos(a), r * math.sin(a)) for r in rings for a in angles])
    points = around + np.array((pose.x, pose.y))
    start = before[0][0]
    for point, is_unknown in zip(points, unknown_at(points, unknown.points), strict=True):
        vouched = math.hypot(point[0] - start.x, point[1] - start.y)
        now = in_view(point, s, pose, np.full(BEAMS, math.inf), 2.0 * CELL)
        generous = [in_view(point, s, *look, 3.0 * CELL) for look in before]
        reach = [polar(point, s, look[0])[1] for look in before]
        if is_unknown:
            strict = [
                in_view(point, s, *look, -3.0 * CELL) and far < CELL * (HALF - 2)
                for look, far in zip(before[-1:], reach[-1:], strict=True)
            ]
            assert not any(strict)
            cut = any(np.isfinite(ranges[[0, -1]]).any() for _, ranges in before)
            assert vouched > SHAPE.reach + VOUCHED - 2.0 * CELL or cut
        elif not now and not any(generous):
            assert vouched < SHAPE.reach + VOUCHED + 2.0 * CELL or any(
                (np.abs(point - (p.x, p.y)) < SHAPE.reach).all() for p, _ in before
            )


def test_what_an_obstacle_occluded_is_unknown_when_it_leaves_the_view():
    """A disc to its left hides its inside; the robot drives on."""
    s = sensor()
    it = FreeSpace(s, SHAPE, WITHIN)
    discs = [(0.5, 0.75, 0.15)]
    for k in range(13):
        pose = Pose(0.1 * k, 0.0, 0.0)
        found = it.look(of_discs(discs, s, pose), pose, 0.0, 0.0)
    hidden = np.array([[0.5, 0.75], [0.55, 0.8]])
    seen = np.array([[0.5, 0.45], [0.75, 0.3], [0.1, 0.4], [1.0, -0.5]])
    assert unknown_at(hidden, found.points).all()
    assert not unknown_at(seen, found.points).any()


@pytest.mark.parametrize("value", [math.nan, -math.inf, 0.0])
def test_a_beam_without_a_number_shows_nothing(value):
    it = FreeSpace(sensor(), SHAPE, WITHIN)
    it.look(np.full(BEAMS, value), HERE, 0.0, 0.0)
    turned = it.look(empty(), Pose(0.0, 0.0, math.pi), 0.0, 0.0)
    assert unknown_at(np.array([[0.9, 0.0], [0.85, 0.3]]), turned.points).all()


@pytest.mark.parametrize("start", [HERE, Pose(1.0, -2.0, 0.7)])
@pytest.mark.parametrize("along", [0, 1])
def test_a_sensor_renders_again_only_when_it_has_moved(start, along):
    def there(by, turned=0.0):
        x, y = (by, 0.0) if along == 0 else (0.0, by)
        return Pose(start.x + x, start.y + y, start.psi + turned)

    it = FreeSpace(sensor(mount=HERE), SHAPE, WITHIN)
    assert it.look(empty(), start, 0.0, 0.0) is not None
    assert it.look(empty(), there(0.9 * STEADY), 0.0, 0.1) is None
    assert it.look(empty(), there(0.0, 0.9 * TURNED), 0.0, 0.2) is None
    assert it.look(empty(), there(1.1 * STEADY), 0.0, 0.3) is not None
    assert it.look(empty(), there(1.1 * STEADY, -1.1 * TURNED), 0.0, 0.4) is not None


def from_sensor(far, bearing_deg):
    """A point of the odometry's frame, so far from the LiDAR of a robot that stands at its
    origin."""
    bearing = math.radians(bearing_deg)
    return 0.3 + far * math.cos(bearing), far * math.sin(bearing)


def test_a_short_return_occludes_the_ground_behind_it():
    """14 beams 20.8 deg apart, of which one is short."""
    coarse = sensor(beams=14)
    ranges = np.full(14, math.inf)
    ranges[5] = 0.3
    short = math.degrees(coarse.bearings[5])
    it = FreeSpace(coarse, SHAPE, WITHIN)
    it.look(ranges, HERE, 0.0, 0.0)
    round_ = it.look(np.full(14, math.nan), Pose(0.0, 0.0, math.pi), 0.0, 0.0)
    hidden = [from_sensor(0.6, short + off) for off in (-7.0, 0.0, 7.0)]
    seen = [from_sensor(0.6, short + off) for off in (-14.0, 14.0)]
    assert unknown_at(np.array(hidden), round_.points).all()
    assert not unknown_at(np.array(seen), round_.points).any()


@pytest.mark.parametrize(("beam", "side"), [(0, -1.0), (13, 1.0)])
def test_an_outermost_beam_that_is_short_hides_the_ground_behind_it_too(beam, side):
    def unknown(ranges):
        it = FreeSpace(sensor(beams=14), SHAPE, WITHIN)
        it.look(ranges, HERE, 0.0, 0.0)
        aside = it.look(np.full(14, math.nan), Pose(0.0, 0.0, -0.9 * side), 0.0, 0.0)
        return unknown_at(np.array([from_sensor(1.1, 128.5 * side)]), aside.points)

    short = np.full(14, math.inf)
    short[beam] = 0.3
    assert not unknown(np.full(14, math.inf)).any()
    assert unknown(short).all()


def test_ground_is_observed_up_to_the_return_and_where_the_sensor_stands():
    it = FreeSpace(sensor(), SHAPE, WITHIN)
    it.look(np.full(BEAMS, 0.6), HERE, 0.0, 0.0)
    round_ = it.look(np.full(BEAMS, math.nan), Pose(0.0, 0.0, math.pi), 0.0, 0.0)
    seen = [from_sensor(far, b) for far in (0.56, 0.6) for b in (-15.0, 0.0, 15.0)]
    hidden = [from_sensor(0.7, b) for b in (-15.0, 0.0, 15.0)]
    assert not unknown_at(np.array(seen), round_.points).any()
    assert unknown_at(np.array(hidden), round_.points).all()


@pytest.mark.parametrize("turned", [0.0, 0.8, -0.8])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_view_ends_at_its_outer_beams_less_half_of_what_the_scan_turned(turned, side):
    coarse = sensor(beams=28)  # 10 deg apart
    found = FreeSpace(coarse, SHAPE, WITHIN).look(np.full(28, math.inf), HERE, turned, 0.0)
    end = 135.0 - math.degrees(0.5 * abs(turned))
    inside, beyond = (from_sensor(1.2, side * (end + off)) for off in (-7.0, 3.0))
    assert not unknown_at(np.array([inside]), found.points).any()
    assert unknown_at(np.array([beyond]), found.points).all()


@pytest.mark.parametrize("psi", [-3.1, -2.0, -1.0, 1.0, 2.0, 3.1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_wherever_the_robot_heads_the_view_is_as_wide(psi, side):
    c, s = math.cos(psi), math.sin(psi)
    found = FreeSpace(sensor(), SHAPE, WITHIN).look(empty(), Pose(0.0, 0.0, psi), 0.0, 0.0)
    inside, beyond = (
        np.array([[c * x - s * y, s * x + c * y]])
        for x, y in (from_sensor(1.2, side * 128.0), from_sensor(1.2, side * 138.0))
    )
    assert not unknown_at(inside, found.points).any()
    assert unknown_at(beyond, found.points).all()


def test_ground_seen_at_the_edge_of_the_window_is_known_on_arrival():
    """Backwards, without a beam that looks."""
    it = FreeSpace(sensor(mount=HERE), SHAPE, WITHIN)
    it.look(empty(), HERE, 0.0, 0.0)
    for k in range(1, 20):
        back = it.look(np.full(BEAMS, math.nan), Pose(0.1 * k, 0.0, math.pi), 0.0, 0.0)
    edge = CELL * HALF
    assert not unknown_at(np.array([[edge, 0.0], [edge - CELL, 0.0]]), back.points).any()
    assert unknown_at(np.array([[edge + CELL, 0.0]]), back.points).all()


def test_ground_the_robot_stood_on_is_known():
    it = FreeSpace(sensor(), SHAPE, WITHIN)
    nothing = np.full(BEAMS, math.nan)
    for k in range(20):
        found = it.look(nothing, Pose(-0.1 * k, 0.0, 0.0), 0.0, 0.0)
    driven = np.array([[x, y] for x in (-1.5, -1.7, -1.9) for y in (-0.2, 0.0, 0.2)])
    assert not unknown_at(driven, found.points).any()
    assert unknown_at(np.array([[-2.45, 0.0], [-2.0, 0.5]]), found.points).all()


def test_farther_than_the_window_ground_is_unknown_again():
    it = FreeSpace(sensor(), SHAPE, WITHIN)
    edge = CELL * HALF
    assert edge + 3.0 * CELL <= BESIDE + 1e-9  # returns are remembered as far, from the outline on
    it.look(empty(), HERE, 0.0, 0.0)
    gone = it.look(np.full(BEAMS, math.nan), Pose(edge - 0.3, 0.0, 0.0), 0.0, 0.0)
    assert not unknown_at(np.array([[edge - 0.9, 0.0]]), gone.points).any()
    it.look(np.full(BEAMS, math.nan), Pose(3.0 * edge, 0.0, 0.0), 0.0, 0.0)
    back = it.look(np.full(BEAMS, math.nan), Pose(edge - 0.3, 0.0, 0.0), 0.0, 0.0)
    assert unknown_at(np.array([[edge - 0.9, 0.0]]), back.points).all()


def test_switched_on_anew_it_knows_what_is_vouched_for_there():
    it = FreeSpace(sensor(), SHAPE, WITHIN)
    for k in range(10):
        last = it.look(empty(), Pose(0.1 * k, 0.0, 0.0), 0.0, 0.0)
    assert len(last.points) == 0
    it.forget()
    anew = it.look(empty(), Pose(0.9, 0.0, 0.0), 0.0, 0.0)
    assert len(anew.points) > 50
    assert np.hypot(anew.points[:, 0] - 0.9, anew.points[:, 1]).min() > SHAPE.reach + VOUCHED - CELL


LONG = outline(np.array([[1.5, 1.0], [-1.5, 1.0], [-1.5, -1.0], [1.5, -1.0]]))
AHEAD = Pose(1.4, 0.0, 0.0)


def test_behind_a_robot_longer_than_the_usual_window_ground_is_unknown_too():
    it = FreeSpace(sensor(mount=AHEAD), LONG, WITHIN)
    found = it.look(empty(), HERE, 0.0, 0.0)
    for y in np.linspace(-0.9, 0.9, 19):
        back = np.array([[x, y] for x in np.arange(-1.6, -2.5, -0.5 * CELL)])
        assert unknown_at(back, found.points).any()
        assert not unknown_at(back[:4], found.points).any()  # vouched for


@pytest.mark.parametrize(
    ("shape", "mount"), [(SHAPE, Pose(1.0, 0.0, 0.0)), (LONG, AHEAD), (LONG, HERE)]
)
def test_ground_is_remembered_no_farther_than_returns(shape, mount):
    """Of a LiDAR on a boom, and of a long robot: it drives off from what it has seen, and looks
    back no more."""
    s = sensor(mount=mount)
    ground = FreeSpace(s, shape, 3.0)
    source = MonitorSource(s, True, shape, 3.0, remembers=True)
    beside = mount.x, shape.reach + 0.2
    for k in range(200):
        t, way = 0.1 * k, 0.05 * k
        poses = PoseHistory()
        poses.add(t, Pose(way, 0.0, 0.0), Twist(0.5, 0.0))
        scan = Scan(t, k, of_discs([(*beside, 0.05)], s, Pose(way, 0.0, 0.0)), 0.0)
        source.look(t, Readings(None, scan), poses, poses)
        ground.look(empty(), Pose(way, 0.0, 0.0), 0.0, 0.0)
        if unknown_at([beside], ground.unknown.points).any():
            assert math.hypot(way, shape.reach) > shape.reach + 1.0
            break
        assert len(source.by_odometry.points)
    else:
        pytest.fail("it never forgot that ground")


def test_a_long_robot_knows_its_turning_circle_wherever_it_has_driven():
    """Its LiDAR is at its front, and never looks behind it."""
    it = FreeSpace(sensor(mount=AHEAD), LONG, 0.1)
    for k in range(300):
        found = it.look(empty(), Pose(0.05 * k, 0.0, 0.0), 0.0, 0.0)
    assert not len(found.points)


def test_a_robot_whose_outline_grows_beyond_its_window_keeps_what_it_has_seen():
    it = FreeSpace(sensor(mount=AHEAD), outline(BOX), WITHIN)
    it.look(empty(), HERE, 0.0, 0.0)
    it.reshape(LONG, WITHIN)
    turned = it.look(np.full(BEAMS, math.nan), Pose(0.0, 0.0, math.pi), 0.0, 0.0)
    assert not unknown_at([[1.6, 0.0], [1.6, 0.8]], turned.points).any()
    assert unknown_at([[0.0, -1.2], [0.0, 1.2]], turned.points).all()


def test_however_far_a_robot_brakes_it_meets_unknown_ground_before_what_is_beyond_the_window():
    it = FreeSpace(sensor(mount=HERE), SHAPE, 6.0)
    it.look(empty(), Pose(0.0, 0.0, math.pi), 0.0, 0.0)
    found = it.look(np.full(BEAMS, math.nan), HERE, 0.0, 0.0)
    for angle in np.linspace(0.75 * math.pi, 1.25 * math.pi, 91):
        way = np.arange(1.0, 4.5, 0.5 * CELL)[:, None] * (math.cos(angle), math.sin(angle))
        assert unknown_at(way, found.points).any()


def test_ground_unknown_to_one_lidar_is_unknown_to_all_though_it_is_beyond_anothers_window():
    """One at either end of a long robot that drives ahead. The front one has seen what is beside
    it and behind its rear, and forgotten it; the rear one looks back."""
    shape = outline(np.array([[2.0, 0.5], [-2.0, 0.5], [-2.0, -0.5], [2.0, -0.5]]))
    mounts = Pose(1.9, 0.0, 0.0), Pose(-1.9, 0.0, math.pi)
    both = [FreeSpace(sensor(90.0, mount), shape, WITHIN) for mount in mounts]
    for k in range(160):
        for it in both:
            it.look(empty(), Pose(0.05 * k, 0.0, 0.0), 0.0, 0.0)
    beside = np.array([[7.95 - 3.6, 2.2], [7.95 - 3.6, -2.2]])
    assert both[0].beyond(np.round(beside / CELL).astype(int)).all()
    assert unknown_at(beside, unknown_to_all(both).points).all()
    assert unknown_at(beside, unknown_to_all(both[::-1]).points).all()


@settings(max_examples=40)
@given(
    st.floats(0.35, 0.9), st.floats(-0.6, 0.6), st.sampled_from([-1.0, 1.0]),
    st.sampled_from([720, 721]),  # of an odd number one looks straight ahead
)  # fmt: skip
def test_ground_beyond_a_wall_that_goes_on_out_of_view_is_not_vouched_for(away, psi, side, beams):
    """The wall is straight, and beside the robot; what lies a cell and more behind it counts."""
    nx, ny = -math.sin(psi), side * math.cos(psi)
    s = sensor(beams=beams)
    angles = s.bearings
    facing = np.cos(angles) * nx + np.sin(angles) * ny
    ranges = np.where(facing > 0.0, (away - s.mount.x * nx) / np.maximum(facing, 1e-9), math.inf)
    ranges[ranges > 10.0] = math.inf
    it = FreeSpace(s, SHAPE, WITHIN)
    unknown = it.look(ranges, HERE, 0.0, 0.0).points
    side_cells = np.arange(-0.7, 0.7, CELL)
    points = np.array([(x, y) for x in side_cells for y in side_cells])
    vouched = np.hypot(*points.T) < SHAPE.reach + VOUCHED - CELL
    hidden = np.array(
        [not in_view(p, s, HERE, np.full(beams, math.inf), 2.0 * CELL) for p in points]
    )
    outside = np.abs(points / (0.36, 0.29)).max(axis=1) > 1.0
    beyond = points @ (nx, ny) - away
    there = vouched & hidden & outside
    stands = (np.abs(BOX @ (nx, ny)).max() < away) and np.isfinite(ranges[[0, -1]]).any()
    is_unknown = unknown_at(points, unknown)
    if stands:
        assert is_unknown[there & (beyond > 2.0 * CELL)].all()
    assert not is_unknown[there & (beyond < 0.0)].any()
