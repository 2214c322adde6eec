"""An independent ROS 2 decoder finds the run in the file, on every topic."""

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from cohelm import __version__
from cohelm.core.trace import ROW, Trace
from cohelm.core.types import RADIUS, SAFE, VX, VY, X, Y
from cohelm.record.topics import RATE, TOPICS
from cohelm.record.write import EPOCH
from tests.record.runs import LAB, OUTLINE, WALLS, lab, recorded

SETUP = lab(duration=20.0)  # the mover sets out at 15 s
EVERY = round(1 / (RATE * SETUP.dt))

OperatorInput = dict[str, list[tuple[int, Any]]]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("record") / "lab.mcap"


@pytest.fixture(scope="module")
def trace(path: Path) -> Trace:
    return recorded(path, SETUP)


@pytest.fixture(scope="module")
def heard(path: Path, trace: Trace) -> OperatorInput:
    """Topic -> (log time, message), as mcap-ros2-support reads them."""
    found: OperatorInput = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time, decoded))
    return found


def seconds(message: Any) -> float:
    stamp = message.header.stamp
    return stamp.sec - EPOCH // 10**9 + stamp.nanosec * 1e-9


def test_every_topic_decodes_with_its_declared_type(path: Path, heard: OperatorInput) -> None:
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
    types = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
    assert {topic: schema.name for topic, schema in types.items()} == {
        "/status": "cohelm_msgs/msg/Status",
        **TOPICS,
    }
    assert all(isinstance(s, Schema) and s.encoding == "ros2msg" for s in types.values())
    assert set(heard) == set(types)


def test_status_has_every_number_of_every_step(heard: OperatorInput, trace: Trace) -> None:
    messages = [message for _, message in heard["/status"]]
    assert len(messages) == len(trace) == 2001
    for name in ROW.names or ():
        got = np.array([getattr(m, name.lower()) for m in messages], dtype=ROW[name])
        assert got.tobytes() == np.ascontiguousarray(trace.rows[name]).tobytes(), name
    h = np.array([m.obstacle_h for m in messages])
    np.testing.assert_array_equal(h, trace.h)
    columns = {"x": X, "y": Y, "vx": VX, "vy": VY, "radius": RADIUS, "safe": SAFE}
    for name, column in columns.items():
        got = np.array([getattr(m, f"obstacle_{name}") for m in messages])
        np.testing.assert_array_equal(got, trace.discs[:, :, column])


def test_times_are_those_of_the_run(heard: OperatorInput, trace: Trace) -> None:
    times = [(log_time - EPOCH) * 1e-9 for log_time, _ in heard["/status"]]
    np.testing.assert_allclose(times, trace.rows["t"], rtol=0, atol=1e-9)
    for topic in ("/odom", "/cmd_vel", "/cmd_vel_safe", "/joy"):
        stamps = [seconds(message) for _, message in heard[topic]]
        np.testing.assert_allclose(stamps, trace.rows["t"][::EVERY], rtol=0, atol=1e-6)


def test_pose_command_and_stick_are_those_of_the_run(heard: OperatorInput, trace: Trace) -> None:
    rows = trace.rows[::EVERY]
    assert len(rows) == len(heard["/odom"]) == len(heard["/tf"])
    assert abs(rows["stick_psi"]).max() > 0.4  # the person steered
    messages = zip(*(heard[t] for t in ("/odom", "/tf", "/cmd_vel", "/cmd_vel_safe", "/joy")))  # noqa: B905
    for row, ((_, odom), (_, tf), (_, applied), (_, asked), (_, joy)) in zip(
        rows, messages, strict=True
    ):
        pose, (moved,) = odom.pose.pose, tf.transforms
        assert (odom.header.frame_id, odom.child_frame_id) == ("world", "base_link")
        assert (moved.header.frame_id, moved.child_frame_id) == ("world", "base_link")
        assert (pose.position.x, pose.position.y) == (row["x"], row["y"])
        shift, turn = moved.transform.translation, moved.transform.rotation
        assert (shift.x, shift.y) == (row["x"], row["y"])
        for q in (pose.orientation, turn):
            assert q.x == q.y == 0.0
            assert q.z == pytest.approx(math.sin(row["psi"] / 2), abs=1e-15)
            assert q.w == pytest.approx(math.cos(row["psi"] / 2), abs=1e-15)
        for twist, v, omega in (
            (odom.twist.twist, "applied_v", "applied_omega"),
            (applied.twist, "applied_v", "applied_omega"),
            (asked.twist, "safe_v", "safe_omega"),
        ):
            assert (twist.linear.x, twist.angular.z) == (row[v], row[omega])
        assert list(joy.axes) == [np.float32(row["stick_x"]), np.float32(row["stick_psi"])]


def test_obstacles_are_drawn_where_they_are_with_their_safe_distance(
    heard: OperatorInput, trace: Trace
) -> None:
    drawn = heard["/obstacles"]
    moving = [m for log_time, m in drawn if log_time - EPOCH > 16 * 10**9]
    assert len(moving) >= 39  # ten times a second while the mover is on its way
    for log_time, array in drawn:
        discs = trace.discs[round((log_time - EPOCH) * 1e-9 / trace.dt)]
        assert len(array.markers) == 2 * len(discs)
        for i, marker in enumerate(array.markers):
            disc = discs[i // 2]
            at = marker.pose.position
            assert marker.ns == trace.names[i // 2]
            assert (marker.type, marker.header.frame_id) == (3, "world")
            assert (at.x, at.y) == (disc[X], disc[Y])
            assert marker.scale.x == marker.scale.y == 2 * disc[RADIUS if i % 2 == 0 else SAFE]
    assert all(m.color.a < 0.5 for m in moving[0].markers[1::2])  # one sees through the ring


def test_reference_walls_and_outline_are_drawn_once(heard: OperatorInput) -> None:
    ((_, reference),), ((_, scene),) = heard["/reference"], heard["/scene"]
    path = np.array([(p.pose.position.x, p.pose.position.y) for p in reference.poses])
    for way_point in LAB[:9]:  # those within the first 20 s
        assert np.hypot(*(path - way_point).T).min() < 0.05
    robot, walls = scene.markers
    assert (robot.header.frame_id, walls.header.frame_id) == ("base_link", "world")
    outline = [(p.x, p.y) for p in robot.points]
    assert outline == [tuple(c) for c in [*OUTLINE.tolist(), OUTLINE[0].tolist()]]
    assert [(p.x, p.y) for p in walls.points] == [tuple(e) for e in WALLS.reshape(-1, 2).tolist()]


def test_the_file_says_what_made_it(path: Path, trace: Trace) -> None:
    with path.open("rb") as file:
        reader = make_reader(file)
        (about,) = (m.metadata for m in reader.iter_metadata() if m.name == "cohelm")
        (scenario,) = reader.iter_attachments()
    assert about["version"] == __version__
    assert about["obstacles"] == '["cone_1", "cone_2", "cone_3", "mover"]'
    assert int(about["epoch_ns"]) == EPOCH
    assert (scenario.name, scenario.data.decode()) == ("scenario.yaml", SETUP.scenario)
