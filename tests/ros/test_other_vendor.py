"""A robot that speaks another vendor's DDS (Fast DDS, from Debian): found, heard, commanded."""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from cohelm.core.types import Pose, Twist
from cohelm.robot.port import Odometry, Scan
from cohelm.ros.dds import DdsTransport
from cohelm.ros.look import look
from cohelm.ros.masks import KEEP_OUT, Masks
from cohelm.ros.messages import command
from cohelm.ros.mismatch import FILTER_INFO, GRID, ODOMETRY, SCAN, TF, TWIST
from cohelm.ros.port import COMMAND, SENSOR
from cohelm.ros.served import mounts, odometry, scan
from cohelm.ros.topics import Topics
from cohelm.ros.types import packed
from cohelm.scenario.load import robot as load_robot
from tests.ros.stage import DOMAIN, alone, until
from tests.ros.test_masks import CELLS, grid, info

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]
HEADER = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
SALLY = load_robot("sally")


@pytest.fixture(scope="module")
def peer(tmp_path_factory):
    if not HEADER.exists() or shutil.which("g++") is None:
        pytest.skip("needs Fast DDS and a compiler: apt-get install libfastrtps-dev libfastcdr-dev")
    folder = tmp_path_factory.mktemp("peer")
    source, program = Path(__file__).with_name("peer.cpp"), folder / "peer"
    libraries = ("-lfastrtps", "-lfastcdr", "-pthread")
    subprocess.run(["g++", "-std=c++17", source, "-o", program, *libraries], check=True)
    ahead = time.time()
    rays = np.linspace(1.0, 5.0, 720)
    sent = {
        "odom": (ODOMETRY, odometry(Odometry(0.0, Pose(1, 2, 0.5), Twist(0.1, 0.2)), ahead)),
        "scan": (SCAN, scan(Scan(0.0, 0, rays, 0.05), SALLY, ahead)),
        "tf": (TF, mounts(SALLY)),
        "info": (FILTER_INFO, info()),
        "mask": (GRID, grid(np.resize(CELLS, (150, 200)))),  # in many packets
    }
    for name, (kind, message) in sent.items():
        (folder / name).write_bytes(packed(message, kind))
    (folder / "rubbish").write_bytes(b"\x00\x01\x00\x00" + b"\xff" * 21)
    alone()
    with subprocess.Popen(
        [program, str(DOMAIN), folder], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == "ready\n"
        yield sent
        process.stdin.close()
        assert process.wait(10.0) == 0


def test_its_odometry_scans_and_mounts_are_found_and_it_hears_its_commands(peer):
    transport = DdsTransport("filter", domain=DOMAIN)
    found = look(transport, SALLY, Topics())
    assert found.out_type == TWIST
    assert found.model.lidar.beams == 720
    assert found.model.lidar.mount_x_m == pytest.approx(SALLY.lidar.mount_x_m)
    assert found.model.odometry.rate_hz == pytest.approx(50.0, rel=0.3)
    heard = []
    transport.subscribe("/scan", SCAN, SENSOR, heard.append)
    assert until(lambda: bool(heard))
    assert heard[0].message.ranges.tobytes() == peer["scan"][1].ranges.tobytes()
    back = []
    transport.subscribe("/heard", TWIST, SENSOR, back.append)
    out = transport.publish("/cmd_vel", TWIST, COMMAND)
    assert until(lambda: out.send(command(Twist(0.25, -0.5), TWIST, "")) or bool(back))
    assert back[0].message.linear.x == 0.25
    assert back[0].message.angular.z == -0.5
    transport.close()


def test_its_masks_are_heard_by_who_comes_later(peer):
    transport = DdsTransport("cohelm_robot", domain=DOMAIN)
    masks = Masks(transport, ("costmap_filter_info",), "map")
    (mask,) = masks.read(20.0)
    assert mask[:4] == ("/costmap_filter_info", "/filter_mask", KEEP_OUT, 0.0)
    assert mask.cells.shape == (150, 200)
    assert mask.cells.tobytes() == peer["mask"][1].data.tobytes()
    transport.close()


def test_what_it_sends_that_is_no_message_harms_nothing(peer):
    transport = DdsTransport("filter", domain=DOMAIN)
    rubbish, sound = [], []
    transport.subscribe("/rubbish", TWIST, SENSOR, rubbish.append)
    transport.subscribe("/odom", ODOMETRY, SENSOR, sound.append)
    assert until(lambda: len(sound) > 100)
    assert all(received.message is None and received.damage for received in rubbish)
    transport.close()
