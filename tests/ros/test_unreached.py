"""Who publishes what is never heard is told, whenever he comes; what is wrong is one sentence."""

from __future__ import annotations

import time

import pytest

from cohelm.core.errors import CohelmError
from cohelm.drive.on_topics import TopicsConfig, optional_topics
from cohelm.ros.goals import GOAL
from cohelm.ros.interlock import Interlock
from cohelm.ros.joy import JOY, JoyOperator, JoyParams
from cohelm.ros.localized import PATH, POSE
from cohelm.ros.mismatch import BOOL, TWIST
from cohelm.ros.option_names import FILTER, ROBOT
from cohelm.ros.port import COMMAND, Endpoint, Qos, Received
from cohelm.ros.unreached import Unreached
from tests.patience import looks

BEST_EFFORT = Qos(False)
CONFIG = TopicsConfig(ways=("goal_pose", "/plan"), initial="initialpose", joy="joy")


class Network:
    """Who publishes, in a test's hands."""

    name = "nobody's"

    def __init__(self) -> None:
        self.there: list[Endpoint] = []
        self.heard: list[object] = []

    def comes(self, topic: str, kind: str, qos: Qos = COMMAND) -> None:
        self.there.append(Endpoint(topic, kind, qos, True, "/rviz"))

    def endpoints(self) -> list[Endpoint]:
        return self.there

    def lost(self) -> str:
        return ""

    def subscribe(self, topic, kind, qos, heard):
        self.heard.append(heard)
        return lambda: None


def told(*ends, config=CONFIG) -> list[str]:
    network, said = Network(), list[str]()
    made = Unreached(network, (), said.append)
    made._wanted = optional_topics(config, "/r2")
    for one in ends:
        network.comes(*one)
    for _ in range(4):
        made.look()
    return said


def test_without_endpoint_or_with_a_reached_one_nothing_is_reported():
    assert told() == []
    ends = (("/r2/goal_pose", GOAL), ("/r2/goal_pose", PATH), ("/plan", PATH),
            ("/r2/initialpose", POSE), ("/r2/joy", JOY, BEST_EFFORT))  # fmt: skip
    assert told(*ends) == []
    assert told(("/r2/goal_pose", "geometry_msgs/msg/Pose"), ("/r2/goal_pose", GOAL)) == []


@pytest.mark.parametrize(
    ("end", "why"),
    [
        (("/r2/goal_pose", "geometry_msgs/msg/PointStamped"),
         "/r2/goal_pose is geometry_msgs/msg/PointStamped by /rviz, and geometry_msgs/msg/"
         "PoseStamped is needed: name another topic with --goals-from"),
        (("/plan", PATH, BEST_EFFORT),
         "/plan never reaches this node: the publisher is best effort and the subscriber wants "
         "reliable; fix the QoS of its publisher"),
        (("/r2/initialpose", GOAL), "is needed: name another topic with --initial-pose-from"),
        (("/r2/joy", TWIST), "sensor_msgs/msg/Joy is needed: name another topic with --joy"),
    ],
)  # fmt: skip
def test_an_unreached_endpoint_is_reported_once(end, why):
    (said,) = told(end)
    assert why in said


def test_two_joysticks_on_one_topic_are_reported_once():
    """The stick would be of either in turns."""
    network, said = Network(), list[str]()
    made = Unreached(network, (), said.append)
    made._wanted = optional_topics(CONFIG, "/r2")
    network.there = [Endpoint("/r2/joy", JOY, COMMAND, True, node) for node in ("/a", "/b")]
    for _ in range(4):
        made.look()
    (why,) = said
    assert why.startswith("/r2/joy is published by /a, /b at once, and one joystick is needed: ")
    twice = [Endpoint("/plan", PATH, COMMAND, True, node) for node in ("/a", "/b")]
    network.there = [*twice, Endpoint("/r2/joy", JOY, COMMAND, True, "/a")]
    for _ in range(4):
        made.look()
    assert len(said) == 1


def test_the_check_polls_by_itself_and_survives_a_lost_transport(monkeypatch):
    monkeypatch.setattr("cohelm.ros.unreached._LOOK", 0.01)
    network, said, fails = Network(), list[str](), [3]
    endpoints = network.endpoints

    def seen():
        fails[0] -= 1
        if fails[0] > 0:
            raise CohelmError("the bridge is gone")
        return endpoints()

    network.endpoints = seen
    network.comes("/r2/joy", TWIST)
    made = Unreached(network, optional_topics(CONFIG, "/r2"), said.append)
    assert any(said for _ in looks(20.0, 0.01, 0.2))
    made.close()


@pytest.mark.parametrize("options", [FILTER, ROBOT])
def test_an_emergency_stop_topic_without_data_is_a_fault_at_any_time(options):
    network = Network()
    one = Interlock(network, "/cmd_vel", "/emergency_stop", options=options)
    assert not one.faults()
    network.comes("/emergency_stop", "std_msgs/msg/String")
    assert any(one.faults() for _ in looks(20.0, 0.05, 0.5))
    (why,) = one.faults()
    assert why.startswith("/emergency_stop is std_msgs/msg/String by /rviz, and std_msgs/msg/Bool")
    assert f"with {options.lock}" in why
    network.there[:] = []
    network.comes("/emergency_stop", BOOL)
    assert any(not one.faults() for _ in looks(20.0, 0.05, 0.5))
    one.close()


def test_joystick_messages_that_can_not_be_decoded_are_reported():
    network, now = Network(), time.monotonic()
    joy = JoyOperator(network, "/joy", JoyParams(), lambda: now)
    assert joy.problem() == "/joy: nothing is received"
    network.heard[0](Received(None, now, "7 bytes are no Joy"))
    assert joy.problem() == "/joy: what comes can not be read (7 bytes are no Joy)"
