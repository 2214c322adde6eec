"""A depth image as a scan: `python -m benchmarks.depth [--width 640 --height 480]`.

From the received bytes of an Image to ranges: the time that a robot's driver adds to reading it,
in the gate process.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Image as Image

from cohelm.record.ros2 import header
from cohelm.robot.sensors import LidarModel
from cohelm.ros.depth import DepthRanges, Intrinsics, described
from cohelm.ros.mismatch import IMAGE
from cohelm.ros.types import packed, unpacked


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--float", action="store_true", help="32FC1 instead of 16UC1")
    parser.add_argument("--count", type=int, default=300)
    args = parser.parse_args()
    width, height = args.width, args.height
    camera = Intrinsics(width, height, 0.95 * width, 0.95 * width, 0.5 * width, 0.5 * height)
    depth = np.random.default_rng(1).uniform(0.0, 5.0, (height, width))
    rows = depth.astype("<f4") if args.float else np.rint(1e3 * depth).astype("<u2")
    kind = "32FC1" if args.float else "16UC1"
    data = packed(
        Image(
            header(0, "camera"), height, width, kind, 0, rows.strides[0],
            rows.view(np.uint8).ravel(),
        ),
        IMAGE,
    )  # fmt: skip
    body = np.eye(4)
    down = np.radians(20.0)
    forward = (np.cos(down), 0.0, -np.sin(down))
    body[:3, :3] = np.column_stack(((0, -1, 0), (-np.sin(down), 0, -np.cos(down)), forward))
    body[2, 3] = 0.4
    model = LidarModel(height_band_m=(0.05, 1.0), depth_image=True, range_max_m=4.0)
    model = described(camera, body, model, "/depth")
    ranges, took = DepthRanges(model, camera, body, "/depth"), list[float]()
    for _ in range(args.count):
        start = time.perf_counter()
        ranges.of(unpacked(data, IMAGE)[0])
        took.append(1e3 * (time.perf_counter() - start))
    for name, q in (("least", 0.0), ("median", 50.0), ("99 %", 99.0), ("most", 100.0)):
        print(f"{name}: {np.percentile(took, q):.2f} ms")


if __name__ == "__main__":
    main()
