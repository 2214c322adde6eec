"""Bytes that may be anything are a message or a sentence; types are told as ROS 2 does."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.port import Odometry
from cohelm.ros.graph import INFO, Graph, described
from cohelm.ros.mismatch import FILTER_INFO, ODOMETRY, SCAN, STAMPED, TF, TWIST
from cohelm.ros.names import dds_topic, dds_type, ros_topic, ros_type
from cohelm.ros.served import odometry
from cohelm.ros.types import packed, store, type_hash, unpacked

KINDS = [TWIST, STAMPED, ODOMETRY, SCAN, TF, INFO]


@given(st.sampled_from(KINDS), st.binary(max_size=400))
def test_no_bytes_raise(kind, data):
    message, damage = unpacked(b"\x00\x01\x00\x00" + data, kind)
    assert (message is None) == bool(damage)
    message, damage = unpacked(data, kind)
    assert (message is None) == bool(damage)


@given(st.data())
def test_no_message_with_some_bytes_changed_raises(data):
    whole = bytearray(packed(odometry(Odometry(1.0, Pose(1, 2, 3), Twist(1, 2)), 5.0), ODOMETRY))
    for _ in range(data.draw(st.integers(1, 8))):
        whole[data.draw(st.integers(4, 80))] = data.draw(st.integers(0, 255))
    unpacked(bytes(whole[: data.draw(st.integers(0, len(whole)))]), ODOMETRY)


def test_names_and_types_go_to_dds_and_back():
    assert dds_topic("/a/cmd_vel") == "rt/a/cmd_vel"
    assert ros_topic("rt/a/cmd_vel") == "/a/cmd_vel"
    assert ros_topic("rq/services") == ""
    assert dds_type(TWIST) == "geometry_msgs::msg::dds_::Twist_"
    assert ros_type(dds_type(TWIST)) == TWIST
    assert ros_type("somebody::Else") == "somebody::Else"


def test_hashes_are_those_that_ros_2_publishes():
    assert type_hash("std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )  # as `ros2 topic info -v /chatter` prints it


@pytest.mark.parametrize("name", ["humble", "iron", "jazzy", "kilted", "lyrical", "rolling", ""])
def test_types_are_those_of_the_distribution_that_is_named(monkeypatch, name):
    monkeypatch.setenv("ROS_DISTRO", name)
    made = store()
    assert {*KINDS, FILTER_INFO} <= made.fielddefs.keys()


def test_an_unknown_ros_distribution_is_refused(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "foxy")
    with pytest.raises(CohelmError, match="ROS_DISTRO is 'foxy', and there are humble, iron, jazz"):
        store()


def test_the_graph_tells_a_node_with_its_endpoints():
    graph = Graph(bytes(range(16)), "cohelm_filter", "/j100")
    graph.readers.append(b"r" * 16)
    graph.writers.append(b"w" * 16)
    message, damage = unpacked(packed(graph.message(), INFO), INFO)
    assert not damage
    gid, nodes = described(message)
    assert gid == bytes(range(16))
    assert nodes == [("/j100/cohelm_filter", [b"r" * 16, b"w" * 16])]


def test_what_does_not_fit_its_type_is_refused():
    with pytest.raises(CohelmError, match="can not be made of that"):
        packed(String("x"), TWIST)
