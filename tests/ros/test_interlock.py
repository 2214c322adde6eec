"""An emergency stop's lock, and whoever else commands the base: each keeps it from moving."""

from __future__ import annotations

import threading
import time
from multiprocessing import get_context
from types import SimpleNamespace

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Bool as Bool

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.port import Odometry
from cohelm.ros import interlock
from cohelm.ros.dds import DdsTransport
from cohelm.ros.filter_node import _reason
from cohelm.ros.interlock import Interlock
from cohelm.ros.mismatch import BOOL, ODOMETRY, TWIST, lock
from cohelm.ros.port import COMMAND, LATCHED, SENSOR, Endpoint, Qos
from cohelm.ros.served import odometry
from cohelm.ros.topics import Topics
from tests.ros.stage import KILLED, Controller, alone, resetting, stage, until

pytestmark = pytest.mark.xdist_group("realtime")
LOCK = "/emergency_stop"


@pytest.fixture(scope="module")
def others():
    alone()
    made = DdsTransport("others")
    yield made
    made.close()


@pytest.fixture(autouse=True)
def _looks_often(monkeypatch):
    monkeypatch.setattr(interlock, "_LOOK", 0.05)


@pytest.fixture
def locked():
    alone()
    transport = DdsTransport("gate")
    made: list[Interlock] = []

    def make(**options):
        made.append(Interlock(transport, "/cmd_vel", LOCK, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
    transport.close()


def says(one: Interlock, *words: str) -> bool:
    return until(lambda: all(any(word in said for said in one.faults()) for word in words))


@pytest.mark.parametrize("qos", [Qos(False), Qos(True), LATCHED], ids=["best", "sure", "latched"])
def test_while_the_lock_is_on_it_must_not_move_and_a_lock_that_leaves_is_one_that_is_on(
    locked, qos
):
    theirs = DdsTransport("button")
    out = theirs.publish(LOCK, BOOL, qos)
    if qos == LATCHED:
        out.send(Bool(True))  # before anybody listened, and never again
    one = locked()
    assert until(lambda: out.send(Bool(True)) or bool(one.faults()) or qos == LATCHED)
    assert says(one, "/emergency_stop is on")
    out.send(Bool(False))
    assert until(lambda: not one.faults())
    theirs.close()
    assert says(one, "no node publishes /emergency_stop any more")


def test_a_lock_that_was_on_for_a_moment_is_not_missed(locked, others):
    one = locked()
    out = others.publish(LOCK, BOOL, Qos(True, False, 10))
    assert until(lambda: out.send(Bool(True)) or bool(one.faults()))
    out.send(Bool(False))
    assert until(lambda: not one.faults())
    for state in (True, False):
        out.send(Bool(state))
    assert says(one, "is on")


def test_an_interlock_with_a_timeout_locks_when_it_falls_silent(locked):
    one = locked(silence=1.5)
    assert not one.faults()
    assert says(one, "silent for more than 1.5 s")


def test_another_publisher_of_commands_is_a_fault_while_it_is_there(locked):
    one, free = locked(), locked(bypass=True)
    theirs = DdsTransport("teleop")
    theirs.publish("/cmd_vel", TWIST, COMMAND)
    assert says(one, "/cmd_vel is published by /teleop as well")
    assert not free.faults()
    theirs.close()
    assert until(lambda: not one.faults())


def drive(name: str, over: threading.Event) -> None:
    """An odometry's driver."""
    transport = DdsTransport(name)
    out = transport.publish("/odom", ODOMETRY, Qos(True, False, 10))
    while not over.wait(0.02):
        out.send(odometry(Odometry(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)), time.time()))
    transport.close()


def forever(name: str) -> None:
    """The same in a process of its own, to be killed."""
    drive(name, threading.Event())


def test_a_killed_driver_is_started_again_under_another_name_and_a_living_one_beside_it_is_a_fault(
    monkeypatch,
):
    alone()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(KILLED))
    transport = DdsTransport("gate")
    one = Interlock(transport, "/cmd_vel", "", alone=[("/odom", ODOMETRY, "odometry")])
    came: list[str] = []
    transport.subscribe(
        "/odom", ODOMETRY, SENSOR, lambda r: (one.received("/odom", r), came.append(r.sender))
    )
    process = get_context("spawn").Process(target=forever, args=("first",), daemon=True)
    process.start()
    over = [threading.Event(), threading.Event()]
    threads = [
        threading.Thread(target=drive, args=each)
        for each in zip(("second", "third"), over, strict=True)
    ]
    try:
        assert until(lambda: len(came) > 5)
        process.kill()
        process.join()
        threads[0].start()
        assert until(lambda: len(set(came)) == 2)
        names = {e.node for e in transport.endpoints() if e.topic == "/odom"}
        until(lambda: False, 1.0)
        assert one.faults() == ()
        assert names == {"/first", "/second"}  # as its lease lasts 10 s
        threads[1].start()
        assert says(one, "/odom is published by /first, /second, /third at once")
        over[1].set()
    finally:
        process.kill()
        for each in over:
            each.set()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
        one.close()
        transport.close()


@pytest.mark.parametrize("error", [CohelmError("closed"), RuntimeError("damaged")])
def test_an_interlock_that_can_not_be_polled_is_a_fault_until_it_can(error):
    class Sightless:
        """Of a transport, what the watch asks for; it fails, once it is told to."""

        fails = False

        def lost(self) -> str:
            return ""

        def endpoints(self) -> list[Endpoint]:
            if self.fails:
                raise error
            return []

    transport = Sightless()
    one = Interlock(transport, "/cmd_vel", "")
    assert not one.faults()
    transport.fails = True
    assert says(one, "can not be looked at")
    transport.fails = False
    assert until(lambda: not one.faults())
    one.close()


def test_an_unusable_interlock_is_reported_before_anything_moves():
    by = Endpoint(LOCK, "std_msgs/msg/String", COMMAND, True, "/panel")
    right = Endpoint("/stop", BOOL, COMMAND, True, "/button")
    _, wrong = lock(LOCK, [by, right])
    assert "is std_msgs/msg/String by /panel, and std_msgs/msg/Bool is needed" in wrong
    assert "Bool is on /stop" in wrong
    assert lock(LOCK, []) == (f"emergency stop: no node publishes {LOCK}", "")
    assert lock(LOCK, [right]) == (
        f"emergency stop: no node publishes {LOCK}; Bool is on /stop: is it that (--lock)?",
        "",
    )
    assert lock(LOCK, [right], {"/stop"})[0] == f"emergency stop: no node publishes {LOCK}"
    assert lock("/stop", [right]) == ("emergency stop: /stop by /button", "")


def test_a_lock_is_in_the_namespace_or_there_is_none():
    assert Topics.named("/j100").lock == "/j100/emergency_stop"
    assert Topics.named("/j100", lock="/stop").lock == "/stop"
    assert Topics.named(lock="").lock == ""
    with pytest.raises(CohelmError, match="no name of a topic"):
        Topics.named(lock="no name")


def test_a_latched_stop_names_the_topic_that_resets_it():
    gate = SimpleNamespace(mode=GateMode.FAULTED, reason="the robot reports: /stop is on")
    kind, text = _reason(None, "", None, None, gate, "/j100/cohelm_filter/reset")
    assert kind == "gate"
    assert text == (
        "the robot reports: /stop is on: fix it, then publish std_msgs/msg/Empty once on "
        "/j100/cohelm_filter/reset"
    )


@pytest.mark.slow
def test_a_pressed_interlock_stops_the_base_and_its_release_needs_a_reset(others):
    button = others.publish(LOCK, BOOL, LATCHED)
    button.send(Bool(False))
    reset = resetting(others)
    with stage() as hall:
        assert hall.turned_round()
        assert hall.drives(0.4)
        button.send(Bool(True))
        assert hall.stands(2.0)
        assert until(lambda: any("/emergency_stop is on" in said for said in hall.filter.said))
        button.send(Bool(False))
        assert not until(lambda: hall.speed() > 0.01, 1.0)  # still wanted, and not driven
        assert until(lambda: reset() or hall.speed() > 0.2)
        teleop = DdsTransport("teleop")
        other = Controller(teleop, "/cmd_vel")
        other.twist = None
        assert hall.stands(3.0)
        assert until(lambda: any("published by /teleop" in said for said in hall.filter.said))
        other.close()
        teleop.close()
        assert hall.controller.twist == Twist(0.4, 0.0)
