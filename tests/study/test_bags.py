"""A drive in a bag of ROS 1 or ROS 2 is read by the types of its topics, not by their names."""

import contextlib
import math

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cohelm.core.errors import CohelmError
from cohelm.study.bags import BagTopics
from cohelm.study.mapping import drive
from tests.few import first as few

SCAN, ODOMETRY, TF = (
    "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage",
)  # fmt: skip
WALL = 2.0  # a wall straight ahead of the robot [m], and nothing else


def bag(
    path, ros, turn=(0.0, 0.0, 0.0, 1.0), step=0.1, scans=("/robot7/laser",), tf=True, twice=0,
    spoil=lambda kind, k, message: None,
):  # fmt: skip
    """A bag of five scans of a LiDAR 0.2 m ahead, mounted with that quaternion, which sees all
    round, the first `twice` beams again at the end; the robot drives 0.1 m between two. spoil:
    changes message k of a kind."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if ros == 1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    types = store.types
    seq = {"seq": 0} if ros == 1 else {}

    def header(t, frame):
        stamp = types["builtin_interfaces/msg/Time"](int(t), round(t % 1 * 1e9))
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **seq)

    point, vector = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Vector3"]
    quaternion = types["geometry_msgs/msg/Quaternion"]
    pose, covariance = types["geometry_msgs/msg/Pose"], np.zeros(36)
    twist = types["geometry_msgs/msg/Twist"](vector(0.5, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    x, y, z, w = turn
    rotation = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z)],
                         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z)]])  # fmt: skip
    n = round(2.0 * math.pi / abs(step))
    step = math.copysign(2.0 * math.pi / n, step)
    messages = []
    if tf:
        way = types["geometry_msgs/msg/Transform"](vector(0.2, 0.0, 0.1), quaternion(*turn))
        one = types["geometry_msgs/msg/TransformStamped"](header(9.0, "base"), "laser", way)
        messages.append(("/tf_static", TF, 9.0, types[TF]([one])))
    for k in range(5):
        t = 10.0 + 0.2 * k
        there = pose(point(0.1 * k, 0.0, 0.0), quaternion(0.0, 0.0, 0.0, 1.0))
        at = types["geometry_msgs/msg/PoseWithCovariance"](there, covariance)
        speed = types["geometry_msgs/msg/TwistWithCovariance"](twist, covariance)
        odometry = types[ODOMETRY](header(t, "odom"), "base", at, speed)
        spoil(ODOMETRY, k, odometry)
        messages.append(("/wheels/odometry", ODOMETRY, t, odometry))
        first = -math.pi if step > 0.0 else math.pi
        angles = first + step * np.arange(n + twice)
        beams = np.column_stack((np.cos(angles), np.sin(angles))) @ rotation.T  # in the body
        ahead = np.abs(np.arctan2(beams[:, 1], beams[:, 0])) < 0.3
        ranges = np.where(ahead, (WALL - 0.1 * k - 0.2) / beams[:, 0], np.inf)
        ranges[np.arctan2(beams[:, 1], beams[:, 0]) < 0.0] = np.inf  # but for its left half
        for topic in scans:
            scan = types[SCAN](
                header(t, "laser"), first, angles[-1], step, 0.0, 0.2, 0.1, 12.0,
                ranges.astype(np.float32), np.zeros(0, np.float32),
            )  # fmt: skip
            spoil(SCAN, k, scan)
            messages.append((topic, SCAN, t, scan))
    writer = (
        Writer1(path) if ros == 1 else Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    )
    with writer:
        to = {}
        for topic, kind, t, message in messages:
            if topic not in to:
                to[topic] = writer.add_connection(topic, kind, typestore=store)
            raw = store.serialize_ros1 if ros == 1 else store.serialize_cdr
            writer.write(to[topic], round(t * 1e9), raw(message, kind))
    return path


def where(found):
    """The ends of the first scan's returns in the frame of the body."""
    lidar, ranges = found.lidar.lidar(), found.scans[0].ranges
    points = ranges[:, None] * lidar.beams
    points = points[np.isfinite(ranges)]
    c, s = math.cos(lidar.mount.psi), math.sin(lidar.mount.psi)
    return points @ np.array([[c, s], [-s, c]]) + lidar.mount[:2]


UPSIDE_DOWN, BACKWARDS = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), BACKWARDS, UPSIDE_DOWN])
@pytest.mark.parametrize("step", [0.01, -0.01])
def test_the_wall_is_where_it_stood_however_the_lidar_is_mounted(tmp_path, ros, turn, step):
    found = drive(bag(tmp_path / ("own.bag" if ros == 1 else "own"), ros, turn, step))
    assert [round(one.stamp, 6) for one in found.scans] == [0.0, 0.2, 0.4, 0.6, 0.8]
    assert [round(one.pose.x, 6) for one in found.odometry] == [0.0, 0.1, 0.2, 0.3, 0.4]
    points = where(found)
    assert len(points) > 20
    assert points[:, 0] == pytest.approx(WALL, abs=1e-3)
    assert points[:, 1].min() > -0.03
    assert points[:, 1].max() > 0.4


@pytest.mark.parametrize("step", [0.01, -0.01])
def test_a_beam_that_is_the_first_again_is_not_another(tmp_path, step):
    found = drive(bag(tmp_path / "own", 2, step=step, twice=1))
    assert found.lidar.beams == len(found.scans[0].ranges) == 628
    assert where(found)[:, 0] == pytest.approx(WALL, abs=1e-3)


def test_of_several_scans_one_has_to_be_named(tmp_path):
    path = bag(tmp_path / "own", 2, scans=("/front", "/rear"))
    with pytest.raises(CohelmError, match=r"/front, /rear: --scan-topic"):
        drive(path)
    assert len(drive(path, None, BagTopics(scan="/rear")).scans) == 5


def test_a_bag_that_does_not_say_where_its_lidar_is_needs_a_robot(tmp_path):
    with pytest.raises(CohelmError, match="--robot"):
        drive(bag(tmp_path / "own", 2, tf=False))


def test_a_damaged_bag_is_refused(tmp_path):
    (tmp_path / "own.bag").write_bytes(b"#ROSBAG V2.0\nno more")
    with pytest.raises(CohelmError, match="can not be read as a bag"):
        drive(tmp_path / "own.bag")


@pytest.mark.parametrize("seed", few([3, 4, 5]))
def test_a_changed_byte_anywhere_in_a_bag_is_no_crash(tmp_path, seed):
    """Refused in one sentence, or read without what it was in."""
    folder, path = bag(tmp_path / "two", 2), tmp_path / "own.bag"
    (file,) = folder.glob("*.mcap")
    bag(path, 1)
    rng = np.random.default_rng(seed)
    for kept, named in ((path, path), (file, folder)):
        whole = kept.read_bytes()
        for _ in range(20):
            changed = bytearray(whole)
            for at in rng.integers(13, len(whole), 4):
                changed[at] = rng.integers(256)
            kept.write_bytes(changed)
            with contextlib.suppress(CohelmError):
                drive(named)


def test_a_bag_that_is_not_packed_as_it_says_is_refused(tmp_path):
    path = bag(tmp_path / "own", 2)
    about = (path / "metadata.yaml").read_text()
    about = about.replace("compression_format: ''", "compression_format: zstd")
    (path / "metadata.yaml").write_text(about.replace("mode: ''", "mode: file"))
    with pytest.raises(CohelmError, match=r"can not be read as a bag: .*decompress"):
        drive(path)


def test_a_bag_in_millimetres_is_refused_in_one_line(tmp_path):
    def spoil(kind, k, message):
        if kind == SCAN:
            object.__setattr__(message, "range_max", 12000.0)

    with pytest.raises(CohelmError, match=r"own: range_max_m is in metres; 12000 .* \(12 m\)$"):
        drive(bag(tmp_path / "own", 2, spoil=spoil))


def test_a_pose_that_is_none_is_left_out_and_a_bag_without_any_refused(tmp_path):
    """An orientation of zeros is no heading; the robot has not kept its last one."""

    def without(poses):
        def spoil(kind, k, message):
            if kind == ODOMETRY and k in poses:
                object.__setattr__(message.pose.pose.orientation, "w", 0.0)

        return spoil

    found = drive(bag(tmp_path / "some", 2, spoil=without({0, 3})))
    assert [round(one.pose.x, 6) for one in found.odometry] == [0.1, 0.2, 0.4]
    with pytest.raises(CohelmError, match=r"/wheels/odometry .* no pose that is a number"):
        drive(bag(tmp_path / "none", 2, spoil=without(range(5))))


def test_a_scan_that_is_none_is_left_out_and_a_bag_without_any_refused(tmp_path):
    """As drivers send one while their motor starts."""

    def without(scans):
        def spoil(kind, k, message):
            if kind == SCAN and k in scans:
                object.__setattr__(message, "angle_increment", 0.0)

        return spoil

    found = drive(bag(tmp_path / "some", 2, spoil=without({0, 3})))
    assert [round(scan.stamp, 6) for scan in found.scans] == [0.2, 0.4, 0.8]
    assert found.left_out.startswith("2 of 5 scans: /robot7/laser holds no scan: 63 ranges, 0 rad")
    with pytest.raises(CohelmError, match=r"none: /robot7/laser holds no scan: .*: fix its driver"):
        drive(bag(tmp_path / "none", 2, spoil=without(range(5))))


def test_a_bag_without_a_scan_says_so(tmp_path):
    with pytest.raises(CohelmError, match=r"holds no LaserScan, .* /tf_static, /wheels/odometry"):
        drive(bag(tmp_path / "own", 2, scans=()))
