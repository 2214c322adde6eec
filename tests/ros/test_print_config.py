"""What was found of a ROS 2 robot is printed, for `cohelm filter` and `cohelm robot` alike."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from cohelm.drive.operate import DriveOptions, Ros2Config, robot_factory
from cohelm.robot.model import RobotModel
from cohelm.ros.dds import DdsTransport
from cohelm.ros.goals import GOAL
from cohelm.ros.mismatch import BOOL, POLYGON, TWIST
from cohelm.ros.port import COMMAND, LATCHED, SENSOR
from cohelm.scenario.load import parse
from tests.ros.stage import Base

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.fixture(scope="module")
def base():
    made = Base()
    panel = DdsTransport("panel")
    for topic, kind in (("/emergency_stop", BOOL), ("/arm/outline", POLYGON)):
        panel.publish(topic, kind, LATCHED)
    panel.publish("/goal_pose", GOAL, COMMAND)
    panel.subscribe("/cmd_vel", TWIST, SENSOR, lambda _: None)
    yield made
    panel.close()
    made.close()


OPTIONS = ("--topic", "footprint=/arm/outline", "--goals-from", "goal_pose", "--joy", "/joy")


def test_a_robots_topics_types_qos_and_transport_are_printed_and_nothing_is_driven(base, cohelm):
    said = cohelm("robot", "lab-guard", "--ros2", *OPTIONS, "--print-config")
    assert said.code == 0, said.err
    lines = said.out.splitlines()
    scan = "# scan: /scan, sensor_msgs/msg/LaserScan by /base (best effort, volatile)"
    assert scan in lines
    (out,) = (one for one in lines if one.startswith("# out: /cmd_vel, "))
    assert f"{TWIST} wanted by /base (" in out
    assert f"{TWIST} wanted by /panel (best effort, volatile)" in out
    assert f"# lock: /emergency_stop, {BOOL} by /panel (reliable, transient local)" in lines
    assert f"# footprint: /arm/outline, {POLYGON} by /panel (reliable, transient local)" in lines
    assert f"# goals: /goal_pose, {GOAL} by /panel (reliable, volatile)" in lines
    assert "# joy: /joy, no publisher" in lines
    assert not any(one.startswith("# command") for one in lines)  # only a filter has a controller
    assert "because cyclonedds is installed" in " ".join(said.err.split())
    assert "footprint: /arm/outline by /panel" in " ".join(said.err.split())
    assert parse(said.out, RobotModel, "printed").lidar.beams == 720
    assert base.truth().twist.v == 0.0


def test_filter_and_robot_are_described_alike_in_json(base, cohelm):
    robot = json.loads(cohelm("robot", "lab-guard", "--ros2", "--print-config", "--json").out)
    found = json.loads(cohelm("filter", "--robot", "sally", "--print-config", "--json").out)
    assert found["topics"].pop("command") == "/cmd_vel_nav"
    for one in (robot, found):
        assert one["transport"]["kind"] == "dds"
        assert "cyclonedds" in one["transport"]["why"]
    assert robot["topics"] == found["topics"]
    assert robot["topics"]["out_type"] == TWIST
    first = {key: value for key, value in robot["ends"][0].items() if key != "reliable"}
    assert first == {
        "for": "out", "topic": "/cmd_vel", "type": TWIST, "node": first["node"],
        "transient_local": False,
    }  # fmt: skip


def test_a_robots_emergency_stop_may_have_a_time_out_too(base):
    def found(*topics: str, silence: float):
        where = Ros2Config(topics, lock_silence=silence)
        options = DriveOptions("lab-guard", "lab-guard", "kinematic", True, None, [], ros2=where)
        return robot_factory(options).make.found

    assert found(silence=0.7).lock_silence == 0.7
    with pytest.raises(Exception, match="--lock-timeout, and no lock"):
        found("lock=", silence=0.7)
