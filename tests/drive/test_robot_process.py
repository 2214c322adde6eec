"""The robot's process, from its start: ended at any time, and whatever is wrong is reported."""

import os
import signal
import time

import pytest

from cohelm.drive import robot_process
from cohelm.drive.operate import DriveOptions
from cohelm.drive.robot_process import RobotProcess
from cohelm.drive.teleop_server import TeleopConfig
from cohelm.link import keys
from cohelm.link.bulk_messages import Hello
from cohelm.station.robot_link import Linked
from tests.patience import started

LAB = DriveOptions("lab-guard", "lab-guard", "twin", True, None, [])
NOWHERE = LAB._replace(name="no-such-place", kind="kinematic")


def test_a_robot_that_still_starts_is_ended_at_once(tmp_path):
    own, _ = keys.pair_here()
    robot = RobotProcess(LAB, TeleopConfig(own, "127.0.0.1", 0, tmp_path))
    assert not robot.ready.is_set()
    begun = time.monotonic()
    robot.close()
    assert time.monotonic() - begun < 10.0
    assert robot.over == ""


def test_a_robot_that_can_not_be_started_is_reported_and_the_callback_runs(tmp_path):
    own, _ = keys.pair_here()
    robot = RobotProcess(NOWHERE, TeleopConfig(own, "127.0.0.1", 0, tmp_path))
    called: list[str] = []
    robot.afterwards(lambda: called.append(robot.over))
    until = time.monotonic() + 60.0
    while not called:
        assert time.monotonic() < until
        time.sleep(0.05)
    robot.close()
    assert "no-such-place" in called[0]
    assert not robot.ready.is_set()


def test_a_robot_killed_while_it_starts_says_by_what(tmp_path):
    own, _ = keys.pair_here()
    robot = RobotProcess(LAB, TeleopConfig(own, "127.0.0.1", 0, tmp_path))
    os.kill(robot.pid, signal.SIGKILL)
    until = time.monotonic() + 30.0
    while not robot.over:
        assert time.monotonic() < until
        time.sleep(0.01)
    robot.close()
    assert robot.over == "the robot's process ended before it was ready: killed by SIGKILL"


@pytest.mark.slow  # only what stations show
def test_a_robot_tells_its_stations_whether_it_drives_on_without_them(tmp_path):
    own, theirs = keys.pair_here()
    plan = LAB._replace(kind="kinematic")
    robot = RobotProcess(plan, TeleopConfig(own, "127.0.0.1", 0, tmp_path), carry_on=True)
    assert started(robot), robot.over
    link = Linked(theirs, robot.host, robot.port)
    until, hello = time.monotonic() + 30.0, None
    while hello is None:
        assert time.monotonic() < until
        time.sleep(0.05)
        hello = next((n.message for n in link.news() if isinstance(n.message, Hello)), None)
    assert hello.carry_on
    link.close()
    os.kill(robot.pid, signal.SIGSTOP)  # such a one is not waited for, and is not killed
    robot.close()
    assert robot._process.exitcode == 0


def never_ends(line, *_: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    line.send(("127.0.0.1", 1))
    time.sleep(600.0)


def test_a_robot_that_does_not_end_is_said_and_can_be_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(robot_process, "_drive", never_ends)
    monkeypatch.setattr(robot_process, "_WAITS", 0.1)
    own, _ = keys.pair_here()
    robot = RobotProcess(LAB, TeleopConfig(own, "127.0.0.1", 0, tmp_path))
    assert started(robot)
    robot.when_waiting(robot.kill)
    robot.close()
    assert robot._process.exitcode == -signal.SIGKILL
