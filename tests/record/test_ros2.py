"""An independent ROS 2 decoder reads a record of a run."""

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
from cohelm.core.row import ROW
from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, SAFE, VX, VY, X, Y
from cohelm.record.topics import TOPICS
from cohelm.record.write import EPOCH, RATE
from tests.record.runs import LAB, OUTLINE, WALLS, lab, recorded

SETUP = lab(duration=20.0)  # the mover sets out at 15 s
EVERY = round(1 / (RATE * SETUP.dt))

KINDS = ("body", "safe", "velocity")

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
    assert {topic: schema.name for topic, schema in types.items()} == TOPICS
    assert all(isinstance(s, Schema) and s.encoding == "ros2msg" for s in types.values())
    of_a_drive = {"/scan", "/tf_static", "/camera/image/compressed", "/rosout", "/diagnostics"}
    assert set(heard) == set(types) - of_a_drive - {"/detour", "/keep_out", "/speed_zones"}


def test_periods_have_every_number_of_every_step(heard: OperatorInput, trace: Trace) -> None:
    messages = [message for _, message in heard["/period"]]
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
    times = [(log_time - EPOCH) * 1e-9 for log_time, _ in heard["/period"]]
    np.testing.assert_allclose(times, trace.rows["t"], rtol=0, atol=1e-9)
    for topic in ("/odom", "/cmd_vel", "/cmd_vel_safe", "/joy"):
        stamps = [seconds(message) for _, message in heard[topic]]
        np.testing.assert_allclose(stamps, trace.rows["t"][::EVERY], rtol=0, atol=1e-6)


def test_pose_command_and_stick_are_those_of_the_run(heard: OperatorInput, trace: Trace) -> None:
    rows = trace.rows[::EVERY]
    assert 2 * len(rows) == 2 * len(heard["/odom"]) == len(heard["/tf"])
    assert abs(rows["stick_psi"]).max() > 0.4  # the person steered
    tfs = [tf.transforms[0] for _, tf in heard["/tf"]]
    for placed in tfs[1::2]:  # a run's odometry does not drift
        assert (placed.header.frame_id, placed.child_frame_id) == ("map", "odom")
        at, turn = placed.transform.translation, placed.transform.rotation
        assert (at.x, at.y, turn.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    messages = zip(*(heard[t] for t in ("/odom", "/cmd_vel", "/cmd_vel_safe", "/joy")))  # noqa: B905
    for row, moved, ((_, odom), (_, applied), (_, asked), (_, joy)) in zip(
        rows, tfs[::2], messages, strict=True
    ):
        pose = odom.pose.pose
        assert (odom.header.frame_id, odom.child_frame_id) == ("odom", "base_link")
        assert (moved.header.frame_id, moved.child_frame_id) == ("odom", "base_link")
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
        drawn_as = {name: [m for m in array.markers if m.ns == name] for name in KINDS}
        assert len(array.markers) == 3 * len(discs)
        for i, disc in enumerate(discs):
            for name, column in (("body", RADIUS), ("safe", SAFE)):
                marker = drawn_as[name][i]
                at = marker.pose.position
                assert (marker.type, marker.header.frame_id) == (3, "map")
                assert (at.x, at.y) == pytest.approx((disc[X], disc[Y]), abs=1e-6)
                assert marker.scale.x == marker.scale.y == pytest.approx(2 * disc[column], abs=1e-6)
            begin, end = drawn_as["velocity"][i].points
            went = (end.x - begin.x, end.y - begin.y)
            assert went == pytest.approx((disc[VX], disc[VY]), abs=1e-6)
    rings = [m for m in moving[0].markers if m.ns == "safe"]
    assert all(ring.color.a < 0.5 for ring in rings)  # one sees through it


def test_reference_walls_and_outline_are_drawn_once(heard: OperatorInput) -> None:
    ((_, reference),), ((_, scene),) = heard["/reference"], heard["/scene"]
    ((_, grid),), ((_, points),) = heard["/map"], heard["/waypoints"]
    path = np.array([(p.pose.position.x, p.pose.position.y) for p in reference.poses])
    for way_point in LAB[:9]:  # those within the first 20 s
        assert np.hypot(*(path - way_point).T).min() < 0.05
    robot, walls = scene.markers
    assert (robot.header.frame_id, walls.header.frame_id) == ("base_link", "map")
    outline = [(p.x, p.y) for p in robot.points]
    assert outline == [tuple(c) for c in [*OUTLINE.tolist(), OUTLINE[0].tolist()]]
    assert [(p.x, p.y) for p in walls.points] == [tuple(e) for e in WALLS.reshape(-1, 2).tolist()]
    corner, cell = grid.info.origin.position, grid.info.resolution
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    for x, y in WALLS.reshape(-1, 2):
        row, column = int((y - corner.y) / cell), int((x - corner.x) / cell)
        assert cells[row - 1 : row + 2, column - 1 : column + 2].max() == 100
    at = [(p.pose.position.x, p.pose.position.y) for p in points.poses]
    np.testing.assert_allclose(at, LAB, atol=1e-6)


def test_the_file_names_its_origin(path: Path, trace: Trace) -> None:
    with path.open("rb") as file:
        reader = make_reader(file)
        (about,) = (m.metadata for m in reader.iter_metadata() if m.name == "cohelm")
        (scenario,) = reader.iter_attachments()
    assert (about["version"], about["kind"]) == (__version__, "run")
    assert about["obstacles"] == '["cone_1", "cone_2", "cone_3", "mover"]'
    assert int(about["epoch_ns"]) == EPOCH
    assert (scenario.name, scenario.data.decode()) == ("scenario.yaml", SETUP.scenario)
