"""A robot behind ROS topics in a process of its own, which tests can let go wrong."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from functools import cached_property, partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Empty as Empty

from cohelm.core.types import Pose, Twist
from cohelm.robot.clock import WallClock
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.gate.modes import latched
from cohelm.robot.keep.process import RemoteGatedRobot
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import LidarModel
from cohelm.ros.connection import Connection
from cohelm.ros.filter_node import FilterNode, FilterParams, gate_rules
from cohelm.ros.found import Allowed, Found
from cohelm.ros.look import look
from cohelm.ros.messages import command
from cohelm.ros.mismatch import TWIST
from cohelm.ros.pacing import period
from cohelm.ros.port import COMMAND, Transport
from cohelm.ros.reset import APART, EMPTY
from cohelm.ros.robot import adapted
from cohelm.ros.served import ServedRobot
from cohelm.ros.topics import Topics
from cohelm.ros.types import HAZARD, store
from cohelm.scenario.load import robot as load_robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.sim.world import world
from tests.patience import looks

DOMAIN = 100 + os.getpid() % 100
NOBODYS = 200 + os.getpid() % 30
"""A domain for who must see nobody: in the tests' own, a bridge stays until their process ends."""
KILLED = 10 + os.getpid() % 80
"""A domain for who is killed: others see him there until his lease has ended."""
SLOW = "this computer is too slow"
"""Why a gate stops a robot whose commands a busy machine holds up."""
HALL = np.array([[-60, -3, 4, -3], [4, -3, 4, 3], [4, 3, -60, 3], [-60, 3, -60, -3]], np.float64)
"""The robot starts at 0, 0 and looks at the wall at x = 4; behind it is room for everything."""


def alone() -> None:
    """Processes of a test meet on this machine only, in a domain of their own."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(DOMAIN))


def named(name: str) -> RobotModel:
    """A robot; `touching` is Sally with a sonar, a bumper and a Create 3's cliff sensor."""
    if name != "touching":
        return load_robot(name)
    sally = load_robot("sally")
    sonar = LidarModel.model_validate(
        {"name": "sonar", "range_sensor": True, "field_of_view_deg": 30, "range_min_m": 0.02,
         "range_max_m": 4.0, "rate_hz": 20, "noise_m": 0.01, "mount_x_m": 0.35}
    )  # fmt: skip
    cliff = CliffModel(name="left", mount_x_m=0.25, mount_y_m=0.1, hazard="cliff_front_left")
    return sally.model_copy(
        update={
            "further_lidars": (sonar,), "cliff_sensors": (cliff,),
            "bumpers": (ContactModel(name="front", mount_x_m=0.36, width_m=0.4),),
        }
    )  # fmt: skip


class Simulator:
    """A `RobotClock` so many times as fast as the wall, which stands still while it pauses."""

    def __init__(self, rate: float) -> None:
        self._rate, self._passed, self._since = rate, 0.0, time.monotonic()
        self.pauses = False

    def due(self) -> float:
        now = time.monotonic()
        if not self.pauses:
            self._passed += self._rate * (now - self._since)
        self._since = now
        return self._passed

    def wait(self, until: float) -> None:
        while self.due() < until:
            time.sleep(0.001)


class Faults:
    """What is done to the messages of a robot."""

    def __init__(self) -> None:
        self.now, self._count = "", 0
        self._stepped_once: set[str] = set()

    def __call__(self, topic: str, message: Any) -> Any:
        self._count += 1
        if self.now.startswith("step "):
            return self._stepped(topic, message)
        match self.now, topic:
            case "no scan", "/scan":
                return None
            case "no rear scan", "/scan_rear":
                return None
            case "glass", "/scan":
                message.ranges[:] = math.inf
            case "bump", "/bumper_front":
                message.data = True
            case "drop", "/hazard_detection":
                at = type(message.header)(message.header.stamp, "cliff_front_left")
                message.detections.append(store().types[HAZARD](at, 2))
            case "no bumper", "/bumper_front":
                return None
            case "no odometry", "/odom":
                return None
            case "half", _:
                return message if self._count % 2 else None
            case "tomorrow", "/odom":
                message.header.stamp.sec += 86_400
            case "stale scan", "/scan":
                message.header.stamp.sec -= 2
            case "nan odometry", "/odom":
                message.twist.twist.linear.x = math.nan
            case "nan scan", "/scan":
                message.ranges[:] = math.nan
            case "leap", "/odom":
                message.pose.pose.position.x += 3.0
            case _:
                pass
        return message

    def _stepped(self, topic: str, message: Any) -> Any:
        """As a clock that was set stamps it: `step /odom,/scan -3600`, or `once` more for one
        message of each topic."""
        _, topics, seconds, *once = self.now.split()
        if topic in topics.split(",") and (not once or topic not in self._stepped_once):
            self._stepped_once.add(topic)
            message.header.stamp.sec += int(seconds)
        return message


class Tampered(ServedRobot):
    """One whose messages are changed before they are published, or left out."""

    def __init__(
        self, tamper: Callable[[str, Any], Any], transport: Transport, *robot: Any, **options: Any
    ) -> None:
        """tamper: of a topic and a message makes what is published instead; None: nothing."""
        self._tamper = tamper
        super().__init__(transport, *robot, **options)

    def _send(self, topic: str, message: Any) -> None:
        message = self._tamper(topic, message)
        if message is not None:
            super()._send(topic, message)


def serve(line: Any, walls: Any, name: str, options: dict[str, Any]) -> None:
    """The robot's process: `line` names faults, asks for the truth, or ends it."""
    faults, ended = Faults(), threading.Event()
    faults.now = options.pop("begins", "")
    rate = options.pop("rate", None)
    clock = WallClock() if rate is None else Simulator(rate)
    plant = {"kinematic": Kinematic, "twin": Twin}[options.pop("plant", "kinematic")]
    robot = plant(named(name), Pose(0.0, 0.0, 0.0), world(([], walls)), seed=3, clock=clock)
    transport = options.pop("way", Connection()).open("base")
    served = Tampered(faults, transport, robot, Topics(), simulated=rate is not None, **options)
    line.send("ready")

    def over() -> bool:
        while line.poll():
            asked = line.recv()
            if asked == "truth":
                line.send(robot.truth())
            elif asked == "end":
                ended.set()
            else:
                faults.now, faults._stepped_once = asked, set()
                if isinstance(clock, Simulator):
                    clock.pauses = asked == "pause"
        return ended.is_set()

    served.run(over)
    transport.close()


class Base:
    """A handle on it."""

    def __init__(self, walls: Any = HALL, robot: str = "sally", **options: Any) -> None:
        alone()
        context = get_context("spawn")
        self._line, theirs = context.Pipe()
        self.process = context.Process(
            target=serve, args=(theirs, walls, robot, options), daemon=True
        )
        self.process.start()
        theirs.close()
        assert self._line.recv() == "ready"

    def truth(self) -> Any:
        self._line.send("truth")
        return self._line.recv()

    def fault(self, name: str) -> None:
        """From now on; empty: none."""
        self._line.send(name)

    def close(self) -> None:
        if self.process.is_alive():
            self._line.send("end")
            self.process.join(5.0)
        self.process.kill()


class Controller:
    """Wants a twist, fifty times a second, from a thread."""

    def __init__(self, transport: Any, topic: str = "/cmd_vel_nav", kind: str = TWIST) -> None:
        self._out = transport.publish(topic, kind, COMMAND)
        self.twist: Twist | None = Twist(0.0, 0.0)
        self._kind, self._over = kind, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._over.is_set():
            due += 0.02
            if self.twist is not None:
                self._out.send(command(self.twist, self._kind, "base_link"))
            time.sleep(max(due - time.monotonic(), 0.0))

    def close(self) -> None:
        self._over.set()
        self._thread.join()


class Filter:
    """The node, running in a thread; its gate process in a process of its own."""

    def __init__(self, found: Found, transport: Any) -> None:
        self.rows: list[Any] = []
        self.said: list[str] = []
        length = period(found.command_period)
        self.gated = RemoteGatedRobot(partial(adapted, found), gate_rules(found.model, length))
        self.node = FilterNode(transport, self.gated, found, FilterParams(length), self.said.append)
        self.node.warm_up()
        step = self.node.step

        def kept() -> Any:
            self.rows.append(step())
            return self.rows[-1]

        self.node.step = kept
        self._over = threading.Event()
        self.fault: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.node.run(self._over.is_set)
        except BaseException as error:
            self.fault = error

    @property
    def latched(self) -> bool:
        return latched(self.gated.gate.mode)

    def close(self, robot_gone: bool = False) -> None:
        """robot_gone: the gate process, which would wait for it to stand, is killed."""
        self._over.set()
        self._thread.join(10.0)
        if robot_gone:
            os.kill(self.gated.pid, signal.SIGKILL)
        self.gated.close()


def until(true: Callable[[], bool], within: float = 20.0) -> bool:
    """Whether something has become true by then.

    A bridge that hung is killed after 3 s and begins anew; what it had on DDS is gone after 10 s.
    """
    return any(true() for _ in looks(within, 0.01, 0.5))


def resetting(transport: Transport) -> Callable[[], None]:
    """Asks the filter for a reset when it is called, but no sooner again than one counts."""
    publisher, last = transport.publish("/cohelm_filter/reset", EMPTY, COMMAND), -math.inf

    def reset() -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > APART + 0.1:
            last = now
            publisher.send(Empty(0))

    return reset


class Stage:
    """Robot, filter and controller."""

    def __init__(
        self, walls: Any = HALL, way: Connection | None = None, robot: str = "sally",
        theirs: Connection | None = None, footprint: str = "", **options: Any,
    ) -> None:  # fmt: skip
        """way: from the filter to the robot. theirs: of robot and controller."""
        way, theirs = way or Connection(), theirs or Connection()
        self.base = Base(walls, robot, way=theirs, **options)
        self.theirs, self.ours = theirs.open("controller"), way.open("cohelm_filter")
        self.controller = Controller(self.theirs)
        topics = Topics(footprint=footprint)
        self.found = look(self.ours, named(robot), topics, Allowed())._replace(connection=way)
        self.filter = Filter(self.found, self.ours)
        self.robot_gone = False
        """Said by a test that has taken robot or way to it away for good."""

    def speed(self) -> float:
        return abs(self.base.truth().twist.v)

    @cached_property
    def reset(self) -> Callable[[], None]:
        """See `resetting`."""
        return resetting(self.theirs)

    def drives(self, v: float = 0.5, omega: float = 0.0) -> bool:
        """Whether it does, once it is asked to; after a reset where tests beside it held it up."""
        self.controller.twist = Twist(v, omega)

        def fast() -> bool:
            if self.filter.latched and SLOW in self.filter.gated.gate.reason:
                self.reset()
            return self.speed() > 0.6 * abs(v)

        return until(fast)

    def turned_round(self) -> bool:
        """Whether it looks down the hall, after it has turned round if it did not."""
        if math.cos(self.base.truth().pose.psi) > -0.95:
            self.controller.twist = Twist(0.0, 1.5)
            until(lambda: math.cos(self.base.truth().pose.psi) < -0.97)
            self.controller.twist = Twist(0.0, 0.0)
        return math.cos(self.base.truth().pose.psi) < -0.9

    def stands(self, within: float = 8.0) -> bool:
        return until(lambda: self.speed() < 0.005, within)

    def close(self) -> None:
        self.filter.close(self.robot_gone)
        for one in (self.controller, self.ours, self.theirs, self.base):
            one.close()


@contextmanager
def stage(walls: Any = HALL, **options: Any) -> Any:
    made = Stage(walls, **options)
    try:
        yield made
    finally:
        made.close()
    assert made.filter.fault is None
