"""Signals that end a drive."""

import os
import re
import signal

import pytest

from cohelm.drive.factory import own_robot, simulated
from cohelm.drive.operate import end_signals, remarks
from cohelm.ros import mismatch
from cohelm.ros.option_names import ROBOT
from cohelm.ros.port import Endpoint, Qos
from cohelm.scenario.load import robot as load_robot
from tests.api import carts


@pytest.mark.parametrize(
    ("number", "before", "said"),
    [
        (signal.SIGINT, signal.default_int_handler, "Ctrl-C"),
        (signal.SIGTERM, signal.SIG_DFL, "received SIGTERM"),
        (signal.SIGHUP, signal.SIG_DFL, "the terminal was closed"),
        (signal.SIGHUP, signal.SIG_IGN, ""),  # nohup
    ],
)
def test_a_signal_requests_the_end_unless_the_drive_ignores_signals(number, before, said):
    then = signal.signal(number, before)
    try:
        with end_signals() as end:
            end.handle_signals()
            os.kill(os.getpid(), number)
            assert end.reason == said
        assert signal.getsignal(number) == before
    finally:
        signal.signal(number, then)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ""),
        ({"delay_s": 0.0}, "its file has no delay_s, which every robot has: measure it"),
        ({"noise_m": 0.0}, "its file has no noise_m: that a scan repeats is not noticed"),
    ],
)
def test_a_real_robot_without_delay_or_noise_is_remarked_on(tmp_path, changes, said):
    """Both are 0 where they are left out, and a filter counts on that."""
    sally = load_robot("sally")
    lidar = sally.lidar.model_copy(update={k: v for k, v in changes.items() if k == "noise_m"})
    other = {k: v for k, v in changes.items() if k != "noise_m"}
    model = sally.model_copy(update={"lidar": lidar, **other})
    made = own_robot(carts.Cart, carts.SITE, model=model)
    assert remarks(made)[: len(said)] == said
    assert bool(remarks(made)) == bool(said)
    assert remarks(simulated(carts.SITE)) == ""


def test_errors_name_options_that_the_command_has():
    """`cohelm robot --ros2` has no --odom, --scan and --out: it names topics with --topic."""
    qos = Qos()
    seen = [("/cmd_vel", mismatch.TWIST, False), ("/cmd_vel", mismatch.STAMPED, False),
            ("/cmd_vel", mismatch.TWIST, True), ("/stop", mismatch.TWIST, True)]  # fmt: skip
    others = [Endpoint(topic, kind, qos, out, f"/{kind}") for topic, kind, out in seen]
    panel = [Endpoint("/other", mismatch.BOOL, qos, True, "/panel")]
    said = [
        *(mismatch.nothing_received("/a", mismatch.SCAN, qos, option, others)
          for option in (ROBOT.odom, ROBOT.scan, f"{ROBOT.further_scan}rear=TOPIC")),
        mismatch.base_type("/b", None, others, ROBOT)[1],
        mismatch.base_type("/cmd_vel", None, others, ROBOT)[1],
        mismatch.bypass("/cmd_vel", others, ROBOT),
        mismatch.lock("/stop", others, (), ROBOT)[1],
        mismatch.lock("/pressed", panel, (), ROBOT)[0],
        mismatch.footprint("/stop", others, ROBOT)[1],
        mismatch.no_frame("/a", "laser", "base_link", [], ROBOT),
    ]  # fmt: skip
    assert all(said)
    assert {option for one in said for option in re.findall(r"--[a-z-]+", one)} == {"--topic"}
    assert "name another topic with --topic odom=TOPIC" in said[0]
    assert "--topic scan=TOPIC" in said[1]
    assert "--topic scan_rear=TOPIC" in said[2]
