"""map -> odom, pose and path on ROS topics: over every transport, and never beside another's."""

from __future__ import annotations

import itertools
import math
import time
import zlib

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import tf2_msgs__msg__TFMessage as TFMessage

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.surroundings import surroundings
from cohelm.link.bulk_messages import Map
from cohelm.perceive.pipeline import Seen
from cohelm.record.ros2 import header, transform
from cohelm.robot.port import Odometry
from cohelm.ros import localized
from cohelm.ros.clock import Clock, seconds
from cohelm.ros.found import Found
from cohelm.ros.localized import PATH, POSE, Localized
from cohelm.ros.mismatch import TF, TWIST
from cohelm.ros.port import COMMAND, LATCHED, SENSOR, Received
from cohelm.ros.topics import Topics
from cohelm.ros.transforms import yaw_of
from cohelm.scenario.load import robot as load_robot
from tests.ros.stage import until
from tests.ros.transports import TRANSPORTS

pytestmark = pytest.mark.xdist_group("bridge")  # which a worker starts once
MAP_ODOM, ODOM = Pose(3.0, -1.0, 0.4), Pose(1.5, 0.25, -1.1)
NOT_JUMPED = Pose(0.0, 0.0, 0.0)
LASTING = [pytest.param(one, id=name) for name, one in TRANSPORTS.items() if one.graph]
"""Transports on which what is transient local lasts."""
GRID = "nav_msgs/msg/OccupancyGrid"
CELLS = bytes([0, 100, 255, 0, 0, 100])
ROOM = Map(1, Pose(1.0, -2.0, 0.5), 0.05, 3, 2, 0, 0, 3, 2, zlib.compress(CELLS))
LINE = np.array([(0.0, 0.0, 0.1), (1.0, 0.5, 0.6)])


def found(namespace: str, odom: str, ahead: float = 0.0) -> Found:
    return Found(
        Topics.named(namespace), load_robot("sally"), TWIST, "base", odom, Clock(ahead), (),
        math.nan, (),
    )  # fmt: skip


def seen(lost: bool = False, map_odom: Pose = MAP_ODOM, jumped: Pose = NOT_JUMPED) -> Seen:
    return Seen(
        0.0, compose(map_odom, ODOM), np.diag([0.01, 0.02, 0.03]), 1.0, lost, "", ODOM,
        Twist(0.0, 0.0), map_odom, jumped, surroundings(), 0, math.inf, np.empty((0, 6)),
    )  # fmt: skip


class Heard(list[Received]):
    """What came on a topic."""

    def __init__(self, transport, topic, kind, qos=SENSOR):
        super().__init__()
        transport.subscribe(topic, kind, qos, self.append)

    @property
    def last(self):
        return self[-1].message


@pytest.fixture(scope="module", params=TRANSPORTS.values(), ids=TRANSPORTS)
def pair(request):
    """Cohelm's own transport, and what somebody else listens with."""
    made = request.param.one("cohelm_robot", "/"), request.param.two("rviz", "/")
    yield made
    for transport in made:
        transport.close()


@pytest.fixture(autouse=True)
def _at_once(monkeypatch):
    """Others that publish the transform are there before these tests begin."""
    monkeypatch.setattr(localized, "_LISTENS", 0.0)


NUMBERS = itertools.count()


def fresh(name: str) -> str:
    """A namespace that no other test has: what the test before has said, and who said it, a bridge
    may still have."""
    return f"/{name}_{next(NUMBERS)}"


class Robot:
    """One that is localised. Its odometry's frame is no other's, as all listen to /tf."""

    def __init__(self, transport, space: str, ahead: float = 0.0, **options) -> None:
        self.odom, self.said = f"wheels_{next(NUMBERS)}", list[str]()
        self.localized = Localized(
            transport, found(space, self.odom, ahead), self.said.append, **options
        )
        self.now = 100.0
        self.taken: list[tuple[float, float]] = []
        """From when to when each odometry was, by the wall."""

    def take(self, line=None, **known) -> None:
        """Odometry that is 0.1 s old."""
        self.now += 0.05
        odometry, begun = Odometry(self.now - 0.1, ODOM, Twist(0.0, 0.0)), time.time()
        self.localized.take(seen(**known), odometry, self.now, line)
        self.taken.append((begun - 0.1, time.time() - 0.1))
        time.sleep(0.02)


def test_the_robot_is_found_on_the_map_by_its_odometry_and_the_transform(pair):
    (ours, theirs), space = pair, fresh("one")
    tf, pose = Heard(theirs, f"{space}/tf", TF), Heard(theirs, f"{space}/cohelm_robot/pose", POSE)
    robot = Robot(ours, space, ahead=2.0)
    assert until(lambda: robot.take() or (tf and pose))
    robot.localized.close()
    (one,) = tf.last.transforms
    assert (one.header.frame_id, one.child_frame_id) == ("map", robot.odom)
    at = one.transform
    there = Pose(at.translation.x, at.translation.y, yaw_of(at.rotation))
    assert there == pytest.approx(MAP_ODOM)
    said, place = pose.last.pose.pose, compose(there, ODOM)
    assert (said.position.x, said.position.y) == pytest.approx(place[:2])
    assert yaw_of(said.orientation) == pytest.approx(place.psi)
    assert pose.last.pose.covariance[[0, 7, 35]].tolist() == [0.01, 0.02, 0.03]
    # by the clock that stamps the odometry, which is 2 s ahead
    stamp = seconds(one.header.stamp) - 2.0
    assert any(begun - 1e-6 <= stamp <= end + 1e-6 for begun, end in robot.taken)
    assert robot.said[0] == f"map -> {robot.odom} is published on {space}/tf"
    assert robot.said[1].startswith(
        f"no node publishes {robot.odom} -> base on {space}/tf, so ROS does not"
    )


def test_the_path_is_latched_and_published_again_when_it_changes(pair, request):
    (ours, theirs), space = pair, fresh("way")
    robot = Robot(ours, space)
    robot.take(LINE)
    time.sleep(0.1)
    late = LATCHED if request.node.callspec.params["pair"].graph else COMMAND
    path = Heard(theirs, f"{space}/cohelm_robot/path", PATH, late)
    assert until(lambda: bool(path))
    robot.take(LINE.copy())
    robot.take(LINE[:1])
    assert until(lambda: len(path.last.poses) == 1)
    robot.localized.close()
    assert len({seconds(one.message.header.stamp) for one in path}) == 2
    assert path.last.header.frame_id == "map"


def test_the_transform_is_of_the_frame_that_odometry_has_after_it_jumped(pair):
    """Perception's `odom` goes on smoothly; what else hears /tf has the robot's own."""
    (ours, theirs), space = pair, fresh("jumped")
    tf = Heard(theirs, f"{space}/tf", TF)
    robot, jumped = Robot(ours, space), Pose(-4.0, 2.0, 2.5)
    assert until(lambda: robot.take(jumped=jumped) or bool(tf))
    robot.localized.close()
    at = tf.last.transforms[0].transform
    there = Pose(at.translation.x, at.translation.y, yaw_of(at.rotation))
    assert there == pytest.approx(compose(MAP_ODOM, jumped))


@pytest.mark.parametrize("pair", LASTING, indirect=True)
def test_the_map_is_published_once_and_latched(pair):
    (ours, theirs), space = pair, fresh("drawn")
    robot = Robot(ours, space)
    robot.localized.draw(ROOM)
    time.sleep(0.3)
    grids = Heard(theirs, f"{space}/map", GRID, LATCHED)
    assert until(lambda: bool(grids))
    robot.localized.close()
    grid = grids.last
    assert (grid.header.frame_id, grid.info.width, grid.info.height) == ("map", 3, 2)
    assert grid.info.resolution == pytest.approx(0.05)
    at = grid.info.origin
    assert (at.position.x, at.position.y) == pytest.approx((1.0, -2.0))
    assert yaw_of(at.orientation) == pytest.approx(0.5)
    assert list(grid.data) == [0, 100, -1, 0, 0, 100]
    assert len(grids) == 1


@pytest.mark.parametrize("pair", LASTING, indirect=True)
def test_beside_a_map_server_no_map_is_published_and_that_is_reported(pair):
    (ours, theirs), space = pair, fresh("served")
    other = theirs.publish(f"{space}/map", GRID, LATCHED)
    assert until(lambda: any(one.topic == f"{space}/map" for one in ours.endpoints()))
    robot = Robot(ours, space)
    robot.localized.draw(ROOM)
    assert until(lambda: bool(robot.said))
    robot.localized.close()
    assert robot.said[0].startswith(f"{space}/map is published by ")
    assert other is not None


def test_while_lost_no_pose_is_published_and_when_localized_it_is(pair):
    """By their stamps: on its way through a bridge a transform may take any time."""
    (ours, theirs), space = pair, fresh("lost")
    tf = Heard(theirs, f"{space}/tf", TF)
    robot = Robot(ours, space)

    def stamps():
        return [seconds(one.message.transforms[0].header.stamp) for one in list(tf)]

    assert until(lambda: robot.take() or bool(tf))
    begun = len(robot.taken)
    for _ in range(20):
        robot.take(lost=True)
    lost, end = robot.taken[begun][0], robot.taken[-1][1]
    assert until(lambda: robot.take() or stamps()[-1] > end)
    robot.localized.close()
    assert not [one for one in stamps() if lost < one < end]
    assert stamps() == sorted(set(stamps()))  # tf2 refuses one that it has already


@pytest.mark.parametrize("topic", ["tf", "tf_static"])
def test_beside_another_publisher_of_the_frame_none_is_published_and_that_is_reported(
    pair, topic, request
):
    if topic == "tf_static" and request.node.callspec.id.startswith("to_foxglove"):
        pytest.skip("what a bridge's client publishes is volatile")
    (ours, theirs), space = pair, fresh("other")
    other = theirs.publish(f"{space}/{topic}", TF, LATCHED if topic == "tf_static" else COMMAND)
    robot = Robot(ours, space)
    elsewhere = TFMessage([transform(header(5, "world"), robot.odom, MAP_ODOM)])
    assert until(
        lambda: other.send(elsewhere) or robot.take() or any("amcl" in s for s in robot.said)
    )
    begun, tf = len(robot.taken), Heard(theirs, f"{space}/tf", TF)
    for _ in range(10):
        robot.take()
    robot.localized.close()
    own = [t for one in tf for t in one.message.transforms if t.header.frame_id == "map"]
    assert not [one for one in own if seconds(one.header.stamp) > robot.taken[begun][0]]
    (said,) = [one for one in robot.said if "amcl" in one]
    assert said.startswith(f"world -> {robot.odom} is published by another node (amcl, slam_")


def test_the_outline_goes_to_the_topic_beside_the_bases_own_and_can_be_left_out(pair):
    ours, theirs = pair
    base = theirs.publish("/tf", TF, COMMAND)
    tf = Heard(theirs, "/tf", TF)
    quiet, robot = Robot(ours, fresh("three"), transforms=False), Robot(ours, fresh("two"))
    moved = TFMessage([transform(header(7, robot.odom), "base", ODOM)])
    assert until(lambda: base.send(moved) or bool(robot.localized._carries))

    def parents():
        return {t.child_frame_id: t.header.frame_id for o in list(tf) for t in o.message.transforms}

    assert until(lambda: robot.take() or quiet.take() or parents().get(robot.odom) == "map")
    for one in (quiet, robot):
        one.localized.close()
    assert robot.said == [f"map -> {robot.odom} is published on /tf"]
    assert quiet.odom not in parents()
    assert quiet.said == []


class Refusing:
    """A transport that refuses the first messages, as a network without room."""

    def __init__(self, refused: int) -> None:
        self.refused, self.sent = refused, []

    def publish(self, topic: str, kind: str, qos: object) -> Refusing:
        return self

    def subscribe(self, *_: object) -> None:
        pass

    def send(self, message: object) -> None:
        if self.refused:
            self.refused -= 1
            raise CohelmError("a pose can not be sent: out of resources")
        self.sent.append(message)


def test_a_message_that_can_not_be_sent_is_reported_once_and_the_next_ones_are_sent():
    said: list[str] = []
    transport = Refusing(3)
    localized = Localized(transport, found("/", "odom"), said.append, transforms=False)
    stamps = itertools.count(1)

    def turn() -> None:
        now = 0.1 * next(stamps)
        localized.take(seen(), Odometry(now, ODOM, Twist(0.0, 0.0)), now, None)

    until(lambda: (turn(), transport.sent)[1], within=10.0)
    localized.close()
    assert said == ["a pose can not be sent: out of resources"]
