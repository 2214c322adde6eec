"""Depth images become scans: what stands within the height band, where it is, however the camera
is mounted; what no camera measures is not taken for free."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Image as Image

from cohelm.core.errors import CohelmError
from cohelm.record.ros2 import header
from cohelm.robot.sensors import LidarModel
from cohelm.ros import rendered
from cohelm.ros.depth import DepthRanges, Intrinsics, camera, depths, described
from cohelm.ros.mismatch import CAMERA_INFO, IMAGE
from cohelm.ros.types import packed, unpacked

CAM = Intrinsics(64, 48, 55.0, 55.0, 31.5, 23.5)
GIVEN = LidarModel(
    beams=720, range_min_m=0.2, range_max_m=4.0, height_band_m=(0.1, 1.0), depth_image=True
)
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""x right, y down, z forward, in a body whose x is forward."""


def mounted(x=0.0, y=0.0, z=0.3, yaw=0.0, down=0.0, roll=0.0):
    """(4, 4), from the optical frame into the body's [m, deg]."""
    angles = [math.radians(v) for v in (yaw, down, roll)]
    c, s = np.cos(angles), np.sin(angles)
    turn = np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]])
    pitch = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    about = np.array([[1, 0, 0], [0, c[2], -s[2]], [0, s[2], c[2]]])
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn @ pitch @ about @ OPTICAL, (x, y, z)
    return made


def image(depth, encoding="16UC1", big=False, pad=0) -> Image:
    """A message of depths (h, w) [m]."""
    kind = {"16UC1": "u2", "32FC1": "f4"}[encoding]
    numbers = np.rint(1000.0 * depth) if kind == "u2" else depth
    rows = np.ascontiguousarray(numbers.astype((">" if big else "<") + kind))
    data = b"".join(row.tobytes() + b"\0" * pad for row in rows)
    step = rows.shape[1] * int(kind[1]) + pad
    return Image(
        header(0, "cam"), *rows.shape, encoding, int(big), step, np.frombuffer(data, np.uint8)
    )  # fmt: skip


def room(body, boxes, cam=CAM, floor=0.0):
    """(h, w), depths of boxes (x0, y0, z0, x1, y1, z1) and a floor, ray by ray [m]."""
    u, v = np.meshgrid(np.arange(cam.width), np.arange(cam.height))
    rays = np.stack([(u - cam.cx) / cam.fx, (v - cam.cy) / cam.fy, np.ones(u.shape)], -1)
    rays, at = rays @ body[:3, :3].T, body[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0.0, (floor - at[2]) / rays[..., 2], math.inf)
        for box in np.array(boxes, dtype=float).reshape(-1, 6):
            ends = (
                np.moveaxis((box[:3] - at) / rays, 2, 0),
                np.moveaxis((box[3:] - at) / rays, 2, 0),
            )
            into = np.maximum.reduce(np.fmin(*ends))  # a ray along a side has no number there
            out = np.minimum.reduce(np.maximum(*ends))
            depth = np.where((into <= out) & (into > 0.0), np.minimum(depth, into), depth)
    return depth


def seen(body, depth, encoding="32FC1", cam=CAM, given=GIVEN):
    model = described(cam, body, given, "/depth")
    return model, DepthRanges(model, cam, body, "/depth").of(image(depth, encoding))


def bearings(model):
    lidar = model.lidar()
    return lidar.first + lidar.step * np.arange(model.beams) + lidar.mount.psi


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
@pytest.mark.parametrize("big", [False, True])
def test_depths_come_out_as_they_went_in(encoding, big):
    given = np.random.default_rng(3).uniform(0.3, 5.0, (48, 64))
    message, damage = unpacked(packed(image(given, encoding, big, 6), IMAGE), IMAGE)
    assert damage == ""
    found, metres = depths(message, CAM, "/depth")
    assert found * metres == pytest.approx(given, abs=6e-4)


@pytest.mark.parametrize(
    "mount", [{}, {"down": 25.0}, {"x": 0.2, "y": 0.1, "yaw": 90.0, "down": 10.0},
              {"roll": 180.0}, {"down": -15.0, "z": 0.6}]
)  # fmt: skip
def test_a_box_is_seen_where_it_is_however_the_camera_is_mounted(mount):
    """Against a ray tracer of boxes: 1.5 m ahead of the lens, half a metre wide, 30 cm high."""
    body = mounted(**mount)
    yaw, (x, y, z) = math.radians(mount.get("yaw", 0.0)), body[:3, 3]
    c, s = round(math.cos(yaw)), round(math.sin(yaw))
    ends = sorted([(x + c * a - s * b, y + s * a + c * b) for a, b in ((1.5, -0.25), (2.0, 0.25))])
    (x0, y0), (x1, y1) = ends
    box = (min(x0, x1), min(y0, y1), 0.0, max(x0, x1), max(y0, y1), z + 0.2)
    model, ranges = seen(body, room(body, [box]))
    assert model.mount_yaw_deg == pytest.approx(math.degrees(yaw), abs=0.5)
    off = np.abs(bearings(model) - yaw)
    wide = math.atan2(0.25, 1.5)
    on, beside = off < wide - 0.03, off > wide + 0.03
    assert on.sum() > 5
    assert ranges[on] == pytest.approx(1.5 / np.cos(off[on]), abs=0.02)
    assert (ranges[beside] == math.inf).all()


def test_a_camera_reports_the_distance_from_which_it_sees_the_full_height_band():
    """Its lowest row comes down to 10 cm so far from the lens; nearer, things may be below."""
    body = mounted(z=0.5, down=25.0)
    near = described(CAM, body, GIVEN, "/depth").whole_from_m
    lowest = math.radians(25.0) + math.atan(23.5 / 55.0)
    assert near >= 0.4 / math.tan(lowest) - 1e-9
    assert near == pytest.approx(0.4 / math.tan(lowest), rel=0.35)  # farther at the sides
    assert described(CAM, mounted(z=0.05), GIVEN, "/depth").whole_from_m == 0.0
    stated = GIVEN.model_copy(update={"whole_from_m": 2.0})
    assert described(CAM, body, stated, "/depth").whole_from_m == 2.0


def test_neither_the_floor_nor_what_is_above_or_below_the_band_counts():
    body = mounted(down=20.0)
    low, high = (1.0, -1.0, 0.0, 1.2, 1.0, 0.08), (0.8, -1.0, 1.05, 1.2, 1.0, 1.2)
    _, ranges = seen(body, room(body, [low, high]))
    assert (ranges == math.inf).all()
    _, ranges = seen(body, room(body, [(1.0, -1.0, 0.0, 1.2, 1.0, 0.2)]))
    assert ranges.min() == pytest.approx(1.0, abs=0.02)


def test_space_that_was_not_measured_is_not_free():
    body = mounted()
    depth = room(body, [(2.0, -3.0, 0.0, 2.2, 3.0, 1.0)])
    model, ranges = seen(body, depth)
    assert np.isfinite(ranges).all()
    left = bearings(model) > 0.05
    for nothing in (0.0, math.nan):
        hole = depth.copy()
        hole[:, :32] = nothing  # the left half of the picture
        _, ranges = seen(body, hole)
        assert np.isnan(ranges[left]).all()
        assert np.isfinite(ranges[bearings(model) < -0.05]).all()
    hole = depth.copy()
    hole[:40] = 0.0  # all but the lowest rows: most of each beam
    _, ranges = seen(body, hole)
    assert np.isnan(ranges).all()
    hole[20:30, 30:34] = -math.inf  # REP-118: too near
    _, ranges = seen(body, hole)
    assert (ranges[np.abs(bearings(model)) < 0.02] == -math.inf).all()
    _, ranges = seen(body, np.full((48, 64), math.inf))  # REP-118: nothing within range
    assert (ranges == math.inf).all()
    _, ranges = seen(body, np.full((48, 64), 0.1))
    assert (ranges == -math.inf).all()


def test_the_view_is_the_cameras_and_no_beam_finer_than_its_pixels():
    model = described(CAM, mounted(down=20.0), GIVEN, "/depth")
    assert 0.0 < model.field_of_view_deg < math.degrees(2.0 * math.atan(31.5 / 55.0))
    assert math.radians(model.field_of_view_deg) / (model.beams - 1) >= 1.0 / 55.0
    narrow = GIVEN.model_copy(update={"field_of_view_deg": 20.0, "beams": 10})
    model = described(CAM, mounted(), narrow, "/depth")
    assert (model.field_of_view_deg, model.beams) == (20.0, 10)


def test_a_post_as_thick_as_the_gap_between_rays_is_seen_in_a_large_image():
    """Of 1280 x 960 pixels every second of each row and column is looked at."""
    cam, body = Intrinsics(1280, 960, 1100.0, 1100.0, 639.5, 479.5), mounted()
    assert cam.stride == 2
    for far in (1.0, 3.5):
        gap = cam.gap * far
        rng = np.random.default_rng(7)
        for y in rng.uniform(-0.3, 0.3, 2) * far:
            box = (far, y, 0.0, far + 0.1, y + 1.001 * gap, 1.0)
            _, ranges = seen(body, room(body, [box], cam), cam=cam)
            assert np.nanmin(ranges) == pytest.approx(math.hypot(far, y), abs=0.02)


WRONG = [
    ({"encoding": "rgb8"}, "is encoded as 'rgb8', and depths are 16UC1"),
    ({"width": 32}, "has 32 x 48 pixels, and its CameraInfo says 64 x 48"),
    ({"step": 5}, "holds no image"),
    ({"data": np.zeros(9, np.uint8)}, "holds no image"),
]


@pytest.mark.parametrize(("wrong", "said"), WRONG)
def test_bytes_that_hold_no_depths_are_refused(wrong, said):
    made = SimpleNamespace(**(vars(image(np.ones((48, 64)))) | wrong))
    with pytest.raises(CohelmError, match=f"/depth {said}"):
        depths(made, CAM, "/depth")


def told(**wrong):
    made = vars(rendered.info(CAM, header(0, "cam"))) | wrong
    return SimpleNamespace(**made)


@pytest.mark.parametrize(
    "wrong",
    [{"width": 0}, {"p": np.full(12, math.nan)}, {"k": np.zeros(9), "p": np.zeros(12)},
     {"height": 1 << 30}],
)  # fmt: skip
def test_numbers_that_are_none_of_a_camera_are_refused(wrong):
    with pytest.raises(CohelmError, match="/info describes no camera"):
        camera(told(**wrong), "/info")


def test_a_rectified_camera_is_described_by_its_projection_matrix():
    message, _ = unpacked(packed(rendered.info(CAM, header(0, "cam")), CAMERA_INFO), CAMERA_INFO)
    assert camera(message, "/info") == CAM
    k = np.array([50.0, 0, 30, 0, 51, 20, 0, 0, 1])
    assert camera(told(p=np.zeros(12), k=k), "/info") == Intrinsics(64, 48, 50.0, 51.0, 30.0, 20.0)


@pytest.mark.parametrize("nothing", [0.0, math.nan])
def test_a_picture_in_which_nothing_at_all_was_measured_is_of_something_too_near(nothing):
    """Else a robot whose camera stands at a wall could not even back away from it."""
    _, ranges = seen(mounted(), np.full((48, 64), nothing))
    assert (ranges == -math.inf).all()


@pytest.mark.parametrize("mount", [{"down": 75.0}, {"down": -80.0}, {"roll": 90.0}])
def test_a_camera_that_does_not_look_along_the_floor_is_refused(mount):
    with pytest.raises(CohelmError, match=r"/depth: the camera looks .*REP-103"):
        described(CAM, mounted(**mount), GIVEN, "/depth")


def test_a_simulated_camera_shows_what_its_scan_does():
    model = GIVEN.model_copy(update={"field_of_view_deg": 80.0, "beams": 160, "mount_z_m": 0.3})
    ranges = 1.5 + np.arange(160) / 200.0
    cam, body = rendered.camera_of(model), mounted()
    found = described(cam, body, model, "/depth")
    made = DepthRanges(found, cam, body, "/depth").of(
        rendered.image(ranges, model, 0.3, header(time.time_ns(), "cam"))
    )
    inside = np.abs(bearings(found)) < math.radians(38.0)
    expected = np.interp(bearings(found), bearings(model), ranges)
    assert made[inside] == pytest.approx(expected[inside], abs=0.02)


def test_a_simulated_camera_in_a_wide_hall_sees_ceiling_and_floor_and_is_not_blind():
    model = GIVEN.model_copy(
        update={"field_of_view_deg": 70.0, "beams": 160, "mount_z_m": 0.5, "range_max_m": 4.0,
                "height_band_m": (0.08, 1.0)}
    )  # fmt: skip
    cam, body = rendered.camera_of(model), mounted(z=0.5)
    found = described(cam, body, model, "/depth")
    made = DepthRanges(found, cam, body, "/depth").of(
        rendered.image(np.full(160, math.inf), model, 0.5, header(time.time_ns(), "cam"))
    )
    assert np.isnan(made).mean() < 0.1
    assert not np.isfinite(made).any()
