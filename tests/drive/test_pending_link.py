"""The page before the robot is ready: requests are refused, not stored."""

import time

from cohelm.core.types import Stick
from cohelm.drive.operate import DriveOptions
from cohelm.drive.pending_link import PendingLink
from cohelm.drive.robot_process import RobotProcess
from cohelm.drive.teleop_server import TeleopConfig
from cohelm.link import keys
from cohelm.link.bulk_messages import Checked
from cohelm.link.messages import Command, Device, RequestKind
from cohelm.link.station_end import LinkState

LAB = DriveOptions("lab-guard", "lab-guard", "twin", True, None, [])
NOWHERE = LAB._replace(name="no-such-place", kind="kinematic")


class Robot:
    """Writes down what reaches it."""

    def __init__(self):
        self.reached = []

    def news(self):
        return ["news"]

    def steer(self, *what):
        self.reached.append(("steer", what))

    def ask(self, what, value=0, made=None):
        self.reached.append(("ask", what))
        return 7

    def answer(self, number):
        return ("answer", number)

    def propose(self, points, only_check):
        self.reached.append(("propose", points))
        return 8

    def fetch(self, name):
        self.reached.append(("fetch", name))

    def state(self):
        return LinkState(True, "robot", "", 0.0, 0.0, 0.0)

    def close(self):
        self.reached.append(("close", ()))


def awaited():
    there: list[Robot] = []
    return PendingLink(lambda: there[0] if there else None, lambda: "starting (3 s)"), there


def test_before_the_robot_is_ready_all_requests_are_refused_with_the_reason():
    link, _ = awaited()
    assert link.state()[:3] == (False, "the robot beside it", "starting (3 s)")
    link.steer(Command(Stick(1.0, 0.0), True, True, Device.KEYBOARD, 1.0))
    answer = link.answer(link.ask(RequestKind.TAKE))
    assert not answer.granted
    assert answer.reason == "the robot is not started yet"
    number = link.propose([(1.0, 2.0)], False)
    (news,) = link.news()
    assert isinstance(news.message, Checked)
    assert news.message.answer[:2] == (number, False)
    assert link.news() == []


def test_no_request_from_before_the_robot_was_ready_reaches_it():
    link, there = awaited()
    link.steer(Command(Stick(1.0, 0.0), True, True, Device.KEYBOARD, 1.0))
    before = link.ask(RequestKind.TAKE)
    link.propose([(1.0, 2.0)], False)
    there.append(Robot())
    link.news()
    assert link.state().connected
    assert there[0].reached == []
    assert not link.answer(before).granted
    assert link.answer(link.ask(RequestKind.RESET)) == ("answer", 7)
    assert there[0].reached == [("ask", RequestKind.RESET)]


def test_a_closed_page_opens_no_link_when_the_robot_is_ready():
    link, there = awaited()
    link.close()
    there.append(Robot())
    assert link.news() == []
    assert not link.state().connected


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
