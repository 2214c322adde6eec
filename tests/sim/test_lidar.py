"""Every beam against brute force in NumPy; what the sensor reports; what the law gets of it."""

import json
import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, disc, discs
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID, borders, cast, grid
from cohelm.sim.lidar import scan
from cohelm.sim.operator_model import normal

EPS = 1e-9  # rounding may decide a beam that passes an edge by less than this [m]
NO_DISCS, NO_WALLS = np.empty((0, 6)), np.empty((0, 4))
MAPS = Path(__file__).parents[3] / "shared" / "data" / "maps"

coordinate = st.floats(-20.0, 20.0) | st.integers(-4, 4).map(float)
pose = st.builds(Pose, coordinate, coordinate, st.floats(-7.0, 7.0) | st.just(math.pi / 2))
some_discs = st.lists(
    st.builds(disc, coordinate, coordinate, st.floats(0.01, 3.0)), max_size=20
).map(lambda rows: discs(*rows))
wall = st.tuples(coordinate, coordinate, coordinate, coordinate).filter(
    lambda w: math.hypot(w[2] - w[0], w[3] - w[1]) > 0.01
)
some_walls = st.lists(wall, max_size=20).map(lambda rows: np.array(rows).reshape(-1, 4))
sensor = st.builds(
    LidarModel,
    beams=st.integers(1, 200),
    field_of_view_deg=st.floats(7.0, 360.0) | st.sampled_from([90.0, 180.0, 270.0, 360.0]),
    range_min_m=st.just(0.0),
    range_max_m=st.just(600.0),
    mount_x_m=st.floats(-1.0, 1.0),
    mount_y_m=st.floats(-1.0, 1.0),
    mount_yaw_deg=st.floats(-180.0, 180.0).filter(lambda yaw: not 1.5 < abs(yaw) < 3.2),  # radians?
)


def rays(at, lidar):
    """Origin (2,) and directions (n, 2) of the beams in the world frame."""
    c, s = math.cos(at.psi), math.sin(at.psi)
    origin = np.array([at.x, at.y]) + np.array([[c, -s], [s, c]]) @ lidar.mount[:2]
    bearing = at.psi + lidar.mount.psi + lidar.first + lidar.step * np.arange(len(lidar.beams))
    return origin, np.column_stack((np.cos(bearing), np.sin(bearing)))


def brute_discs(origin, beams, rows, grow):
    """Smallest root of |origin + t beam - centre| = radius for every beam and disc."""
    offset = origin - rows[:, :2]
    b = beams @ offset.T
    c = (offset**2).sum(axis=1) - (rows[:, 4] + grow) ** 2
    root = b**2 - c
    t = np.where(root >= 0.0, -b - np.sqrt(np.maximum(root, 0.0)), np.inf)
    t = np.where(c <= 0.0, 0.0, np.where(t > 0.0, t, np.inf))
    return t.min(axis=1, initial=np.inf)


def brute_walls(origin, beams, rows, grow):
    """origin + t beam = a + u (b - a), solved for every beam and wall."""
    a, e = rows[:, :2] - origin, rows[:, 2:] - rows[:, :2]
    det = beams[:, :1] * e[:, 1] - beams[:, 1:] * e[:, 0]
    with np.errstate(all="ignore"):
        t = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / det
        u = (a[:, 0] * beams[:, 1:] - a[:, 1] * beams[:, :1]) / det
        slack = grow / np.hypot(*e.T) / np.abs(det / np.hypot(*e.T))  # nearly parallel: less sure
        hit = (t >= -grow) & (u >= -slack) & (u <= 1.0 + slack)
    return np.where(hit, np.maximum(t, 0.0), np.inf).min(axis=1, initial=np.inf)


def on_a_wall(origin, rows):
    a, e = rows[:, :2] - origin, rows[:, 2:] - rows[:, :2]
    u = np.clip(-(a * e).sum(axis=1) / (e**2).sum(axis=1), 0.0, 1.0)
    return np.hypot(*(a + u[:, None] * e).T).min(initial=np.inf) < 1e-6


def brute_cells(origin, beams, solid, resolution, place, grow):
    """Entry into the box of every solid cell, for every beam."""
    c, s = math.cos(place.psi), math.sin(place.psi)
    to_grid = np.array([[c, s], [-s, c]])
    local, ways = to_grid @ (origin - place[:2]), beams @ to_grid.T
    rows, columns = np.nonzero(solid)
    corner = np.column_stack((columns, rows)) * resolution
    low, high = corner - grow - local, corner + resolution + grow - local
    enter, leave = np.zeros((len(beams), len(rows))), np.full((len(beams), len(rows)), np.inf)
    for axis in range(2):
        way = np.where(np.abs(ways[:, axis : axis + 1]) < 1e-300, 1e-300, ways[:, axis : axis + 1])
        first, second = low[:, axis] / way, high[:, axis] / way
        enter = np.maximum(enter, np.minimum(first, second))
        leave = np.minimum(leave, np.maximum(first, second))
    return np.where(enter <= leave, enter, np.inf).min(axis=1, initial=np.inf)


def seen(at, lidar, rows=NO_DISCS, walls=NO_WALLS, cells=NO_GRID, seed=0, number=0):
    ranges = np.empty(len(lidar.beams))
    scan(at, lidar, rows, walls, cells, seed, number, ranges)
    return ranges


def assert_between(near, ranges, far):
    assert not np.isnan(ranges).any()
    assert (ranges >= near - 1e-7).all()
    assert (ranges <= far + 1e-7).all()


@given(pose, sensor, some_discs, some_walls)
def test_every_beam_ends_where_brute_force_computes(at, model, rows, walls):
    lidar = model.lidar()
    origin, beams = rays(at, lidar)
    near, far = (
        np.minimum(brute_discs(origin, beams, rows, g), brute_walls(origin, beams, walls, g))
        for g in (EPS, -EPS)
    )
    if on_a_wall(origin, walls):
        near = np.zeros(len(beams))
    assert_between(near, seen(at, lidar, rows, walls), far)


@given(
    pose, sensor, arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))),
    st.sampled_from([0.05, 1.0, 3.0]), pose,
)  # fmt: skip
def test_every_beam_ends_at_the_first_solid_cell(at, model, solid, resolution, place):
    lidar = model.lidar()
    origin, beams = rays(at, lidar)
    near, far = (
        brute_cells(origin, beams, solid, resolution, place, g) for g in (EPS, -EPS)
    )  # fmt: skip
    assert_between(near, seen(at, lidar, cells=grid(solid, resolution, place)), far)


@given(st.data())
def test_jumping_over_free_cells_changes_no_range(data):
    solid = data.draw(arrays(np.bool_, (15, 20), elements=st.just(False), fill=st.just(False)))
    for cell in data.draw(st.lists(st.tuples(st.integers(0, 14), st.integers(0, 19)), max_size=8)):
        solid[cell] = True
    at = data.draw(st.builds(Pose, st.floats(-3, 23), st.floats(-3, 18), st.floats(-4, 4)))
    jumping = grid(solid, 1.0, Pose(0.0, 0.0, 0.0))
    stepping = jumping._replace(free=np.where(solid, 0, 1).astype(np.uint16))
    lidar = LidarModel(field_of_view_deg=360.0, range_max_m=100.0, range_min_m=0.0).lidar()
    np.testing.assert_array_equal(seen(at, lidar, cells=jumping), seen(at, lidar, cells=stepping))


@pytest.mark.parametrize(
    "way", [(1.0, 0.0), (0.0, 1.0), (math.sqrt(0.5), math.sqrt(0.5)), (0.6, 0.8), (0.96, 0.28)]
)
def test_jumps_change_nothing_along_borders_and_through_corners_either(way):
    rng = np.random.default_rng(3)
    solid = rng.random((40, 50)) < 0.02
    jumping = grid(solid, 1.0, Pose(0.0, 0.0, 0.0))
    stepping = jumping._replace(free=np.where(solid, 0, 1).astype(np.uint16))
    found = 0
    for x, y, sx, sy in product(range(0, 50, 3), np.arange(0, 40, 2.25), (1, -1), (1, -1)):
        ray = (float(x), float(y), sx * way[0], sy * way[1], 200.0)
        distance = cast(stepping, *ray)
        assert cast(jumping, *ray) == distance, ray
        found += distance < 200.0
    assert found > 300


@given(st.data())
def test_a_map_and_its_borders_as_walls_look_the_same_from_a_free_cell(data):
    solid = data.draw(arrays(np.bool_, (9, 14)))
    free = np.argwhere(~solid)
    assume(len(free))
    j, i = free[data.draw(st.integers(0, len(free) - 1))]
    inside = st.floats(0.01, 0.99)
    x, y = 0.1 * (i + data.draw(inside)), 0.1 * (j + data.draw(inside))
    place = Pose(3.0, -2.0, data.draw(st.sampled_from([0.0, 0.4, -2.0])))
    cells = grid(solid, 0.1, place)
    c, s = math.cos(place.psi), math.sin(place.psi)
    at = Pose(place.x + c * x - s * y, place.y + s * x + c * y, data.draw(st.floats(-4, 4)))
    lidar = LidarModel(beams=90, range_min_m=0.0).lidar()
    a, b = seen(at, lidar, cells=cells), seen(at, lidar, walls=borders(cells))
    origin, beams = rays(at, lidar)
    near, far = (brute_cells(origin, beams, solid, 0.1, place, g) for g in (EPS, -EPS))
    sure = np.isclose(near, far, rtol=0.0, atol=1e-6)  # not through a corner of a cell
    np.testing.assert_allclose(a[sure], b[sure], atol=1e-7)


def test_borders_are_the_outline_of_the_solid_cells_and_as_few_as_runs():
    solid = np.zeros((4, 5), dtype=bool)
    solid[1:3, 1:4] = True
    walls = borders(grid(solid, 0.5, Pose(10.0, 20.0, 0.0)))
    assert {tuple(row) for row in walls} == {
        (10.5, 20.5, 12.0, 20.5), (10.5, 21.5, 12.0, 21.5),
        (10.5, 20.5, 10.5, 21.5), (12.0, 20.5, 12.0, 21.5),
    }  # fmt: skip


@given(
    st.lists(st.floats(0.01, 1.0), min_size=4, max_size=30), st.floats(0.0, 2.0 * math.pi),
    st.floats(0.1, 9.0), pose,
)  # fmt: skip
def test_no_beam_slips_through_the_corners_of_a_room(widths, first, radius, at):
    steps = 2.0 * math.pi * np.array(widths) / sum(widths)
    assume(steps.max() < 3.0 and steps.min() > 0.01)  # around the sensor
    bearings = first + np.cumsum(steps)
    corners = radius * np.column_stack((np.cos(bearings), np.sin(bearings))) + (at.x, at.y)
    room = np.hstack((corners, np.roll(corners, -1, axis=0)))
    aimed = Pose(at.x, at.y, bearings[0])  # at a corner, exactly
    for psi in (at, aimed):
        assert np.isfinite(
            seen(psi, LidarModel(field_of_view_deg=360.0, range_min_m=0.0).lidar(), walls=room)
        ).all()


@pytest.mark.parametrize("name", ["turtlebot3_world", "willow_garage_10cm"])
def test_real_maps_look_the_same_as_cells_and_as_walls(name):
    if not MAPS.is_dir():
        pytest.skip("the shared occupancy maps are not beside this checkout")
    from PIL import Image

    about = json.loads((MAPS / "maps.json").read_text())[name]
    with Image.open(MAPS / about["png"]) as image:
        pixels = np.flipud(np.asarray(image.convert("L")))
    cells = grid(pixels == 0, about["resolution"], Pose(*about["origin_xy"], 0.0))
    walls = borders(cells)
    lidar = LidarModel(range_max_m=30.0, range_min_m=0.0).lidar()
    rng = np.random.default_rng(5)
    free = np.argwhere(pixels == 255)
    for j, i in free[rng.integers(len(free), size=10)]:
        x, y = about["origin_xy"] + about["resolution"] * (np.array([i, j]) + rng.random(2))
        at = Pose(x, y, rng.uniform(-math.pi, math.pi))
        np.testing.assert_allclose(
            seen(at, lidar, cells=cells), seen(at, lidar, walls=walls), atol=1e-9
        )


def test_nothing_to_see_is_infinitely_far():
    assert (seen(Pose(0.0, 0.0, 0.0), LidarModel(noise_m=0.1).lidar()) == math.inf).all()


@pytest.mark.parametrize(
    ("centre", "expected"),
    [(2.0, 1.5), (0.55, -math.inf), (10.4, 9.9), (10.6, math.inf), (0.2, -math.inf)],
)
def test_only_ranges_between_the_limits_are_numbers(centre, expected):
    lidar = LidarModel(beams=1, range_min_m=0.1, range_max_m=10.0).lidar()
    (distance,) = seen(Pose(0.0, 0.0, 0.0), lidar, discs(disc(centre, 0.0, 0.5)))
    assert distance == pytest.approx(expected)


def test_a_coarse_sensor_does_not_see_what_is_behind_a_beam():
    lidar = LidarModel(beams=2, field_of_view_deg=360.0).lidar()  # left and right
    ranges = seen(Pose(0.0, 0.0, 0.0), lidar, discs(disc(0.0, 3.0, 0.5)))
    np.testing.assert_array_equal(ranges, [math.inf, 2.5])


@pytest.mark.parametrize("gap", [0.0, 1e-12, -1e-12])
def test_a_sensor_against_a_wall_reports_that_it_is_blind(gap):
    wall = np.array([[-30.0, gap, 30.0, gap]])
    assert (seen(Pose(0.1, 0.0, 0.3), LidarModel().lidar(), walls=wall) == -math.inf).all()


def test_beams_run_counter_clockwise_over_the_field_of_view():
    lidar = LidarModel(beams=5, field_of_view_deg=180.0, mount_yaw_deg=90.0).lidar()
    ring = [disc(3 * math.cos(b), 3 * math.sin(b), 0.1 * (k + 1)) for k, b in
            enumerate(np.arange(5) * math.pi / 4)]  # fmt: skip
    ranges = seen(Pose(0.0, 0.0, 0.0), lidar, discs(*ring))
    np.testing.assert_allclose(ranges, [2.9, 2.8, 2.7, 2.6, 2.5])


def test_a_full_circle_has_no_beam_twice():
    lidar = LidarModel(beams=360, field_of_view_deg=360.0).lidar()
    bearings = np.sort(np.arctan2(lidar.beams[:, 1], lidar.beams[:, 0]))
    np.testing.assert_allclose(np.diff(bearings), math.radians(1.0), atol=1e-12)


def test_noise_has_the_stated_spread_and_stays_within_the_limits():
    model = LidarModel(beams=2000, field_of_view_deg=90.0, noise_m=0.05, range_min_m=0.1)
    circle = discs(disc(0.0, 0.0, 1.0))
    far = seen(Pose(-4.0, 0.0, 0.0), model.model_copy(update={"noise_m": 0.0}).lidar(), circle)
    noisy = seen(Pose(-4.0, 0.0, 0.0), model.lidar(), circle, seed=3)
    there = np.isfinite(far)
    assert (there == np.isfinite(noisy)).all()
    error = noisy[there] - far[there]
    assert abs(error.mean()) < 4 * 0.05 / math.sqrt(len(error))
    assert error.std() == pytest.approx(0.05, rel=0.1)
    close = seen(Pose(-1.1001, 0.0, 0.0), model.lidar(), circle, seed=3)
    assert close[np.isfinite(close)].min() == pytest.approx(0.1)


def test_the_stated_share_of_beams_drops_out():
    around = np.array([[-2, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], dtype=float)
    for share in (0.0, 0.1, 1.0):
        lidar = LidarModel(beams=5000, field_of_view_deg=360.0, dropout=share).lidar()
        lost = np.isinf(seen(Pose(0.0, 0.0, 0.0), lidar, walls=around, seed=1)).mean()
        assert lost == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 5000))


def test_the_beams_that_are_left_have_the_noise_they_had():
    wide = np.array([[2.0, -50.0, 2.0, 50.0]])
    at = Pose(0.0, 0.0, 0.0)
    model = LidarModel(beams=5000, field_of_view_deg=90.0, noise_m=0.05)
    clean = seen(at, model.model_copy(update={"noise_m": 0.0}).lidar(), walls=wide)
    ranges = seen(at, model.model_copy(update={"dropout": 0.4}).lidar(), walls=wide, seed=1)
    left = np.isfinite(ranges)
    assert abs((ranges[left] - clean[left]).mean()) < 4 * 0.05 / math.sqrt(left.sum())


def test_a_scan_depends_on_its_seed_and_number_alone():
    lidar = LidarModel(noise_m=0.02).lidar()
    rows = discs(disc(2.0, 0.0, 1.0))
    at = Pose(0.0, 0.0, 0.0)
    first = seen(at, lidar, rows, seed=7, number=4)
    np.testing.assert_array_equal(first, seen(at, lidar, rows, seed=7, number=4))
    there = np.isfinite(first)
    for seed, number in ((7, 5), (8, 4)):
        assert (first != seen(at, lidar, rows, seed=seed, number=number))[there].all()


def test_noise_is_not_the_trembling_of_the_hand():
    lidar = LidarModel(noise_m=0.02).lidar()
    at, wide = Pose(0.0, 0.0, 0.0), np.array([[1.0, -50.0, 1.0, 50.0]])
    clean = seen(at, LidarModel().lidar(), walls=wide)
    sampled = np.isfinite(clean) & (clean < 9.0)
    noise = seen(at, lidar, walls=wide, seed=7)[sampled] - clean[sampled]
    for first in (0, 1):  # the surge and the yaw axis of step k take numbers 2 k and 2 k + 1
        hand = np.array([normal(7, 2 * k + first) for k in range(len(clean))])[sampled]
        assert abs(np.corrcoef(noise, hand)[0, 1]) < 0.2


def test_hits_lie_on_the_surfaces_in_the_body_frame():
    model = LidarModel(mount_x_m=0.2, mount_y_m=-0.1, mount_yaw_deg=30.0, range_min_m=0.01)
    at = Pose(1.0, 2.0, 0.7)
    rows = discs(disc(3.0, 3.0, 0.4), disc(1.0, 4.5, 0.8))
    lidar = model.lidar()
    ranges = seen(at, lidar, rows)
    there = np.isfinite(ranges)
    assert there.sum() > 20
    c, s = math.cos(lidar.mount.psi), math.sin(lidar.mount.psi)
    ends = lidar.beams[there] * ranges[there, None]
    points = ends @ np.array([[c, s], [-s, c]]) + lidar.mount[:2]
    c, s = math.cos(at.psi), math.sin(at.psi)
    world = points @ np.array([[c, s], [-s, c]]) + at[:2]
    gaps = np.hypot(*(world[:, None] - rows[:, :2]).transpose(2, 0, 1)) - rows[:, 4]
    np.testing.assert_allclose(np.abs(gaps).min(axis=1), 0.0, atol=1e-12)


def test_numbers_that_are_not_finite_hide_nothing_else():
    lidar = LidarModel(beams=1).lidar()
    odd = discs(disc(math.nan, 0.0, 1.0), disc(math.inf, 0.0, 1.0), disc(3.0, 0.0, 1.0))
    walls = np.array([[math.nan, 0.0, 1.0, 1.0], [math.inf, -1.0, math.inf, 1.0]])
    assert seen(Pose(0.0, 0.0, 0.0), lidar, odd, walls)[0] == pytest.approx(2.0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_sensor_that_is_nowhere_reports_errors(value):
    cells = grid(np.ones((3, 3), dtype=bool), 1.0, Pose(0.0, 0.0, 0.0))
    for at in (Pose(value, 0.0, 0.0), Pose(0.0, 0.0, value)):
        if math.isinf(at.psi):
            continue  # the cosine of infinity is an exception in Python, NaN when compiled
        assert np.isnan(seen(at, LidarModel().lidar(), discs(disc(1, 0, 0.1)), cells=cells)).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"beams": 0}, {"field_of_view_deg": 361.0}, {"range_max_m": math.inf}, {"dropout": 1.1},
        {"noise_m": -0.1}, {"range_min_m": 10.0, "range_max_m": 10.0}, {"beam": 3},
    ],
)  # fmt: skip
def test_a_sensor_that_can_not_be_is_refused(wrong):
    with pytest.raises(ValidationError):
        LidarModel(**wrong)


@pytest.mark.parametrize(
    ("resolution", "origin", "shape", "word"),
    [
        (0.0, (0, 0, 0), (2, 2), "resolution"), (math.nan, (0, 0, 0), (2, 2), "resolution"),
        (0.1, (0, math.inf, 0), (2, 2), "origin"), (0.1, (0, 0, 0), (4,), "shape"),
    ],
)  # fmt: skip
def test_a_map_that_can_not_be_is_refused(resolution, origin, shape, word):
    with pytest.raises(CohelmError, match=word):
        grid(np.zeros(shape, dtype=bool), resolution, Pose(*origin))
