"""A point cloud as a scan: `python -m benchmarks.cloud [--points 24000]`.

From the received bytes of a PointCloud2 to ranges: the time that a robot's driver adds to reading
it, in the gate process.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__PointCloud2 as PointCloud2,
    sensor_msgs__msg__PointField as PointField,
)

from cohelm.record.ros2 import header
from cohelm.robot.sensors import LidarModel
from cohelm.ros.cloud import CloudRanges
from cohelm.ros.mismatch import CLOUD
from cohelm.ros.types import packed, unpacked


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=24_000)
    parser.add_argument("--count", type=int, default=300)
    args = parser.parse_args()
    rows = np.random.default_rng(1).uniform(-8.0, 8.0, (args.points, 4)).astype("<f4")
    rows[:, 2] = 0.1 * rows[:, 2] + 0.6
    fields = [PointField(name, 4 * k, 7, 1) for k, name in enumerate(("x", "y", "z", "intensity"))]
    data = packed(
        PointCloud2(
            header(0, "lidar"), 1, args.points, fields, False, 16, 16 * args.points,
            rows.view(np.uint8).ravel(), True,
        ),
        CLOUD,
    )  # fmt: skip
    model = LidarModel(field_of_view_deg=360.0, height_band_m=(0.1, 1.0))
    ranges, took = CloudRanges(model, np.eye(4), "/points"), list[float]()
    for _ in range(args.count):
        start = time.perf_counter()
        ranges.of(unpacked(data, CLOUD)[0])
        took.append(1e3 * (time.perf_counter() - start))
    for name, q in (("least", 0.0), ("median", 50.0), ("99 %", 99.0), ("most", 100.0)):
        print(f"{name}: {np.percentile(took, q):.2f} ms")


if __name__ == "__main__":
    main()
