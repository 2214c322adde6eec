"""Floor that should be seen and is not counts as standing: where it ends, what is beyond, and what
a dark floor does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.robot.sensors import FloorModel, LidarModel
from cohelm.ros.cloud import CloudRanges
from cohelm.ros.depth import DepthRanges, Intrinsics, described
from cohelm.scenario.load import robot as load_robot
from tests.ros.test_cloud import cloud
from tests.ros.test_depth import bearings, image, mounted, room

CAM = Intrinsics(160, 120, 137.5, 137.5, 79.5, 59.5)
FROM, TO, CELL, DROP = 0.5, 1.5, 0.1, 0.05
GIVEN = LidarModel(
    beams=80, range_min_m=0.2, range_max_m=4.0, height_band_m=(0.1, 1.0), depth_image=True,
    floor=FloorModel(from_m=FROM, to_m=TO, drop_m=DROP, cell_m=CELL),
)  # fmt: skip
BODY = mounted(down=25.0, z=0.4)
"""Of a camera that sees the floor from about 0.4 m on."""


def slab(x: float, top: float = 0.0):
    """Floor up to x."""
    return (-5.0, -5.0, top - 1.0, x, 5.0, top)


def of_camera(depth, given=GIVEN, body=BODY, noise=0.0, seed=3):
    model = described(CAM, body, given, "/depth")
    made = DepthRanges(model, CAM, body, "/depth")
    depth = depth * (1.0 + noise * np.random.default_rng(seed).standard_normal(depth.shape))
    return model, made, made.of(image(depth, "32FC1"))


def of_cloud(depth, given=GIVEN, body=BODY):
    """The same by a point cloud of the same rays."""
    model = described(CAM, body, given, "/depth")
    u, v = np.meshgrid(np.arange(CAM.width), np.arange(CAM.height))
    rays = np.stack([(u - CAM.cx) / CAM.fx, (v - CAM.cy) / CAM.fy, np.ones(u.shape)], -1)
    made = CloudRanges(model, body, "/points")
    with np.errstate(invalid="ignore"):
        return model, made, made.of(cloud((rays * depth[..., None]).reshape(-1, 3)))


@pytest.mark.parametrize("seen_by", [of_camera, of_cloud])
@pytest.mark.parametrize("beyond", [-0.08, -0.3, -3.0, -math.inf])
def test_where_the_floor_ends_stands_something_not_beyond_it_nor_far_before(seen_by, beyond):
    """A step down ahead, or a hole that returns nothing."""
    for edge in (0.75, 0.9, 1.13, 1.3):
        depth = room(BODY, [slab(edge)], CAM, floor=max(beyond, -9.0))
        if beyond == -math.inf:
            depth[depth > room(BODY, [], CAM) + 1e-6] = math.nan
        model, _, ranges = seen_by(depth)
        ends = ranges * np.cos(bearings(model))  # how far ahead
        told = edge / np.cos(bearings(model)) < TO - 2.0 * CELL  # enough of nothing is in view
        assert np.isfinite(ranges[told]).all()
        ends = ends[np.isfinite(ranges)]
        assert ends.max() <= edge + 1e-6
        most = 2.0 if seen_by is of_camera else 3.0
        assert ends.min() >= edge - most * CELL - 0.02


@pytest.mark.parametrize("seen_by", [of_camera, of_cloud])
@pytest.mark.parametrize("top", [0.0, 0.04, -0.015])
def test_floor_that_is_there_is_free_also_where_it_is_a_little_uneven(seen_by, top):
    _, made, ranges = seen_by(room(BODY, [slab(0.8)], CAM, floor=top))
    assert (ranges == math.inf).all()
    assert made.floor.seen == 1.0


@pytest.mark.parametrize("noise", [0.005, 0.01])
def test_noise_neither_makes_a_drop_nor_hides_one(noise):
    for seed in range(5):
        _, _, ranges = of_camera(room(BODY, [], CAM), noise=noise, seed=seed)
        assert (ranges == math.inf).all()
        _, _, ranges = of_camera(room(BODY, [slab(1.0)], CAM, -0.12), noise=noise, seed=seed)
        assert (ranges < 1.25).all()


def test_a_slope_that_falls_by_less_than_a_drop_from_where_floor_is_seen_is_driven_on():
    """A floor that falls by 2 deg: 5 cm at 1.5 m."""
    down = mounted(down=25.0 - 1.7, z=0.4)  # the same as a camera that is pitched up by as much
    depth = room(down, [], CAM)
    _, _, ranges = of_camera(depth)
    assert (ranges == math.inf).all()
    steep = room(mounted(down=25.0 - 4.0, z=0.4), [], CAM)
    _, _, ranges = of_camera(steep)
    assert (ranges < TO).all()


def test_where_the_first_floor_is_not_seen_something_stands_at_the_least_range():
    """A step down that begins before the nearest floor in view, or a lens that is covered."""
    _, _, ranges = of_camera(room(BODY, [slab(0.3)], CAM, floor=-1.0))
    assert (ranges == GIVEN.range_min_m).all()
    _, made, ranges = of_camera(np.full((120, 160), math.nan))
    assert (ranges == GIVEN.range_min_m).all()
    assert made.floor.seen == 0.0


def test_an_obstacle_is_seen_where_it_is_and_occludes_the_floor_behind_it():
    for x in (0.63, 0.8, 1.07):
        model, _, ranges = of_camera(room(BODY, [(x, -2.0, 0.0, x + 0.2, 2.0, 0.6)], CAM))
        assert ranges * np.cos(bearings(model)) == pytest.approx(x, abs=0.02)


@pytest.mark.parametrize("left", [-0.3, -0.15, -0.05, 0.02, 0.11])
def test_an_obstacle_before_the_first_floor_explains_why_it_is_not_seen(left):
    """Beside it, in a sector that it hides in part, nothing is too near."""
    thing = (0.42, left, 0.0, 0.47, left + 0.1, 0.3)
    model, _, ranges = of_camera(room(BODY, [thing], CAM), noise=0.01)
    hit = ranges < math.inf
    assert np.isfinite(ranges[hit]).all()
    assert (ranges[hit] * np.cos(bearings(model))[hit] > 0.38).all()
    beside = np.tan(bearings(model)) * 0.45
    assert not hit[(beside < left - 0.06) | (beside > left + 0.16)].any()
    assert hit[(beside > left + 0.01) & (beside < left + 0.09)].all()


def test_a_low_thing_before_a_drop_does_not_hide_it():
    """A sill of 7 cm, below the band, and nothing behind it."""
    depth = room(BODY, [slab(0.9), (0.85, -5.0, 0.0, 0.9, 5.0, 0.07)], CAM, floor=-1.0)
    _, _, ranges = of_camera(depth)
    assert (ranges < 0.9 / math.cos(math.radians(31.0))).all()


def test_a_column_of_lost_pixels_brings_no_edge_near():
    """It was told 0.4 m before the lens, and stayed in the memory of what stands there."""
    depth = room(BODY, [slab(1.2)], CAM, floor=-1.0)
    depth[:, 71] = math.nan
    model, _, ranges = of_camera(depth)
    ends = ranges * np.cos(bearings(model))
    ahead = np.abs(bearings(model)) < math.radians(20.0)
    assert ends[ahead].max() <= 1.2 + 1e-6
    assert ends[ahead].min() >= 1.2 - 3.0 * CELL - 0.02


def test_a_hole_is_seen_in_its_direction_only():
    """30 cm wide, ahead to the left."""
    u, v = np.meshgrid(np.arange(CAM.width), np.arange(CAM.height))
    rays = np.stack([(u - CAM.cx) / CAM.fx, (v - CAM.cy) / CAM.fy, np.ones(u.shape)], -1)
    depth = room(BODY, [], CAM)
    at = rays * depth[..., None] @ BODY[:3, :3].T + BODY[:3, 3]
    depth[(at[..., 0] > 0.9) & (at[..., 0] < 1.3) & (at[..., 1] > 0.1) & (at[..., 1] < 0.4)] = 0.0
    model, _, ranges = of_camera(depth)
    off = np.degrees(bearings(model))
    assert (ranges[(off > 8.0) & (off < 16.0)] < 0.95).all()
    assert (ranges[(off < 0.0) | (off > 28.0)] == math.inf).all()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"floor": {"from_m": 1.0, "to_m": 1.05}}, "there must be two cells at least"),
        ({"floor": {"from_m": 0.5, "to_m": 9.0}}, "must not be farther than range_max_m"),
        ({"floor": {"from_m": 0.5, "to_m": 1.0, "height_m": 0.3}}, "must be below the height_band"),
        ({"floor": {"from_m": 0.5, "to_m": 1.0}, "height_band_m": None}, "needs a height_band_m"),
    ],
)
def test_floor_that_can_not_be_seen_so_is_refused(tmp_path, wrong, said):
    with pytest.raises(ValueError, match=said):
        LidarModel.model_validate({"height_band_m": [0.1, 1.0], "range_max_m": 4.0, **wrong})
    (tmp_path / "cart.yaml").write_text(
        "name: cart\nfootprint_m: [[0.2, 0.2], [-0.2, 0], [0.2, -0.2]]\ntrack_m: 0.3\n"
        "wheel_radius_m: 0.1\nlidar: {height_band_m: [0.1, 1], floor: {from_m: 1, to_m: 1.05}}\n"
    )
    with pytest.raises(CohelmError, match=r"floor.*two cells at least"):
        load_robot(str(tmp_path / "cart.yaml"))
