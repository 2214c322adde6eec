"""Goals, paths and told poses on topics: over every transport, and each bad one in a sentence."""

from __future__ import annotations

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__PoseStamped as PoseStamped,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__PoseWithCovarianceStamped as PoseWithCovarianceStamped,
    nav_msgs__msg__Path as PathMessage,
)

from cohelm.core.types import Pose
from cohelm.plan.path_planner import Goal
from cohelm.record.ros2 import header, pose
from cohelm.ros.goals import GOAL, Goals, Placed, thinned
from cohelm.ros.localized import PATH, POSE
from cohelm.ros.messages import STRING
from cohelm.ros.port import COMMAND, SENSOR
from tests.ros.stage import until
from tests.ros.transports import TRANSPORTS

pytestmark = pytest.mark.xdist_group("bridge")  # which a worker starts once
NAN = math.nan


def goal(x=1.0, y=2.0, frame="map"):
    return PoseStamped(header(0, frame), pose(x, y, 0.3))


def path(*places, frame="map", inside=""):
    rows = [PoseStamped(header(0, inside), pose(*place, 0.0)) for place in places]
    return PathMessage(header(0, frame), rows)


def told(x=1.0, y=2.0, psi=0.5, variance=0.04, frame="map"):
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = variance
    return PoseWithCovarianceStamped(
        header(0, frame), PoseWithCovariance(pose(x, y, psi), covariance)
    )


def unturned():
    made = told()
    made.pose.pose.orientation.w = made.pose.pose.orientation.z = 0.0
    return made


class Network:
    """Goals, and somebody who publishes what they hear."""

    def __init__(self, kind, space):
        self.theirs, self.ours = kind.one("rviz", "/"), kind.two("cohelm_robot", "/")
        self.said: list[str] = []
        self.reasons: list[str] = []
        self.theirs.subscribe(
            f"{space}/cohelm_robot/reason", STRING, SENSOR,
            lambda received: self.reasons.append(received.message.data),
        )  # fmt: skip
        self.goals = Goals(
            self.ours, "map", ("goal_pose", "plan"), "initialpose", self.said.append, space
        )
        self.out = {
            kind: self.theirs.publish(f"{space}/{name}", kind, COMMAND)
            for kind, name in ((GOAL, "goal_pose"), (PATH, "plan"), (POSE, "initialpose"))
        }
        assert until(lambda: self.out[GOAL].send(goal()) or self.goals.way())
        assert until(lambda: self.out[PATH].send(path((0.0, 0.0))) or self.goals.way())
        assert until(lambda: self.out[POSE].send(told()) or self.goals.initial())
        self.quiet()

    def quiet(self):
        """What was sent more than once, until somebody heard, has come, and is forgotten."""
        still = 0
        while still < 5:
            heard = self.goals.way() is not None or self.goals.initial() is not None
            still = 0 if heard else still + 1
            time.sleep(0.1)

    def close(self):
        self.goals.close()
        self.theirs.close()
        self.ours.close()

    def answer(self, kind, message):
        """What is said to it."""
        self.said.clear()
        self.out[kind].send(message)
        assert until(lambda: bool(self.said))
        return self.said[0]


@pytest.fixture(scope="module", params=TRANSPORTS.items(), ids=TRANSPORTS)
def network(request):
    name, kind = request.param
    made = Network(kind, f"/goals_{name}")
    yield made
    made.close()


def test_goals_paths_and_initial_poses_are_received_once(network):
    network.goals.way()
    network.out[GOAL].send(goal(3.0, -1.0))
    got = []
    assert until(lambda: got.append(network.goals.way()) or got[-1] is not None)
    assert got[-1][0].endswith("/goal_pose")
    assert got[-1][1] == Goal(3.0, -1.0)
    assert network.goals.way() is None
    network.out[PATH].send(path((0.0, 0.0), (0.1, 0.0), (1.0, 0.0), inside="map"))
    assert until(lambda: got.append(network.goals.way()) or got[-1] is not None)
    assert got[-1][1].tolist() == [[0.0, 0.0], [1.0, 0.0]]
    network.out[POSE].send(told(4.0, 5.0, 0.5, 0.04))
    assert until(lambda: got.append(network.goals.initial()) or (got[-1] and got[-1].pose.x == 4.0))
    assert got[-1].pose == pytest.approx(Pose(4.0, 5.0, 0.5))
    assert got[-1].sigma == pytest.approx(0.2)


BAD = [
    (GOAL, goal(frame="odom"), "it is in the frame 'odom', and the map's is 'map': publish"),
    (GOAL, goal(NAN), "the goal is not a number"),
    (GOAL, goal(math.inf), "the goal is not a number"),
    (PATH, path(), "the path is empty"),
    (PATH, path((0.0, 0.0), frame="base_link"), "it is in the frame 'base_link', and the map's"),
    (PATH, path((0.0, 0.0), inside="odom"), "it is in the frame 'odom', and the map's is 'map'"),
    (PATH, path((0.0, 0.0), (1.0, NAN)), "the path has a pose that is not a number"),
    (POSE, told(frame=""), "it is in the frame '', and the map's is 'map': publish it in that"),
    (POSE, told(y=NAN), "the initial pose is not a number"),
    (POSE, unturned(), "the initial pose's orientation is no rotation"),
    (POSE, told(variance=NAN), "the initial pose's covariance is invalid"),
    (POSE, told(variance=-1.0), "the initial pose's covariance is invalid"),
]


def test_each_bad_one_is_one_sentence_to_the_person_and_on_a_topic(network):
    for kind, message, why in BAD:
        said = network.answer(kind, message)
        assert said.partition(": ")[2].startswith(why), said
        assert network.goals.way() is None
        assert network.goals.initial() is None
    assert until(lambda: network.said[0] in network.reasons)


def test_a_path_that_is_the_route_already_is_no_new_one(network):
    line = np.column_stack((np.linspace(0.0, 6.0, 61), np.zeros(61)))
    network.goals.route = line
    network.out[PATH].send(path(*line[10:].tolist()))  # from where the robot has come to
    network.out[PATH].send(path(*np.add(line[10:-5], (0.0, 0.1)).tolist()))  # elsewhere
    got = []
    assert until(lambda: got.append(network.goals.way()) or got[-1] is not None)
    assert got[-1][1][-1].tolist() == pytest.approx([5.5, 0.1])


def test_a_pose_without_covariance_gets_a_default_covariance():
    from cohelm.ros.goals import placed

    sure = [placed("/t", told(variance=v).pose) for v in (0.0, 1e-9, 0.25, 900.0)]
    assert all(isinstance(one, Placed) for one in sure)
    assert [one.sigma for one in sure] == pytest.approx([0.3, 0.05, 0.5, 1.0])


@pytest.mark.parametrize("n", [1, 2, 3, 100, 20_000])
def test_a_path_of_any_length_keeps_its_ends_and_is_thinned(n):
    points = np.column_stack((0.05 * np.arange(n), np.zeros(n)))
    kept = thinned(points)
    assert len(kept) <= 250
    assert kept[0].tolist() == points[0].tolist()
    assert kept[-1].tolist() == points[-1].tolist()
    assert n < 3 or (np.hypot(*np.diff(kept, axis=0).T) > 0.04).all()
    assert len(thinned(np.zeros((n, 2)))) == 1


class Stalled:
    """A transport that a message is long under way on."""

    def __init__(self) -> None:
        self.over = threading.Event()

    def publish(self, topic, kind, qos):
        return SimpleNamespace(send=lambda message: self.over.wait())

    def subscribe(self, topic, kind, qos, heard):
        return lambda: None


def test_what_is_said_faster_than_it_can_be_published_does_not_pile_up():
    """As of a node that publishes a bad goal a hundred times a second."""
    transport, said = Stalled(), []
    goals = Goals(transport, "map", ("goal_pose",), "", said.append)
    for k in range(1000):
        goals.report("/goal_pose", f"{k}")
    transport.over.set()
    goals.close()
    assert said[0] == "/goal_pose: 0"
    assert len(said) <= 21
    goals.report("/goal_pose", "one that came while it ended")
    assert len(said) <= 21
