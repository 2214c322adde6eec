"""Bytes that are no messages of each type that is read, to whatever reads it; nobody may move.

As a program: python -m tests.ros.fuzz_types [SECONDS [SEED]]; ends with 1 if anything was wrong.
`tests.ros.fuzz` does it to a filter that drives; here is also what the filter does not hear.
"""

from __future__ import annotations

import math
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point32 as Point32,
    geometry_msgs__msg__Polygon as Polygon,
    geometry_msgs__msg__PolygonStamped as PolygonStamped,
    rosgraph_msgs__msg__Clock as Clock,
    sensor_msgs__msg__Joy as Joy,
    sensor_msgs__msg__Range as Range,
    std_msgs__msg__Bool as Bool,
)

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.plan.path_planner import Goal
from cohelm.record.ros2 import header
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.ros import clock, cone, depth
from cohelm.ros.clock import SimulatedClock
from cohelm.ros.cloud import CloudRanges
from cohelm.ros.commands import Commands
from cohelm.ros.contact import Contacts, ContactTopic, contact_messages
from cohelm.ros.footprint import FootprintTopic
from cohelm.ros.goals import GOAL, Goals
from cohelm.ros.interlock import Interlock
from cohelm.ros.joy import JOY, JoyOperator, JoyParams
from cohelm.ros.laser import Ranges
from cohelm.ros.localized import PATH, POSE
from cohelm.ros.masks import Masks
from cohelm.ros.messages import command
from cohelm.ros.mismatch import (
    BOOL,
    CAMERA_INFO,
    CLOUD,
    FILTER_INFO,
    GRID,
    IMAGE,
    ODOMETRY,
    POLYGON,
    RANGE,
    SCAN,
    STAMPED,
    TF,
    TWIST,
)  # fmt: skip
from cohelm.ros.port import LATCHED
from cohelm.ros.served import mounts, odometry, scan
from cohelm.ros.transforms import Mount, StaticTransforms, yaw_of
from cohelm.ros.types import HAZARDS, packed, unpacked
from cohelm.scenario.load import robot as load_robot
from cohelm.scenario.zones import masked
from tests.link.fuzz import resident
from tests.ros import test_cloud, test_depth, test_goals, test_masks
from tests.ros.fuzz import Inside, wild

SALLY = load_robot("sally")
OUTLINE = [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.3)]
SHAPED = SALLY.model_copy(update={"footprint_m": OUTLINE})
LONGEST = 2.0
"""On a busy machine; a length that is believed takes minutes, or all the memory [s]."""
BUMPER = ContactModel(name="a", mount_x_m=0.3, hazard="bump_left")
DOWN = CliffModel(name="b", mount_x_m=0.3, floor_m=0.05)
TOUCHING = (
    ContactTopic(BUMPER, f"/{HAZARDS}", HAZARDS), ContactTopic(DOWN, f"/{RANGE}", RANGE),
    ContactTopic(ContactModel(name="c", mount_x_m=0.3), f"/{BOOL}", BOOL),
)  # fmt: skip
SONAR = LidarModel.model_validate({"name": "s", "range_sensor": True, "field_of_view_deg": 30})
SEEN = {
    ODOMETRY: odometry(Odometry(0.0, Pose(1, 2, 0.5), Twist(0.1, 0.2)), 5.0),
    SCAN: scan(Scan(0.0, 0, np.linspace(1.0, 5.0, 720), 0.05), SALLY, 5.0),
    CLOUD: test_cloud.cloud([[1.0, 0.0, 0.2]] * 50),
    IMAGE: test_depth.image(np.full((test_depth.CAM.height, test_depth.CAM.width), 2.0)),
    CAMERA_INFO: test_depth.told(), TF: mounts(SALLY), BOOL: Bool(True),
    TWIST: command(Twist(0.5, 0.1), TWIST, ""), STAMPED: command(Twist(0.5, 0.1), STAMPED, "b"),
    clock.TYPE: Clock(Time(5, 7)), GOAL: test_goals.goal(), POSE: test_goals.told(),
    PATH: test_goals.path((0.0, 0.0), (1.0, 0.0), (1.0, 2.0)),
    RANGE: Range(header(5, "sonar"), 0, 0.5, 0.02, 4.0, 1.0, 0.0),
    JOY: Joy(header(5, "joy"), np.array([0.0, 0.5, 0.2], np.float32), np.ones(3, np.int32)),
    POLYGON: PolygonStamped(
        header(5, "base_link"),
        Polygon([Point32(x, y, 0.0) for x, y in OUTLINE]),
    ),
    FILTER_INFO: test_masks.info(f"/{GRID}", 1), GRID: test_masks.grid(),
    HAZARDS: dict(contact_messages(TOUCHING, {"a"}, header(5, "base_link")))[f"/{HAZARDS}"],
}  # fmt: skip


def huge(rng: random.Random, data: bytes) -> bytes:
    """With a length somewhere that is none."""
    out, at = bytearray(data), 4 * rng.randrange(1, max(len(data) // 4, 2))
    out[at : at + 4] = rng.choice([2**32 - 1, 2**31, 2**31 - 1, 10**9, 10**7]).to_bytes(4, "little")
    return bytes(out)


class Listeners:
    """All that reads messages, but for the filter as a whole."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.network = Inside()
        self.goals = Goals(self.network, "map", [f"/{GOAL}", f"/{PATH}"], f"/{POSE}", say)
        self.lock = Interlock(self.network, "/out", f"/{BOOL}")
        SimulatedClock.on(self.network)
        self.commands = [
            Commands(self.network, f"/{kind}", 0.5, clock.Clock()) for kind in (TWIST, STAMPED)
        ]
        self.contacts = Contacts(self.network, TOUCHING, time.monotonic)
        self.footprint = FootprintTopic(self.network, f"/{POLYGON}", "base_link", SHAPED)
        self.joy = JoyOperator(self.network, f"/{JOY}", JoyParams(1, 2, 0))
        lidar, body = SALLY.lidar, test_depth.mounted()
        assert lidar is not None
        flat = Mount(Pose(lidar.mount_x_m, lidar.mount_y_m, 0.0), False, 0.2)
        band = lidar.model_copy(update={"height_band_m": (0.1, 0.5)})
        seen = depth.described(test_depth.CAM, body, test_depth.GIVEN, "/depth")
        self._readers: dict[str, Callable[[Any], object]] = {
            SCAN: Ranges(lidar, flat, "/scan").of, CLOUD: CloudRanges(band, np.eye(4), "/cloud").of,
            IMAGE: depth.DepthRanges(seen, test_depth.CAM, body, "/depth").of,
            CAMERA_INFO: lambda message: depth.camera(message, "/camera_info"),
            TF: lambda message: StaticTransforms().add(message),
            ODOMETRY: lambda message: yaw_of(message.pose.pose.orientation),
            RANGE: lambda message: cone.ConeRanges(
                cone.described(message, "/sonar", body, 10.0, 0.0, SONAR), body, "/sonar"
            ).of(message),
            FILTER_INFO: lambda message: self._zones(message, SEEN[GRID]),
            GRID: lambda message: self._zones(SEEN[FILTER_INFO], message),
        }  # fmt: skip

    def take(self, kind: str, data: bytes) -> str:
        """Some bytes, to all who read such a type. What is wrong; empty: nothing."""
        topic = clock.TOPIC if kind == clock.TYPE else f"/{kind}"
        self.network.deliver(topic, kind, data)
        message, _ = unpacked(data, kind)
        if message is not None and kind in self._readers:
            try:
                self._readers[kind](message)
            except CohelmError as error:
                return "" if len(str(error)) > 20 else f"no sentence: {error}"
        now = time.monotonic()
        for one in self.commands:
            if not all(map(math.isfinite, one.now(now).twist)):
                return f"a command of {one.now(now).twist}"
        outline, _ = self.footprint.read()
        if outline is not None and not np.abs(outline).max() <= 2.0 * SHAPED.reach:
            return f"an outline of {outline.tolist()}"
        steered = self.joy.receive().command
        if steered is not None and not max(map(abs, steered.stick)) <= 1.0:
            return f"a stick at {steered.stick}"
        if any(one.sensor not in "abc" for one in self.contacts.read()):
            return "a bumper that there is not"
        way, placed = self.goals.way(), self.goals.initial()
        if (
            way is not None
            and not np.isfinite([way[1].x, way[1].y] if isinstance(way[1], Goal) else way[1]).all()
        ):
            return f"a way to {way[1]}"
        if placed is not None and not np.isfinite([*placed.pose, placed.sigma]).all():
            return f"placed at {placed}"
        return ""

    def _zones(self, info: Any, grid: Any) -> None:
        network = Inside()
        masks = Masks(network, [f"/{FILTER_INFO}"], "map")
        network.publish(f"/{FILTER_INFO}", FILTER_INFO, LATCHED).send(info)
        network.publish(f"/{GRID}", GRID, LATCHED).send(grid)
        if not masked(masks.read(0.0)):
            raise ValueError("a mask that is no zone")

    def close(self) -> None:
        self.lock.close()
        self.goals.close()


def main(seconds: float, seed: int) -> list[str]:
    """What was wrong; empty: nothing."""
    rng, count, wrong = random.Random(seed), Counter[str](), list[str]()
    sentences: set[str] = set()
    listeners = Listeners(lambda said: sentences.add(said[:20]))
    sound = {kind: packed(message, kind) for kind, message in SEEN.items()}
    how = [
        wild, huge, lambda _, data: data[: rng.randrange(len(data))],
        lambda _, data: rng.randbytes(rng.randrange(2000)),
    ]  # fmt: skip
    begun, memory, slowest = time.monotonic(), 0, (0.0, "")
    while (
        (passed := time.monotonic() - begun) < seconds or not memory  # the first may take as long
    ) and len(wrong) < 20:
        kind = rng.choice(list(SEEN))
        data = rng.choice(how)(rng, sound[kind])
        at = time.monotonic()
        try:
            said = listeners.take(kind, data)
        except Exception as error:
            said = f"{error!r} of {data[:60].hex()}"
        slowest = max(slowest, (time.monotonic() - at, kind))
        count[kind] += 1
        wrong += [f"{kind}: {said}"] if said else []
        memory = memory or (resident() if passed > 0.2 * seconds else 0)
    grown = resident() - memory
    listeners.close()
    print(
        f"{sum(count.values())} messages, at least {min(count.values())} of each of {len(count)} "
        f"types; memory {memory} + {grown} kB; slowest {1e3 * slowest[0]:.0f} ms, {slowest[1]}"
    )
    if grown > 20_000:
        wrong.append(f"memory grew by {grown} kB")
    if slowest[0] > LONGEST:
        wrong.append(f"{slowest[1]} took {slowest[0]:.1f} s")
    return wrong


if __name__ == "__main__":
    found = main(
        float(sys.argv[1]) if len(sys.argv) > 1 else 600.0,
        int(sys.argv[2]) if len(sys.argv) > 2 else random.randrange(2**32),
    )
    print("\n".join(found) or "nothing wrong")
    raise SystemExit(1 if found else 0)
