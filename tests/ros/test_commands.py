"""`cohelm filter` and `cohelm base` from the command line; a filter that dies leaves no robot
moving."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped

from cohelm.core.frames import compose
from cohelm.core.types import Pose, Twist
from cohelm.record.ros2 import header, pose
from cohelm.robot.model import shipped_path
from cohelm.ros.clock import seconds
from cohelm.ros.dds import DdsTransport
from cohelm.ros.goals import GOAL
from cohelm.ros.messages import STRING
from cohelm.ros.mismatch import ODOMETRY, TF
from cohelm.ros.port import COMMAND, LATCHED, SENSOR
from cohelm.ros.transforms import yaw_of
from tests.ros.stage import KILLED, NOBODYS, Base, Controller, alone, until
from tests.ros.test_masks import Filter, grid, info


def cohelm(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "cohelm", *arguments], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@contextmanager
def served(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """`cohelm base`, once it serves: it may compile first, or MuJoCo take its time."""
    with cohelm("base", *arguments, "--json") as process:
        lines = process.stderr or []
        if not any("listens on" in line for line in lines):
            raise AssertionError(f"cohelm base {' '.join(arguments)} did not begin")
        yield process


def test_without_nodes_the_advice_names_what_to_check(monkeypatch, cohelm):
    alone()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(NOBODYS))
    said = cohelm("filter", "--robot", "sally", "--wait", "2")
    assert said.code == 2
    assert "no node of ROS is seen" in " ".join(said.err.split())


@pytest.fixture
def driven():
    base = Base()
    transport = DdsTransport("controller")
    controller = Controller(transport)
    controller.twist = Twist(0.5, 0.0)
    yield base
    controller.close()
    transport.close()
    base.close()


@pytest.mark.slow
def test_it_drives_a_base_that_stands_when_it_is_killed(driven):
    config = cohelm("filter", "--robot", "sally", "--print-config", "--json")
    out, said = config.communicate(timeout=240.0)
    found = json.loads(out)
    assert config.returncode == 0, said
    assert found["topics"]["out_type"] == "geometry_msgs/msg/Twist"
    assert found["robot"]["lidar"]["beams"] == 720
    with cohelm("filter", "--robot", "sally") as process:
        try:
            assert until(lambda: driven.truth().twist.v > 0.3, 240.0)
            os.kill(process.pid, signal.SIGKILL)
            killed = time.monotonic()
            assert until(lambda: driven.truth().twist.v < 0.01, 3.0)
            assert time.monotonic() - killed < 2.0
        finally:
            process.kill()
            process.communicate()
    assert driven.truth().least_moving > 0.05


def test_all_of_cohelm_sets_off_in_the_lab_on_physics_behind_ros_topics_and_killed_it_stands(
    monkeypatch, tmp_path
):
    """Loop, plan and gate on one side of DDS, MuJoCo on the other; the gate's process ends too. It
    has no camera: to draw what nobody looks at takes most of a core."""
    alone()
    blind = tmp_path / "blind.yaml"
    sally = yaml.safe_load(Path(shipped_path("sally")).read_text(encoding="utf-8"))
    blind.write_text(yaml.safe_dump(sally | {"camera": None}), encoding="utf-8")
    there = (str(blind), "--scenario", "lab-guard")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(KILLED))
    listener, moved = DdsTransport("listener"), list[Twist]()

    def hear(received):
        twist = received.message.twist.twist
        moved.append(Twist(twist.linear.x, twist.angular.z))

    listener.subscribe("/odom", ODOMETRY, SENSOR, hear)
    with served(*there, "--twin") as base:
        try:
            asked = "--ros2 --mode automatic --for 60 --json"
            with cohelm("robot", *there, *asked.split()) as process:
                under_way = until(lambda: sum(t.v for t in moved) > 0.5 * 50.0, 120.0)  # 0.5 m
                process.send_signal(signal.SIGKILL)
                said = process.communicate(timeout=60.0)[1]
            assert under_way, said
            assert until(lambda: abs(moved[-1].v) + abs(moved[-1].omega) < 0.01, 3.0), moved[-1]
        finally:
            base.send_signal(signal.SIGINT)
            truth = json.loads(base.communicate(timeout=60.0)[0])
            listener.close()
    assert truth["least_clearance_moving_m"] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "kind"),
    [("sally", ""), ("sally", "--sim-time"), ("sally", "--twin"), ("sally-depth", "")],
)
def test_all_of_cohelm_drives_a_site_with_a_robot_behind_ros_topics(robot, kind):
    """Loop, plan and gate on one side of DDS, the simulated robot on the other. A camera that sees
    76 degrees makes it look for other ways: mostly 50 to 80 s, some 95 s at most by now."""
    alone()
    rviz, placed = DdsTransport("rviz"), dict[float, Pose]()
    moved = dict[float, Pose]()

    def hear(received):
        for one in received.message.transforms:
            at, stamp = one.transform, seconds(one.header.stamp)
            known = {"odom": placed, "base_link": moved}.get(one.child_frame_id, {})
            known[stamp] = Pose(at.translation.x, at.translation.y, yaw_of(at.rotation))

    rviz.subscribe("/tf", TF, SENSOR, hear)
    there = (robot, "--scenario", "lab-guard")
    with served(*there, *kind.split()) as base:
        try:
            asked = "--ros2 --mode automatic --arrive --for 180"
            with cohelm("robot", *there, "--json", *asked.split()) as process:
                out, said = process.communicate(timeout=600.0)  # it may compile first
        finally:
            base.send_signal(signal.SIGINT)
            truth = json.loads(base.communicate(timeout=30.0)[0])
            rviz.close()
    assert out, said
    told = json.loads(out)
    assert truth["least_clearance_moving_m"] > 0.05
    if re.search("ms old|after its stamp|no valid command", told["reason"]):
        pytest.skip(f"this machine is too busy for it: {told['reason']}")
    assert told["arrived"], (told["reason"], told["overruns"], said)
    assert not told["lost"]
    at = compose(placed[max(placed)], moved[max(moved)])
    assert math.hypot(at.x - truth["x_m"], at.y - truth["y_m"]) < 0.1
    assert abs(math.remainder(at.psi - truth["heading_rad"], math.tau)) < 0.05
    # each is of the time of an odometry, to some ms
    off = [min(abs(stamp - other) for other in moved) for stamp in sorted(placed)[10:-10]]
    assert sorted(off)[len(off) // 2] < 0.02


@pytest.mark.slow
def test_a_robot_behind_ros_topics_stands_until_a_goal_comes_and_drives_there():
    """One in a wall or in a keep-out zone of Nav2's is refused, on stderr and on a topic; one that
    is free is driven to."""
    alone()
    rviz, reasons = DdsTransport("rviz"), list[str]()
    rviz.subscribe(
        "/cohelm_robot/reason", STRING, LATCHED,
        lambda received: reasons.append(received.message.data),
    )  # fmt: skip
    out = rviz.publish("/goal_pose", GOAL, COMMAND)
    nav2 = Filter(rviz, "")
    nav2.info.send(info())
    nav2.grid.send(grid(np.full((10, 10), 100, np.int8), 0.1, (6.0, -2.0, 0.0)))

    def asked(x: float, y: float, answer: str) -> bool:
        goal = PoseStamped(header(0, "map"), pose(x, y, 0.0))
        return until(lambda: out.send(goal) or time.sleep(0.5) or answer in "".join(reasons), 300.0)

    with served("lab-guard") as base:
        try:
            wanted = "lab-guard --ros2 --goals-from /goal_pose --for 45 --json"
            zones = ("--masks-from", "/costmap_filter_info")
            with cohelm("robot", *wanted.split(), *zones) as process:
                assert asked(6.5, -1.5, "the goal 6.5, -1.5 is in a keep-out zone")
                assert asked(4.0, 3.0, "is in a wall, or too near to one")
                assert asked(3.0, -1.0, "accepted: the robot follows it")
                out_, said = process.communicate(timeout=400.0)
        finally:
            base.send_signal(signal.SIGINT)
            truth = json.loads(base.communicate(timeout=30.0)[0])
            rviz.close()
    told = json.loads(out_)
    assert truth["least_clearance_moving_m"] > 0.05
    assert "/goal_pose: accepted: the robot follows it" in said
    if re.search("ms old|after its stamp|no valid command", told["reason"]):
        pytest.skip(f"this machine is too busy for it: {told['reason']}")
    assert math.hypot(truth["x_m"] - 3.0, truth["y_m"] + 1.0) < 0.3, (told, said)
