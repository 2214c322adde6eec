"""A robot of which nobody knows more than its topics is found as docs/ros2.md says."""

from __future__ import annotations

import json
import re
import shlex
import threading
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from cohelm.core.types import Pose
from cohelm.robot.clock import WallClock
from cohelm.ros.dds import DdsTransport
from cohelm.ros.topics import Topics
from cohelm.scenario.load import load_robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import world
from tests.few import first
from tests.ros.stage import HALL, Tampered, alone
from tests.ros.transports import bridge

pytestmark = pytest.mark.xdist_group("bridge")  # which a worker starts once
PAGE = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text(encoding="utf-8")
DESCRIBED = re.search(r"```yaml\n(name: rover\n.*?)```", PAGE, re.DOTALL)[1]
COMMAND = re.search(r"^    cohelm (filter --robot rover.yaml .*)$", PAGE, re.MULTILINE)[1]
AHEAD = 3.2
FRAMES = {
    "base_link": "rover_12/base_footprint", "odom": "rover_12/odom", "laser": "rover_12/front_link",
    "laser_rear": "rover_12/rear_link", "laser_cloud": "rover_12/os_lidar",
}  # fmt: skip
MOUNTS = {"front": (0.42, 0.0), "rear": (-0.42, 180.0), "cloud": (0.1, 0.0)}


def its_own(_, message):
    """By a clock of its own, and with frames of its own."""
    for one in getattr(message, "transforms", [message]):
        if hasattr(one, "header"):
            one.header.stamp.sec += int(AHEAD)
            late = one.header.stamp.nanosec + round(1e9 * (AHEAD % 1.0))
            one.header.stamp.sec += late // 10**9
            one.header.stamp.nanosec = late % 10**9
            one.header.frame_id = FRAMES.get(one.header.frame_id, one.header.frame_id)
        if hasattr(one, "child_frame_id"):
            one.child_frame_id = FRAMES.get(one.child_frame_id, one.child_frame_id)
    return message


@pytest.fixture(scope="module")
def rover(tmp_path_factory):
    """Behind its topics; where its file is."""
    alone()
    file = tmp_path_factory.mktemp("rover") / "rover.yaml"
    file.write_text(DESCRIBED, encoding="utf-8")
    given = load_robot(str(file))

    def made(lidar):
        x, yaw = MOUNTS[lidar.name]
        fewer = {} if lidar.height_band_m else {"beams": 541, "rate_hz": 15.0}
        return lidar.model_copy(update={"mount_x_m": x, "mount_yaw_deg": yaw, **fewer})

    first, *others = (made(lidar) for lidar in given.lidars)
    model = given.model_copy(update={"lidar": first, "further_lidars": tuple(others)})
    robot = Kinematic(model, Pose(0.0, 0.0, 0.0), world(([], HALL)), seed=5, clock=WallClock())
    transport, over = DdsTransport("rover_driver", "/rover_12"), threading.Event()
    topics = Topics.named(
        "/rover_12", out="platform/cmd_vel", odom="base/odometry/filtered", scan="laser/front",
        further=("rear=laser/rear", "cloud=ouster/points"),
    )  # fmt: skip
    served = Tampered(its_own, transport, robot, topics, stamped=True)
    thread = threading.Thread(target=served.run, args=(over.is_set,), daemon=True)
    thread.start()
    yield file
    over.set()
    thread.join()
    transport.close()


@pytest.mark.parametrize("way", first(["dds", "foxglove"]))
def test_it_is_found_with_the_description_and_the_command_of_the_page(
    rover, way, cohelm, monkeypatch
):
    options = [] if way == "dds" else ["--url", bridge().url]
    monkeypatch.chdir(rover.parent)
    said = cohelm(*shlex.split(COMMAND), "--json", *options)
    assert said.code == 0, said.err
    found = json.loads(said.out)
    assert found["topics"]["command"] == "/rover_12/nav/cmd_vel"
    assert found["topics"]["out"] == "/rover_12/platform/cmd_vel"
    assert found["topics"]["out_type"] == "geometry_msgs/msg/TwistStamped"
    lidars = [found["robot"]["lidar"], *found["robot"]["further_lidars"]]
    assert [one["name"] for one in lidars] == ["front", "rear", "cloud"]
    assert [one["beams"] for one in lidars] == [541, 541, 720]
    assert [one["mount_x_m"] for one in lidars] == pytest.approx([0.42, -0.42, 0.1], abs=1e-3)
    assert abs(lidars[1]["mount_yaw_deg"]) == pytest.approx(180.0)
    told = " ".join(said.err.split())
    assert told.count("s ahead of this machine's: taken into account") == 4
