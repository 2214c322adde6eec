"""A robot and a controller that speak another vendor's DDS (Fast DDS, from Debian): found, heard,
filtered, and stopped for what goes wrong."""

from __future__ import annotations

import contextlib
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.ros.dds import DdsTransport
from cohelm.ros.look import look
from cohelm.ros.masks import KEEP_OUT, Masks
from cohelm.ros.messages import command
from cohelm.ros.mismatch import FILTER_INFO, GRID, ODOMETRY, SCAN, TWIST
from cohelm.ros.port import COMMAND, SENSOR
from cohelm.ros.report import NODE
from cohelm.ros.topics import Topics
from cohelm.ros.types import packed
from cohelm.scenario.load import robot as load_robot
from tests.ros.stage import KILLED, Filter, alone, resetting, until
from tests.ros.test_masks import CELLS, grid, info

pytestmark = pytest.mark.xdist_group("realtime")
PROGRAM = Path(__file__).parents[2] / ".venv/fastdds/peer"
if not PROGRAM.exists():
    pytest.skip(
        "Fast DDS is not here: apt-get install g++ libfastrtps-dev libfastcdr-dev (Debian 12), "
        "rm .venv/.fastdds, and make test builds what speaks it (tools/peer.sh)",
        allow_module_level=True,
    )
SALLY = load_robot("sally")
ROOM = (3.0, 3.0, 2.6, 60.0)
"""To the left, to the right, ahead and behind where it starts [m]."""


class Peer:
    """The process with robot and controller."""

    def __init__(self, folder: Path) -> None:
        lidar, limits = SALLY.lidar, SALLY.bounds()
        view = -2.0 * lidar.lidar().first
        self.mask = grid(np.resize(CELLS, (150, 200)))  # in many packets
        (folder / "robot").write_text(
            f"{SALLY.outline[:, 0].max()} {SALLY.outline[:, 1].max()} {lidar.mount_x_m} "
            f"{lidar.beams} {view} {lidar.range_max_m} {SALLY.delay_s} {limits.wheel_acceleration} "
            f"{limits.track} {' '.join(map(str, ROOM))}"
        )
        (folder / "info").write_bytes(packed(info(), FILTER_INFO))
        (folder / "mask").write_bytes(packed(self.mask, GRID))
        (folder / "rubbish").write_bytes(b"\x00\x01\x00\x00" + b"\xff" * 21)
        alone()
        self.process = subprocess.Popen(
            [PROGRAM, str(KILLED), folder], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self.process.stdout.readline() == "ready\n"

    def say(self, line: str) -> None:
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def ask(self, line: str) -> str:
        self.say(line)
        return self.process.stdout.readline().strip()

    def truth(self) -> list[float]:
        """x, heading, speed, clearance, and the least one while it moved."""
        return [float(word) for word in self.ask("truth").split()]

    def close(self) -> None:
        with contextlib.suppress(BrokenPipeError):  # it has been killed
            self.process.stdin.close()
        self.process.wait(10.0)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def peer(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(KILLED))
        made = Peer(tmp_path_factory.mktemp("peer"))
        yield made
        made.close()


@pytest.fixture
def transport(peer):
    made = DdsTransport(NODE)
    yield made
    made.close()


def test_its_odometry_scans_and_mounts_are_found_and_it_hears_its_commands(peer, transport):
    found = look(transport, SALLY, Topics())
    assert found.out_type == TWIST
    assert found.model.lidar.beams == 720
    assert found.model.lidar.mount_x_m == pytest.approx(SALLY.lidar.mount_x_m)
    assert found.model.odometry.rate_hz == pytest.approx(50.0, rel=0.3)
    heard = []
    transport.subscribe("/scan", SCAN, SENSOR, heard.append)
    assert until(lambda: bool(heard))
    ahead = heard[0].message.ranges[359:361]
    assert ahead == pytest.approx(ROOM[2] - SALLY.lidar.mount_x_m, abs=0.05)
    back = []
    transport.subscribe("/heard", TWIST, SENSOR, back.append)
    out = transport.publish("/cmd_vel", TWIST, COMMAND)
    assert until(lambda: out.send(command(Twist(0.25, -0.5), TWIST, "")) or bool(back))
    assert back[0].message.linear.x == 0.25
    assert back[0].message.angular.z == -0.5


def test_its_masks_are_received_by_late_subscribers(peer, transport):
    masks = Masks(transport, ("costmap_filter_info",), "map")
    (mask,) = masks.read(20.0)
    assert mask[:4] == ("/costmap_filter_info", "/filter_mask", KEEP_OUT, 0.0)
    assert mask.cells.shape == (150, 200)
    assert mask.cells.tobytes() == peer.mask.data.tobytes()


def test_invalid_messages_of_a_client_harm_nothing(peer, transport):
    rubbish, sound = [], []
    transport.subscribe("/rubbish", TWIST, SENSOR, rubbish.append)
    transport.subscribe("/odom", ODOMETRY, SENSOR, sound.append)
    assert until(lambda: len(sound) > 50)  # most of it cyclonedds drops by itself
    assert all(received.message is None and received.damage for received in rubbish)


def test_an_incompatible_quality_of_service_is_reported(peer, transport):
    with pytest.raises(CohelmError) as error:
        look(transport, SALLY, Topics(out="/strict_cmd_vel"))
    assert "commands on /strict_cmd_vel never reach the base" in str(error.value)
    assert "volatile and the subscriber wants transient local" in str(error.value)


def test_it_sees_nodes_topics_and_hashes_as_ros_does(peer):
    """By its own reading of what nodes of ROS 2 tell each other. (That one has left it hears when
    the lease is over: Fast DDS 2.9 passes over what cyclonedds says then.)"""
    transport = DdsTransport("looked_at", "/space")
    transport.publish("/cmd_vel", TWIST, COMMAND)
    end = transport.subscribe("/scan", SCAN, SENSOR, lambda _: None)
    hashes = "typehash=RIHS01_[0-9a-f]{64};"

    def seen(*lines: str) -> bool:
        said = peer.ask("graph")
        return all(re.search(rf"(^|\|)/space/looked_at {line}\|", said) for line in lines)

    out = rf"publishes rt/cmd_vel geometry_msgs::msg::dds_::Twist_ reliable volatile {hashes}"
    into = rf"subscribes rt/scan sensor_msgs::msg::dds_::LaserScan_ best-effort volatile {hashes}"
    assert until(lambda: seen(out, into)), peer.ask("graph")
    end()
    assert until(lambda: not seen(into))
    assert seen(out)
    transport.close()


def test_behind_the_filter_it_stops_for_a_wall_and_for_faults(peer, transport):
    """Twist in, Twist out, and both ends are another vendor's; at last they are killed."""
    found = look(transport, SALLY, Topics())
    made = Filter(found, transport)
    reset = resetting(transport)

    def drives() -> bool:
        if made.latched:
            reset()
        return abs(peer.truth()[2]) > 0.05

    def goes(v: float) -> None:
        made.said.clear()
        peer.say("fault none")
        peer.say(f"want {v} 0")
        assert until(drives), made.said

    def stands(words: str) -> None:
        assert until(lambda: abs(peer.truth()[2]) < 0.005, 3.0), peer.truth()
        said = until(lambda: any(re.search(words, one) for one in list(made.said)), 3.0)
        assert said, made.said

    try:
        goes(0.3)
        peer.say("hush")
        stands("no command on /cmd_vel_nav for 0.")
        goes(1.0)
        peer.say("fault half")
        time.sleep(0.5)
        goes(1.0)
        assert until(lambda: peer.truth()[3] < 0.5), (peer.truth(), made.said)
        stands("limited by an obstacle|brakes for an obstacle")
        clearance, least = peer.truth()[3:]
        assert 0.015 < least < 0.4  # the promise is half of the hard margin
        assert least < clearance + 0.001  # it may settle by micrometres, which is not moving
        goes(-0.3)
        peer.say("fault tomorrow")
        stands("from the future: a clock jumped")
        goes(-0.3)
        peer.process.kill()
        assert until(lambda: made.rows[-1].applied == Twist(0.0, 0.0), 3.0)
        assert until(lambda: any("odometry is" in one for one in list(made.said)), 3.0), made.said
        assert made.fault is None
    finally:
        made.close(robot_gone=True)
