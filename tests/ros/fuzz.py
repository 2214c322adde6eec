"""Bytes that are no messages, or messages that make no sense, on every topic that the filter hears.

As a program: python -m tests.ros.fuzz [SECONDS [SEED]]; ends with 1 if anything was wrong. A robot
drives meanwhile; between its true messages come damaged ones, and damaged ones alone before it is
known. All but the network's own code runs: bytes, types, looking, robot, filter, gate.
"""

from __future__ import annotations

import math
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    std_msgs__msg__Bool as Bool,
)

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.clock import WallClock
from cohelm.robot.gate.modes import latched
from cohelm.robot.keep.gated_robot import LocalGatedRobot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings
from cohelm.ros import look as looking
from cohelm.ros.connection import Connection
from cohelm.ros.filter_node import FilterNode, FilterParams, gate_rules
from cohelm.ros.found import Allowed
from cohelm.ros.inspection import Inspection
from cohelm.ros.look import look
from cohelm.ros.messages import command
from cohelm.ros.mismatch import BOOL, CLOUD, ODOMETRY, SCAN, STAMPED, TF, TWIST
from cohelm.ros.port import COMMAND, LATCHED, Callback, End, Endpoint, Qos, Received
from cohelm.ros.robot import Ros2Robot
from cohelm.ros.served import ServedRobot
from cohelm.ros.topics import Topics
from cohelm.ros.types import packed, unpacked
from cohelm.scenario.load import robot as load_robot
from cohelm.sim.kinematic import Kinematic, KinematicTruth
from cohelm.sim.world import world
from tests.link.fuzz import mutated, resident
from tests.ros.stage import HALL, resetting, until

EMPTY = "std_msgs/msg/Empty"
TOPICS = {
    "/odom": ODOMETRY, "/scan": SCAN, "/tf_static": TF, "/cmd_vel_nav": TWIST,
    "/scan_rear": CLOUD, "/emergency_stop": BOOL, "/cohelm_filter/reset": EMPTY,
}  # fmt: skip
PERIOD = 0.02
PATIENT = 20.0
"""So long after the last damaged message it may take to drive: it crawls until its senses agree
again over some way [s]."""
AWAY = Twist(-0.4, 0.0)
"""Where there is room. Wishes that come and go would keep it from going any way."""


class Inside:
    """A transport within one process: what is sent becomes bytes, and from them a message."""

    name, unseen = "inside", "nothing"

    def __init__(self) -> None:
        self._heard: list[tuple[str, str, Callable[[Received], None]]] = []
        self._ends: list[Endpoint] = []
        self.last: dict[tuple[str, str], bytes] = {}

    def deliver(self, topic: str, kind: str, data: bytes) -> None:
        """Bytes to all who subscribe."""
        message, damage = unpacked(data, kind)
        for name, wanted, heard in list(self._heard):
            if (name, wanted) == (topic, kind):
                heard(Received(message, time.monotonic(), damage))

    def publish(self, topic: str, kind: str, qos: Qos) -> Any:
        self._ends.append(Endpoint(topic, kind, qos, True, "/inside"))

        def send(message: Any) -> None:
            self.last[topic, kind] = packed(message, kind)
            self.deliver(topic, kind, self.last[topic, kind])

        return type("Publisher", (), {"send": staticmethod(send)})()

    def subscribe(self, topic: str, kind: str, qos: Qos, heard: Callback) -> End:
        subscriber = (topic, kind, heard)
        self._heard.append(subscriber)
        self._ends.append(Endpoint(topic, kind, qos, False, "/inside"))
        if qos.transient_local and (topic, kind) in self.last:
            self.deliver(topic, kind, self.last[topic, kind])
        return lambda: self._heard.remove(subscriber)

    def endpoints(self) -> list[Endpoint]:
        return [one for one in self._ends if not (one.publishes and one.topic == "/cmd_vel")]

    def lost(self) -> str:
        return ""

    def close(self) -> None: ...


class Shared(Kinematic):
    """A simulated robot whose truth another thread asks for than the one that serves it."""

    lock = threading.RLock()

    def read(self) -> Readings:
        with self.lock:
            return super().read()

    def send(self, twist: Twist) -> None:
        with self.lock:
            super().send(twist)

    def stop(self) -> None:
        with self.lock:
            super().stop()

    def truth(self) -> KinematicTruth:
        with self.lock:
            return super().truth()


def wild(rng: random.Random, data: bytes) -> bytes:
    """Damaged, or a whole message of numbers that make no sense."""
    how = rng.random()
    if how < 0.1:
        return rng.randbytes(rng.choice([0, 1, 3, 4, 8, 100, 5000]))
    if how < 0.3 and len(data) > 12:  # all numbers of a stretch
        out = bytearray(data)
        at = rng.randrange(4, len(out) - 8)
        value = rng.choice([math.nan, math.inf, -math.inf, 1e300, -1.0, 0.0, 1e-300])
        out[at : at + 8] = np.float64(value).tobytes()
        return bytes(out)
    return mutated(data, rng)


def with_clouds(model: RobotModel) -> RobotModel:
    """The same robot, whose rear LiDAR sends point clouds, with a depth camera in front."""
    (rear,) = model.further_lidars
    deep = rear.model_copy(update={"height_band_m": (0.1, 0.5)})
    depth = deep.model_copy(
        update={"name": "depth", "depth_image": True, "field_of_view_deg": 80.0, "beams": 80,
                "mount_x_m": 0.3, "mount_yaw_deg": 0.0, "range_max_m": 4.0}
    )  # fmt: skip
    return model.model_copy(update={"further_lidars": (deep, depth)})


def main(seconds: float, seed: int, driven: bool = True) -> list[str]:
    """What was wrong; empty: nothing. driven: whether a controller is there, and damaged commands
    come too; else it must not move at all."""
    rng, count, wrong = random.Random(seed), Counter[str](), []
    network, model = Inside(), with_clouds(load_robot("sally-rear"))
    robot = Shared(model, Pose(0.0, 0.0, 0.0), world(([], HALL)), seed=3, clock=WallClock())
    base = ServedRobot(network, robot, Topics())
    controller = network.publish("/cmd_vel_nav", TWIST, COMMAND)
    lock = network.publish("/emergency_stop", BOOL, LATCHED)
    reset = resetting(network)
    lock.send(Bool(False))
    over = threading.Event()
    thread = threading.Thread(target=lambda: base.run(over.is_set), daemon=True)
    thread.start()
    try:
        found = _found(network, model, rng, count, wrong)
        rules = gate_rules(found.model, PERIOD)
        gated = LocalGatedRobot(RobotAdapter(Ros2Robot(found.model, found, network)), rules)
        node = FilterNode(network, gated, found, FilterParams(PERIOD))
        node.warm_up()
        node.may_drive = True
        begun, drove, memory = time.monotonic(), 0, 0
        wanted, due, row = Twist(0.5, 0.0), begun, node.step()
        topics = [one for one in TOPICS if driven or one != "/cmd_vel_nav"]
        while (passed := time.monotonic() - begun) < seconds or (
            driven and not drove and passed < seconds + PATIENT
        ):
            quiet = passed > seconds or int(passed / 4.0) % 2  # four seconds of each
            for _ in range(0 if quiet else rng.randint(0, 12)):
                topic = rng.choice(topics)
                kind = TWIST if topic != "/cmd_vel_nav" else rng.choice([TWIST, STAMPED])
                kind = kind if topic == "/cmd_vel_nav" else TOPICS[topic]
                data = network.last.get((topic, kind), b"\0\1\0\0")
                network.deliver(topic, kind, wild(rng, data))
                count[topic] += 1
            if passed > seconds:
                wanted = AWAY
            elif rng.random() < 0.02:
                wanted = Twist(rng.uniform(-0.5, 0.8), rng.uniform(-1.0, 1.0))
            if driven:
                controller.send(command(wanted, TWIST, ""))
            lock.send(Bool(False))
            row = node.step()
            sent = row.applied
            if not (abs(sent.v) <= model.limits.speed_mps + 1e-9 and math.isfinite(sent.omega)):
                wrong.append(f"sent {sent}")
            if quiet and latched(gated.gate.mode):
                reset()
                count["resets"] += 1
            drove += abs(robot.truth().twist.v) > 0.05
            memory = memory or (resident() if passed > 0.2 * seconds else 0)
            due += PERIOD
            time.sleep(max(due - time.monotonic(), 0.0))
        grown = resident() - memory
        print(
            f"{sum(count.values())} messages {dict(count)}; memory {memory} + {grown} kB; drove "
            f"{drove} periods; nearest while moving {robot.truth().least_moving:.3f} m"
        )
        if not driven and robot.truth().pose != Pose(0.0, 0.0, 0.0):
            wrong.append(f"nobody commanded, and it went to {robot.truth().pose}")
        if driven and not drove:
            wrong.append(f"it never drove: {gated.gate.mode.name}, {row.reason}")
        if grown > 20_000:
            wrong.append(f"memory grew by {grown} kB")
        if robot.truth().least_moving <= 0.0:
            wrong.append("it touched the wall while it moved")
    except Exception as error:
        wrong.append(f"{type(error).__name__}: {error}")
        raise
    finally:
        over.set()
        thread.join()
    return wrong


def _found(
    network: Inside, model: Any, rng: random.Random, count: Counter[str], wrong: list[str]
) -> Any:
    """What looking finds; before that, looks at damaged messages: a refusal in words, no more."""
    looked = ["/odom", "/scan", "/scan_rear", "/tf_static"]
    assert until(lambda: all((one, TOPICS[one]) in network.last for one in looked), 60.0)
    for _ in range(20):
        heard = Inspection(network, Topics(), model)
        for _ in range(60):
            topic = rng.choice(looked)
            network.deliver(topic, TOPICS[topic], wild(rng, network.last[topic, TOPICS[topic]]))
            count["looked at"] += 1
        try:
            looking.found(heard, network, model, Allowed(), Connection())
        except CohelmError as error:
            if len(str(error)) < 20:
                wrong.append(f"no sentence: {error}")
        heard.end()
    return look(network, model, Topics(), Allowed())


if __name__ == "__main__":
    said = main(
        float(sys.argv[1]) if len(sys.argv) > 1 else 600.0,
        int(sys.argv[2]) if len(sys.argv) > 2 else random.randrange(2**32),
    )
    print("\n".join(said) or "nothing wrong")
    raise SystemExit(1 if said else 0)
