"""A world with heights: rays meet what a ray tracer says, and a wheel falls where floor ends."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.sim.heights import DepthCamera, Heights, box, depths, drop, edges, fallen, picture
from tests.ros.test_depth import CAM, mounted, room

BODY = mounted(x=0.2, z=0.5, down=25.0)


def rays():
    u, v = np.meshgrid(np.arange(CAM.width), np.arange(CAM.height))
    made = np.stack([(u - CAM.cx) / CAM.fx, (v - CAM.cy) / CAM.fy, np.ones(u.shape)], -1)
    return made.reshape(-1, 3)


def seen(heights, farthest=100.0):
    found, slant = np.empty(CAM.width * CAM.height), np.empty(CAM.width * CAM.height)
    depths(heights, BODY[:3, 3].copy(), BODY[:3, :3].copy(), rays(), farthest, found, slant)
    return found.reshape(CAM.height, CAM.width), slant.reshape(CAM.height, CAM.width)


def test_boxes_and_floor_are_where_a_ray_tracer_has_them():
    random = np.random.default_rng(4)
    for _ in range(20):
        n = int(random.integers(1, 6))
        low = random.uniform([0.6, -1.5, 0.0], [3.0, 1.5, 0.4], (n, 3))
        high = low + random.uniform(0.05, 0.8, (n, 3))
        rows = np.array([
            box(*(0.5 * (a + b))[:2], 0.0, *(b - a)[:2], a[2], b[2])
            for a, b in zip(low, high, strict=True)
        ])  # fmt: skip
        found, _ = seen(Heights(rows))
        assert found == pytest.approx(room(BODY, np.hstack((low, high))), rel=1e-9)


def test_turned_by_a_right_angle_a_box_is_one_with_its_sides_exchanged():
    one, other = (
        seen(Heights(np.array([box(1.5, 0.2, yaw, *sides, 0.1, 0.4)])))[0]
        for yaw, sides in ((0.0, (0.3, 0.9)), (0.5 * math.pi, (0.9, 0.3)))
    )
    assert one == pytest.approx(other, rel=1e-9)


def test_a_stair_down_is_seen_step_by_step_and_a_pit_without_a_bottom_not_at_all():
    steps = [drop(1.5 + 0.5 * k, 0.0, 0.0, 0.5, 9.0, 0.05 * (k + 1)) for k in range(3)]
    found, _ = seen(Heights(drops=np.array(steps)))
    points = BODY[:3, 3] + found.reshape(-1, 1) * (rays() @ BODY[:3, :3].T)
    for k in range(3):
        on = (np.abs(points[:, 0] - 1.5 - 0.5 * k) < 0.24) & (np.abs(points[:, 1]) < 0.5)
        assert on.sum() > 3
        assert points[on, 2].min() == pytest.approx(-0.05 * (k + 1), abs=1e-9)
    before = (points[:, 0] > 0.8) & (points[:, 0] < 1.24)
    assert points[before, 2] == pytest.approx(0.0, abs=1e-9)
    deep, _ = seen(Heights(drops=np.array([drop(3.0, 0.0, 0.0, 4.0, 9.0, 50.0)])), farthest=4.0)
    assert np.isinf(deep[20:30]).all()


def test_floor_is_met_as_square_as_a_ray_comes_down():
    _, slant = seen(Heights())
    down = -(rays() @ BODY[:3, :3].T)[:, 2] / np.linalg.norm(rays(), axis=1)
    on = down > 0.0
    assert slant.ravel()[on] == pytest.approx(down[on])


def test_a_wheel_falls_where_floor_ends_and_not_before():
    pit = Heights(drops=np.array([drop(2.0, 0.0, 0.3, 1.0, 1.0, 0.2)]))
    poses = np.array([[x, 0.0, 0.0] for x in np.arange(0.0, 3.0, 0.01)])
    k = fallen(pit, poses, np.array([[0.3, 0.0], [-0.3, 0.0]]))
    edge = 2.0 - 0.5 / math.cos(0.3)
    assert poses[k, 0] + 0.3 == pytest.approx(edge, abs=0.011)
    assert fallen(pit, poses[:k], np.array([[0.3, 0.0]])) == -1
    assert fallen(pit, poses, np.array([[0.0, 0.8]])) == -1


def test_edges_go_round_each():
    (a, b, c, d) = edges(np.array([drop(1.0, 2.0, 0.0, 2.0, 1.0, 0.3)]))
    assert np.array([a, b, c, d]).tolist() == [
        [0.0, 1.5, 2.0, 1.5], [2.0, 1.5, 2.0, 2.5], [2.0, 2.5, 0.0, 2.5], [0.0, 2.5, 0.0, 1.5],
    ]  # fmt: skip


def test_a_picture_misses_what_it_looks_along_and_shakes_as_it_is_told():
    lens = DepthCamera(
        CAM.width, CAM.height, CAM.fx, BODY[:3, 3].copy(), BODY[:3, :3].copy(), 40.0, 0.0, 0.0,
        0.08, 0.0,
    )  # fmt: skip
    found = picture(lens, Heights(), Pose(1.0, 2.0, 0.7), np.random.default_rng(1)).astype(float)
    flat, slant = seen(Heights())
    missing = (slant < 0.08) | ~(flat < 40.0)
    assert (found[missing] == 0.0).all()
    sure = slant > 0.16
    assert found[sure] == pytest.approx(flat[sure], rel=1e-5)
    other = picture(lens._replace(shake=0.01), Heights(), Pose(1.0, 2.0, 0.7),
                    np.random.default_rng(1))  # fmt: skip
    assert np.abs(other - found)[sure].max() > 0.005
