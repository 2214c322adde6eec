"""Point clouds become scans: what stands within the height band, where it is, however the sensor
is mounted."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__PointCloud2 as PointCloud2,
    sensor_msgs__msg__PointField as PointField,
)

from cohelm.core.errors import CohelmError
from cohelm.record.ros2 import header
from cohelm.robot.sensors import LidarModel
from cohelm.ros.cloud import CloudRanges, points
from cohelm.ros.mismatch import CLOUD
from cohelm.ros.types import packed, unpacked

BAND = LidarModel(
    beams=720, field_of_view_deg=360.0, range_min_m=0.3, range_max_m=10.0, height_band_m=(0.1, 1.0)
)
FLAT = np.eye(4)


def cloud(xyz, kind="f4", big=False, rows=1, pad=0) -> PointCloud2:
    """A message of points (n, 3), with an intensity between them and padding behind each row."""
    xyz = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    size = int(kind[1])
    order = ">" if big else "<"
    row = np.zeros(
        len(xyz),
        {"names": ["x", "y", "z"], "formats": [order + kind] * 3,
         "offsets": [0, size, 2 * size], "itemsize": 3 * size + 8},
    )  # fmt: skip
    row["x"], row["y"], row["z"] = xyz.T
    width, step = len(xyz) // rows, 3 * size + 8
    lines = [part.tobytes() + b"\0" * pad for part in row.reshape(rows, width)]
    fields = [
        PointField(name, i * size, {"f4": 7, "f8": 8}[kind], 1) for i, name in enumerate("xyz")
    ]
    return PointCloud2(
        header(0, "cloud"), rows, width, fields, big, step, step * width + pad,
        np.frombuffer(b"".join(lines), np.uint8), False,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("big", [False, True])
def test_points_come_out_as_they_went_in(kind, big):
    xyz = np.random.default_rng(3).uniform(-5.0, 5.0, (12, 3))
    xyz[5] = math.nan
    message, damage = unpacked(packed(cloud(xyz, kind, big, rows=3, pad=7), CLOUD), CLOUD)
    assert damage == ""
    assert points(message, "/points") == pytest.approx(xyz, abs=1e-6, nan_ok=True)


def test_of_what_stands_in_the_band_the_nearest_along_each_beam_is_seen():
    ranges = CloudRanges(BAND, FLAT, "/points").of(cloud([
        [3.0, 0.0, 0.5], [2.0, 0.0, 0.2], [1.0, 0.0, 0.05], [1.0, 0.0, 1.2],  # floor, ceiling
        [0.0, 4.0, 0.5], [0.0, -0.2, 0.5], [0.0, 20.0, 0.5], [math.nan, 0.0, 0.5],
        [math.inf, 1.0, 0.5],
    ]))  # fmt: skip
    lidar = BAND.lidar()
    seen = {round(math.degrees(lidar.first + k * lidar.step)): ranges[k]
            for k in np.flatnonzero(ranges < math.inf)}  # fmt: skip
    assert seen == pytest.approx({0: 2.0, 90: 4.0, -90: -math.inf}, abs=1e-6)


def test_a_tilted_sensor_on_a_mast_measures_true_positions():
    """Pitched down by 40 deg, turned by 90 deg, 1.2 m above the origin."""
    pitch, yaw = math.radians(40.0), math.radians(90.0)
    about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0],
                        [-math.sin(pitch), 0, math.cos(pitch)]])  # fmt: skip
    about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0],
                        [0, 0, 1]])  # fmt: skip
    body = np.eye(4)
    body[:3, :3], body[:3, 3] = about_z @ about_y, (0.2, 0.1, 1.2)
    there = np.array([[0.2, 2.1, 0.5], [0.2, 1.6, 0.0]])  # a box 2 m to the left; the floor
    seen_by = (there - body[:3, 3]) @ body[:3, :3]
    model = BAND.model_copy(
        update={"mount_x_m": 0.2, "mount_y_m": 0.1, "mount_yaw_deg": 90.0,
                "field_of_view_deg": 90.0}
    )  # fmt: skip
    ranges = CloudRanges(model, body, "/points").of(cloud(seen_by))
    (beam,) = np.flatnonzero(ranges < math.inf)
    assert abs(beam - 359.5) <= 0.51  # the middle one looks to the left
    assert ranges[beam] == pytest.approx(2.0, abs=1e-6)


def test_a_cloud_without_points_shows_nothing():
    assert (CloudRanges(BAND, FLAT, "/points").of(cloud([])) == math.inf).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 99}, {"point_step": 8}, {"row_step": 3}, {"data": np.zeros(5, np.uint8)},
        {"width": 4_000_000}, {"fields": []}, {"height": 1_000_000_000},
        {"fields": [PointField("xyz"[i], 4 * i, 2, 1) for i in range(3)]},
    ],
)  # fmt: skip
def test_bytes_that_hold_no_cloud_are_refused(wrong):
    made = vars(cloud([[1.0, 0.0, 0.5], [2.0, 0.0, 0.5]])) | wrong
    with pytest.raises(CohelmError, match="/points"):
        points(SimpleNamespace(**made), "/points")
