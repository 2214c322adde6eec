"""Each thing that does not fit is one sentence that names the topic and the cure."""

from __future__ import annotations

import math
import re
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as Odometry,
    rosgraph_msgs__msg__Clock as Clock,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from cohelm.cli.print_config import print_found
from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.record.ros2 import header
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.model import RobotModel, doubts
from cohelm.robot.port import Odometry as Reading, Scan
from cohelm.ros import look as looking, rendered
from cohelm.ros.clock import TYPE
from cohelm.ros.found import Allowed
from cohelm.ros.look import look
from cohelm.ros.mismatch import (
    CAMERA_INFO,
    CLOUD,
    IMAGE,
    ODOMETRY,
    RANGE,
    SCAN,
    STAMPED,
    TF,
    TWIST,
)
from cohelm.ros.port import Endpoint, Qos, Received
from cohelm.ros.robot import Ros2Robot, topics_of
from cohelm.ros.served import mounts, odometry, scan
from cohelm.ros.topics import Topics
from cohelm.ros.transforms import StaticTransforms, yaw_of
from cohelm.scenario.load import robot as load_robot
from tests.ros.test_cloud import cloud

RELIABLE, BEST_EFFORT = Qos(True), Qos(False)
SALLY = load_robot("sally")


class Pretended:
    """A transport on which what is given is seen and heard at once."""

    name, unseen = "pretended", "is ROS_DOMAIN_ID the robot's?"

    def __init__(self, ends=(), messages=()) -> None:
        self.ends, self.messages = list(ends), list(messages)

    def publish(self, topic, kind, qos):
        raise AssertionError("looking publishes nothing")

    def subscribe(self, topic, kind, qos, heard) -> None:
        for name, message in self.messages:
            if name == (topic, kind):
                came = time.monotonic() if message is not None else 0.0
                heard(Received(message, came, "" if message is not None else "7 bytes are no scan"))
        return lambda: None

    def endpoints(self):
        return self.ends

    def close(self) -> None: ...


class Apart(Pretended):
    """One on which the messages of a topic came this long apart [s]."""

    def __init__(self, ends, messages, topic: str, apart: float) -> None:
        super().__init__(ends, messages)
        self._topic, self._apart = topic, apart

    def subscribe(self, topic, kind, qos, heard):
        count = iter(range(len(self.messages)))
        return super().subscribe(topic, kind, qos, heard if topic != self._topic else lambda one: (
            heard(one._replace(stamp=one.stamp + next(count) * self._apart))
        ))  # fmt: skip


class Spoken(Pretended):
    """One on which may be spoken too; nobody hears it."""

    looks = 0
    """How often was looked who is there."""

    def endpoints(self):
        self.looks += 1
        return super().endpoints()

    def publish(self, topic, kind, qos):
        return SimpleNamespace(send=lambda message: None)

    def lost(self) -> str:
        return ""


def out(topic, kind, qos=RELIABLE, node="/driver") -> Endpoint:
    return Endpoint(topic, kind, qos, True, node)


def into(topic, kind, qos=RELIABLE, node="/base") -> Endpoint:
    return Endpoint(topic, kind, qos, False, node)


ENDS = [
    out("/odom", ODOMETRY), out("/scan", SCAN, BEST_EFFORT), into("/cmd_vel", TWIST),
]  # fmt: skip


def readings(off: float = 0.0, late: float = 0.0, frame: str = "laser"):
    """Odometry and scans that come this moment, stamped so far off [s]."""
    found = []
    for k in range(20):
        made = odometry(Reading(0.0, Pose(0, 0, 0), Twist(0, 0)), time.time() - off - 0.01)
        found.append((("/odom", ODOMETRY), made))
        rays = np.full(720, 2.0)
        seen = scan(Scan(0.0, k, rays, 0.0), SALLY, time.time() - off - 0.02 - late)
        seen.header = header(round((time.time() - off - 0.02 - late) * 1e9), frame)
        found.append((("/scan", SCAN), seen))
    return found


FRAMES = [(("/tf_static", TF), mounts(SALLY))]


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(looking, "_LEAST", 0.0)


def seen(ends, messages, allowed=None, topics=None):
    return look(Pretended(ends, messages), SALLY, topics or Topics(), allowed or Allowed(), 0.06)


def refused(ends, messages, allowed=None) -> str:
    with pytest.raises(CohelmError) as error:
        seen(ends, messages, allowed)
    return str(error.value)


REAR = load_robot("sally-rear")


def behind(topic="/scan_rear"):
    """Scans of a rear LiDAR that come this moment."""
    given = Scan(0.0, 0, np.full(720, 2.0), 0.0, "rear")
    return [((topic, SCAN), scan(given, REAR, time.time() - 0.02)) for _ in range(20)]


REAR_ENDS = [*ENDS, out("/scan_rear", SCAN, BEST_EFFORT)]
REAR_FRAMES = [(("/tf_static", TF), mounts(REAR))]


def seen_rear(ends, messages, topics=None, allowed=None):
    return look(Pretended(ends, messages), REAR, topics or Topics(), allowed or Allowed(), 0.06)


def test_every_lidar_is_found_on_its_own_topic_and_where_it_is():
    found = seen_rear(REAR_ENDS, REAR_FRAMES + readings() + behind())
    front, rear = found.model.lidars
    assert (front.name, rear.name) == ("front", "rear")
    assert front.mount_x_m == pytest.approx(0.30)
    assert (rear.mount_x_m, abs(rear.mount_yaw_deg)) == pytest.approx((-0.30, 180.0))
    assert [one.topic for one in found.lidars] == ["/scan", "/scan_rear"]
    other = Topics.named("/r2", scan="/r2/scan", odom="/odom", further=["rear=/behind"])
    assert other.of_lidars(REAR) == ("/r2/scan", "/behind")
    assert Topics.named("/r2").of_lidars(REAR) == ("/r2/scan", "/r2/scan_rear")
    named = topics_of(["scan_rear=/behind"])
    found = seen_rear([*ENDS, out("/behind", SCAN)], REAR_FRAMES + readings() + behind("/behind"),
                      named)  # fmt: skip
    assert [one.topic for one in found.lidars] == ["/scan", "/behind"]


def test_a_silent_or_undescribed_lidar_is_named():
    with pytest.raises(CohelmError, match=r"/scan_rear.*--further-scan rear=TOPIC"):
        seen_rear(ENDS, REAR_FRAMES + readings())
    with pytest.raises(CohelmError, match="no further LiDAR 'left': describe it"):
        Topics.named(further=["left=/left"]).of_lidars(REAR)
    with pytest.raises(CohelmError, match="can not share a topic"):
        Topics.named(further=["rear=/scan"]).of_lidars(REAR)
    with pytest.raises(CohelmError, match="NAME=TOPIC"):
        Topics.named(further=["rear"])
    with pytest.raises(CohelmError, match="laser_rear"):
        seen_rear(REAR_ENDS, FRAMES + readings() + behind())


def test_point_clouds_are_received_where_the_robot_has_a_height_band():
    front, rear = REAR.lidars
    deep = rear.model_copy(update={"height_band_m": (0.05, 1.0)})
    model = REAR.model_copy(update={"further_lidars": (deep,)})
    clouds = []
    for _ in range(20):
        made = cloud([[1.0, 0.0, 0.0]])
        made.header = header(round((time.time() - 0.02) * 1e9), "laser_rear")
        clouds.append((("/scan_rear", CLOUD), made))
    ends = [*ENDS, out("/scan_rear", CLOUD, BEST_EFFORT)]

    def found(messages):
        return look(Pretended(ends, messages), model, Topics(), Allowed(), 0.06)

    seen = found(REAR_FRAMES + readings() + clouds)
    assert seen.model.further_lidars[0].height_band_m == (0.05, 1.0)
    assert seen.lidars[1].cloud is not None
    assert seen.lidars[0].cloud is None
    assert any("point cloud: /scan_rear" in note for note in seen.notes)
    assert seen.model.lidars[0].beams == front.beams
    with pytest.raises(CohelmError, match="or give this LiDAR a height_band_m"):
        look(Pretended(ends, REAR_FRAMES + readings()), REAR, Topics(), Allowed(), 0.06)
    with pytest.raises(CohelmError, match="laser_rear"):
        found(FRAMES + readings() + clouds)
    robot = Ros2Robot(seen.model, seen, Spoken(ends, readings() + clouds))
    read = robot.read()
    assert read.scan is not None
    (behind_it,) = read.further
    assert behind_it.sensor == "rear"
    assert (behind_it.ranges < math.inf).sum() == 1
    assert behind_it.ranges[359:361].min() == pytest.approx(1.0, abs=1e-3)
    robot.close()


def test_ranges_are_received_where_the_robot_has_a_range_sensor():
    rear = REAR.lidars[1]
    keys = {"name": "rear", "range_sensor": True, "field_of_view_deg": 30, "mount_x_m": -0.3}
    sonar = type(rear).model_validate(keys | {"mount_yaw_deg": 180, "range_max_m": 3})
    model = REAR.model_copy(update={"further_lidars": (sonar,)})
    given = Scan(0.0, 0, np.full(sonar.beams, 1.25), 0.0, "rear")
    said = [(("/scan_rear", RANGE), scan(given, model, time.time() - 0.02)) for _ in range(20)]
    ends = [*ENDS, out("/scan_rear", RANGE, BEST_EFFORT)]
    seen = look(Pretended(ends, REAR_FRAMES + readings() + said), model, Topics(), Allowed(), 0.06)
    behind_it = seen.model.further_lidars[0]
    assert behind_it.range_sensor
    assert (behind_it.range_max_m, behind_it.mount_x_m) == pytest.approx((3.0, -0.3))
    assert any("range sensor: /scan_rear" in note for note in seen.notes)
    robot = Ros2Robot(seen.model, seen, Spoken(ends, readings() + said))
    (read,) = robot.read().further
    assert read.sensor == "rear"
    assert (read.ranges == np.float32(1.25)).all()
    robot.close()
    said[-1][1].max_range = 1.0
    robot = RobotAdapter(Ros2Robot(seen.model, seen, Spoken(ends, readings() + said)))
    assert robot.read().health.faults == (
        "/scan_rear reports a range from 0.06 to 1 m, and said from 0.06 to 3 m when it was "
        "looked at: fix its driver, or start again",
    )
    robot.close()
    said[-1][1].max_range, said[-1][1].range = 3.0, math.nan
    robot = Ros2Robot(seen.model, seen, Spoken(ends, readings() + said))
    assert robot.read().further == ()
    robot.close()
    with pytest.raises(CohelmError, match="or give it range_sensor: true in the robot's YAML"):
        look(Pretended(ends, REAR_FRAMES + readings()), REAR, Topics(), Allowed(), 0.06)
    with pytest.raises(CohelmError, match="/tf_static does not say where"):
        look(Pretended(ends, FRAMES + readings() + said), model, Topics(), Allowed(), 0.06)
    bare = Allowed(mount_from_model=True)
    seen = look(Pretended(ends, readings() + said), model, Topics(), bare, 0.06)
    assert abs(seen.model.further_lidars[0].mount_yaw_deg) == pytest.approx(180.0)


def with_camera():
    """Sally with a depth camera at the back, and what it says this moment."""
    rear = REAR.lidars[1].model_copy(
        update={"height_band_m": (0.05, 1.0), "depth_image": True, "field_of_view_deg": 80.0,
                "beams": 160}
    )  # fmt: skip
    model = REAR.model_copy(update={"further_lidars": (rear,)})
    seen = scan(Scan(0.0, 0, np.full(160, 2.0), 0.0, "rear"), model, time.time() - 0.02)
    said = rendered.info(rendered.camera_of(rear), seen.header)
    return model, [(("/scan_rear", IMAGE), seen)] * 20, [(("/camera_info", CAMERA_INFO), said)]


def test_depth_images_are_received_with_their_camera_info():
    model, images, info = with_camera()
    ends = [*ENDS, out("/scan_rear", IMAGE, BEST_EFFORT)]
    frames = [(("/tf_static", TF), mounts(model))]

    def found(messages):
        return look(Pretended(ends, readings() + messages), model, Topics(), Allowed(), 0.06)

    seen = found(frames + images + info)
    rear = seen.model.further_lidars[0]
    assert abs(rear.mount_yaw_deg) == pytest.approx(180.0, abs=0.1)
    assert (rear.mount_x_m, rear.range_max_m) == pytest.approx((-0.30, REAR.lidar.range_max_m))
    assert any("depth image: 160 x 120: /scan_rear" in note for note in seen.notes)
    with pytest.raises(
        CohelmError, match=r"nothing is received on /camera_info, where the .* has to"
    ):
        found(frames + images)
    with pytest.raises(CohelmError, match="/tf_static does not say where"):
        found(FRAMES + images + info)
    with pytest.raises(CohelmError, match=r"or give it a height_band_m and depth_image: true"):
        look(Pretended(ends, REAR_FRAMES + readings()), REAR, Topics(), Allowed(), 0.06)
    robot = Ros2Robot(seen.model, seen, Spoken(ends, readings() + images))
    (behind_it,) = robot.read().further
    assert behind_it.ranges[len(behind_it.ranges) // 2] == pytest.approx(2.0, abs=0.01)
    robot.close()


def test_a_robot_that_is_all_there_is_found_as_it_is():
    found = seen(ENDS, FRAMES + readings())
    assert found.out_type == TWIST
    assert found.body == "base_link"
    assert found.model.lidar.beams == 720
    assert found.model.lidar.mount_x_m == pytest.approx(SALLY.lidar.mount_x_m)
    assert found.model.lidar.mount_z_m == pytest.approx(SALLY.lidar.mount_z_m)
    assert found.odom_clock.ahead == 0.0


@pytest.mark.parametrize("topic", ["/odom", "/scan_rear", "/scan"])
@pytest.mark.parametrize("kind", ["planar", "cloud"])
def test_what_comes_too_seldom_to_drive_by_is_refused_in_words(topic, kind):
    """The watchdog waits for 3.5 missing readings: for a minute, of odometry at 1/17 Hz."""
    model, ends, said = REAR, REAR_ENDS, behind()
    if kind == "cloud":
        deep = REAR.lidars[1].model_copy(update={"height_band_m": (0.05, 1.0)})
        model = REAR.model_copy(update={"further_lidars": (deep,)})
        made = cloud([[1.0, 0.0, 0.0]])
        made.header = header(round((time.time() - 0.02) * 1e9), "laser_rear")
        ends, said = [*ENDS, out("/scan_rear", CLOUD, BEST_EFFORT)], [(("/scan_rear", CLOUD), made)]
        said = said * 20
    messages = REAR_FRAMES + readings() + said

    def found(apart):
        return look(Apart(ends, messages, topic, apart), model, Topics(), Allowed(), 0.06)

    with pytest.raises(CohelmError) as error:
        found(1.5)
    assert str(error.value) == (
        f"{topic} comes once in 1.5 s, which is too seldom to drive by: let its driver publish it "
        "at least once a second"
    )
    found(0.9)


@pytest.mark.parametrize("kind", ["planar", "cloud"])
def test_a_mount_in_millimetres_is_refused_as_in_the_robots_file(kind):
    frames = mounts(REAR)
    frames.transforms[1].transform.translation.x = -300.0
    said, kinds = (behind(), SCAN) if kind == "planar" else ([], CLOUD)
    model = REAR
    if kind == "cloud":
        deep = REAR.lidars[1].model_copy(update={"height_band_m": (0.05, 1.0)})
        model = REAR.model_copy(update={"further_lidars": (deep,)})
        made = cloud([[1.0, 0.0, 0.0]])
        made.header = header(round((time.time() - 0.02) * 1e9), "laser_rear")
        said = [(("/scan_rear", CLOUD), made)] * 20
    ends = [*ENDS, out("/scan_rear", kinds, BEST_EFFORT)]
    with pytest.raises(CohelmError) as error:
        look(
            Pretended(ends, [(("/tf_static", TF), frames), *readings(), *said]), model, Topics(),
            Allowed(), 0.06,
        )  # fmt: skip
    assert str(error.value) == (
        "/scan, /scan_rear and /tf_static do not fit the robot: rear LiDAR: mount_x_m and "
        "mount_y_m are in metres, from the middle of the axle; 300 m is outside of the robot"
    )


def test_a_scan_with_impossible_ranges_is_refused_in_one_sentence():
    given = readings()
    for (topic, _), message in given:
        if topic == "/scan":
            message.range_max = 12_000.0
    assert refused(ENDS, FRAMES + given) == (
        "/scan: range_max_m is in metres; 12000 looks like millimetres (12 m)"
    )


def test_the_printed_config_is_a_readable_robot_file(capsys):
    found = seen_rear(REAR_ENDS, REAR_FRAMES + readings() + behind())
    print_found(found, found.model, {"scan": ("/scan",)}, False)
    out = capsys.readouterr().out
    assert "None" not in out
    scan_line = "# scan: /scan, sensor_msgs/msg/LaserScan by /driver (best effort, volatile)"
    assert scan_line in out.splitlines()
    assert "field_of_view_deg: 270.0," in out
    made = RobotModel.model_validate(yaml.safe_load(out))
    for a, b in zip(made.lidars, found.model.lidars, strict=True):
        assert a.lidar().first == pytest.approx(b.lidar().first, abs=1e-5)
        assert a.mount_x_m == pytest.approx(b.mount_x_m, abs=1e-4)


def test_mounts_are_taken_from_the_axle_where_that_is_not_the_bases_origin():
    model, images, info = with_camera()
    ends = [*ENDS, out("/scan_rear", IMAGE, BEST_EFFORT)]
    messages = [(("/tf_static", TF), mounts(model)), *readings(), *images, *info]

    def of(axle):
        robot = model.model_copy(update={"axle_x_m": axle})
        return look(Pretended(ends, messages), robot, Topics(), Allowed(), 0.06)

    there, here = of(0.0), of(0.1)
    for a, b in zip(there.model.lidars, here.model.lidars, strict=True):
        assert b.mount_x_m == pytest.approx(a.mount_x_m - 0.1)
        assert b.mount_y_m == pytest.approx(a.mount_y_m)
    assert here.lidars[0].mount.pose.x == pytest.approx(there.lidars[0].mount.pose.x - 0.1)
    assert here.lidars[1].cloud[0, 3] == pytest.approx(there.lidars[1].cloud[0, 3] - 0.1)


MISSING = [
    ([], "no node of ROS is seen (pretended): is ROS_DOMAIN_ID the robot's"),
    ([into("/cmd_vel", TWIST)],
     "no node publishes /odom: start its driver, or name another topic with --odom; there is no "
     "Odometry at all"),
    ([into("/cmd_vel", TWIST), out("/front/scan", SCAN), out("/odom", ODOMETRY)],
     "no node publishes /scan: start its driver, or name another topic with --scan; LaserScan is "
     "on /front/scan"),
    ([*ENDS[::2], out("/scan", "sensor_msgs/msg/PointCloud2")],
     "/scan is sensor_msgs/msg/PointCloud2 by /driver, and sensor_msgs/msg/LaserScan is needed"),
    (ENDS, "/scan is published by /driver, but nothing comes: is its driver stuck"),
    (ENDS[:2],
     "no node subscribes to /cmd_vel: start the base's driver, or name its topic with --out"),
    ([*ENDS[:2], into("/cmd_vel", "std_msgs/msg/String")],
     "/cmd_vel is wanted as std_msgs/msg/String by /base, and a base takes"),
    ([*ENDS[:2], into("/cmd_vel", TWIST, Qos(True, True))],
     "commands on /cmd_vel never reach the base by /base: the publisher is volatile and the "
     "subscriber wants transient local; fix the QoS of its subscription"),
    ([*ENDS, into("/cmd_vel", STAMPED, node="/other")],
     "/cmd_vel is wanted both as Twist and as TwistStamped by /base, /other: say which"),
    ([*ENDS, out("/cmd_vel", TWIST, node="/cohelm_gate")],
     "/cmd_vel is published by another cohelm by /cohelm_gate: end that one first"),
    ([*ENDS, out("/cmd_vel", TWIST, node="/controller_server")],
     "/cmd_vel is published by /controller_server as well, past the filter: remap that to the "
     "topic of --in"),
]  # fmt: skip


@pytest.mark.parametrize(("ends", "words"), MISSING)
def test_missing_or_mismatched_messages_are_reported_with_the_cure(ends, words):
    said = refused(ends, [])
    assert words in said
    assert all(line and not line.endswith(".") for line in said.splitlines())


def test_commands_have_the_type_that_the_base_subscribes_to():
    ends = [*ENDS[:2], into("/cmd_vel", STAMPED)]
    assert seen(ends, FRAMES + readings()).out_type == STAMPED
    assert seen([*ENDS, ends[2]], FRAMES + readings(), Allowed(stamped=False)).out_type == TWIST
    assert "leave out --stamped" in refused(ENDS, [], Allowed(stamped=True))


def test_unreadable_files_are_reported():
    messages = FRAMES + [m for m in readings() if m[0][0] == "/odom"]
    said = refused(ENDS, [*messages, (("/scan", SCAN), None)])
    assert "what comes on /scan can not be read (7 bytes are no scan): is ROS_DISTRO here" in said


def test_clocks_that_differ_are_taken_into_account_up_to_a_bound_and_refused_beyond():
    found = seen(ENDS, FRAMES + readings(off=2.0))
    assert found.odom_clock.ahead == pytest.approx(-2.0, abs=0.1)
    assert any("2.0" in note and "behind this machine's" in note for note in found.notes)
    ahead = seen(ENDS, FRAMES + readings(off=-3.0))
    assert ahead.odom_clock.ahead == pytest.approx(3.0, abs=0.1)
    assert "ahead of this machine's clock, which is more than 5 s: set both clocks" in refused(
        ENDS, FRAMES + readings(off=-86_400.0)
    )
    assert "use_sim_time:=false" in refused(ENDS, FRAMES + readings(off=time.time() - 100.0))


def test_what_is_doubtful_in_the_robots_file_is_noted_as_at_any_start():
    found = seen(ENDS, FRAMES + readings())
    assert not any("its file has no" in note for note in found.notes)
    lidar = SALLY.lidar.model_copy(update={"noise_m": 0.0})
    model = SALLY.model_copy(update={"delay_s": 0.0, "lidar": lidar})
    notes = look(Pretended(ENDS, FRAMES + readings()), model, Topics(), Allowed(), 0.06).notes
    assert [note for note in notes if "its file has no" in note] == doubts(model)
    assert len(doubts(model)) == 2


def test_an_unknown_frame_is_refused_unless_the_mount_comes_from_the_model():
    said = refused(ENDS, FRAMES + readings(frame="velodyne"))
    assert "/scan is measured in the frame 'velodyne', and /tf_static does not say where" in said
    assert "it has base_link, laser" in said
    found = seen(ENDS, readings(frame="velodyne"), Allowed(mount_from_model=True))
    assert found.model.lidar.mount_x_m == SALLY.lidar.mount_x_m
    assert found.model.lidar.mount_z_m == SALLY.lidar.mount_z_m


def test_two_publishers_on_one_topic_are_refused_and_one_that_is_doubled_is_reported():
    again = out("/scan", SCAN, BEST_EFFORT, "/rear_driver")
    said = refused([*ENDS, again], FRAMES + readings())
    assert said == (
        "/scan is published by /driver, /rear_driver at once, and one LiDAR is needed: remap one "
        "of them, and describe a further LiDAR under further_lidars (one that was killed is gone "
        "after some seconds)"
    )
    said = refused([*ENDS, out("/odom", ODOMETRY, node="/ekf")], FRAMES + readings())
    assert said.startswith(
        "/odom is published by /driver, /ekf at once, and one odometry is needed"
    )
    found = seen([*ENDS, ENDS[0]], FRAMES + readings())
    assert "/odom is published twice by /driver: are there two robots of that name?" in found.notes
    assert not any("twice" in note for note in seen(ENDS, FRAMES + readings()).notes)


def test_scans_in_two_frames_are_of_two_lidars_and_refused_and_later_ones_are_left_out():
    other = [one for one in readings(frame="laser_rear") if one[0][0] == "/scan"]
    said = refused(ENDS, FRAMES + readings() + other)
    assert said == (
        "/scan comes in the frames 'laser', 'laser_rear' by /driver, and one LiDAR is needed: let "
        "each have a topic of its own, and describe the other under further_lidars"
    )
    found = seen(ENDS, FRAMES + readings())
    robot = Ros2Robot(found.model, found, Spoken(ENDS, readings() + other))
    read = robot.read()
    assert read.scan is not None
    assert read.health.faults == (
        "/scan comes in the frame 'laser_rear', and was in 'laser' when it was looked at: fix its "
        "driver, or start again",
    )
    robot.close()
    robot = Ros2Robot(found.model, found, Spoken(ENDS, other + readings()))
    assert robot.read().health.faults == ()  # it has come right again
    robot.close()


def test_undecodable_messages_are_a_fault_but_a_few_are_not():
    found = seen(ENDS, FRAMES + readings())
    for topic, kind in (("/odom", ODOMETRY), ("/scan", SCAN)):
        for many in (2, 3):
            robot = Ros2Robot(found.model, found, Spoken(ENDS, readings()))
            hear = {
                "/odom": robot._on_odometry,
                "/scan": partial(robot._on_scan, SALLY.lidar.name),
            }
            for _ in range(many):
                hear[topic](Received(None, 0.0, f"7 bytes are no {kind}"))
            why = f"what comes on {topic} can not be read (7 bytes are no {kind}): fix its driver"
            assert robot.read().health.faults == ((why,) if many == 3 else ())
            robot.close()


def test_a_missing_or_mismatched_controller_is_reported():
    def note(*ends):
        found = seen([*ENDS, *ends], FRAMES + readings())
        (said,) = (one for one in found.notes if one.startswith("commands: "))
        return said

    assert note() == "commands: no node publishes /cmd_vel_nav yet"
    assert note(out("/key_vel", TWIST), out("/joy_vel", STAMPED)) == (
        "commands: no node publishes /cmd_vel_nav yet; there is /joy_vel, /key_vel"
    )
    assert note(out("/cmd_vel_nav", TWIST)) == "commands: /cmd_vel_nav by /driver, none yet"
    assert note(out("/cmd_vel_nav", "std_msgs/msg/String"), out("/key_vel", TWIST)) == (
        "commands: /cmd_vel_nav is std_msgs/msg/String by /driver, and geometry_msgs/msg/Twist or "
        "geometry_msgs/msg/TwistStamped is needed: name another topic with --in; there is /key_vel"
    )


def fixed(parent, child, at=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0, 1.0)):
    moved = Transform(Vector3(*at), Quaternion(*rotation))
    return TransformStamped(header(0, parent), child, moved)


def test_mounts_are_followed_through_the_tree_turned_and_upside_down():
    tree = StaticTransforms()
    half = math.sqrt(0.5)
    tree.add(TFMessage([
        fixed("base_footprint", "base_link", (0.0, 0.0, 0.1)),
        fixed("base_link", "mast", (0.2, 0.1, 0.3), (0.0, 0.0, half, half)),
        fixed("mast", "laser", (0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        fixed("mast", "tilted", (0.0, 0.0, 0.0), (0.0, math.sin(0.2), 0.0, math.cos(0.2))),
        fixed("mast", "broken", (math.nan, 0.0, 0.0)),
        fixed("mast", "bent", (0.0, 0.0, 0.0), (0.0, math.sin(0.004), 0.0, math.cos(0.004))),
    ]))  # fmt: skip
    mount = tree.mount("laser", "base_footprint")
    assert mount.pose == pytest.approx(Pose(0.2, 0.2, 0.5 * math.pi))
    assert mount.upside_down
    assert mount.height == pytest.approx(0.4)
    assert math.isnan(tree.mount("bent", "base_footprint").height)  # 0.46 deg: it has not one
    assert tree.mount("nowhere", "base_link") is None
    assert tree.mount("broken", "base_link") is None
    with pytest.raises(CohelmError, match="tilted is inclined by 23 deg to base_link"):
        tree.mount("tilted", "base_link")


@pytest.mark.parametrize("scale", [0.6, 1.0, 1.41421356, 1.9])
@pytest.mark.parametrize("psi", [0.0, 0.5 * math.pi, -2.0, 3.0])
def test_a_heading_is_the_same_however_long_its_quaternion_is(psi, scale):
    """x, y, z, w = 0, 0, 1, 1 is a quarter of a turn, as people write it, and was 117 deg."""
    z, w = scale * math.sin(0.5 * psi), scale * math.cos(0.5 * psi)
    assert yaw_of(SimpleNamespace(x=0.0, y=0.0, z=z, w=w)) == pytest.approx(psi)


def test_a_namespace_takes_in_the_topics_and_names_are_checked():
    topics = Topics.named("j100_0001", scan="sensors/lidar2d_0/scan")
    assert topics.out == "/j100_0001/cmd_vel"
    assert topics.scan == "/j100_0001/sensors/lidar2d_0/scan"
    assert Topics.named("/r", scan="/front").scan == "/front"
    with pytest.raises(CohelmError, match="is no name of a topic"):
        Topics.named(scan="/2 scans")
    assert Odometry.__msgtype__ == ODOMETRY


def clock(*times: float):
    """A simulator that tells these [s]."""
    return [(("/clock", TYPE), Clock(Time(int(t), round(1e9 * (t % 1.0)) % 10**9))) for t in times]


def simulated(at: float = 100.0):
    """What a simulated robot tells at such a time [s]."""
    return [*FRAMES, *readings(time.time() - at)]


def test_stamps_in_simulated_time_are_compared_to_the_clock_topic_and_reported():
    found = seen(ENDS, [*clock(100.0), *simulated()])
    assert found.simulated
    assert "simulated time: /clock, 1.00 of the wall's" in found.notes
    # as far apart as making the messages took, and not the decades to the wall's time
    assert abs(found.odom_clock.ahead) < 1.0
    assert abs(found.lidars[0].clock.ahead) < 1.0


def test_a_clock_beside_stamps_of_the_wall_or_far_from_them_is_not_theirs():
    assert not seen(ENDS, [*clock(100.0), *FRAMES, *readings()]).simulated
    assert "/clock does not carry its time: bridge it" in refused(
        ENDS, [*clock(500.0), *simulated()]
    )


def test_a_simulator_without_clock_and_one_that_is_too_fast_are_refused():
    assert "/clock does not carry its time: bridge it" in refused(ENDS, simulated())
    fast = clock(*(99.9 + 0.001 * k for k in range(100)))
    said = re.search(r"([0-9.]+) times as fast as the wall", refused(ENDS, [*fast, *simulated()]))
    assert said is not None
    assert 1.1 < float(said[1]) <= 2.0  # 2 if giving a hundred messages takes no time


def test_a_camera_that_does_not_show_the_floor_it_is_to_watch_is_refused():
    """Sally's own looks down as far as it takes; level it would leave a ring that nothing sees."""
    deep = load_robot("sally-depth")
    lidar = deep.further_lidars[0]
    seen = scan(Scan(0.0, 0, np.full(lidar.beams, 2.0), 0.0, "deep"), deep, time.time() - 0.02)
    said = rendered.info(rendered.camera_of(lidar), seen.header)
    messages = [(("/scan_deep", IMAGE), seen)] * 20 + [(("/camera_info", CAMERA_INFO), said)]
    ends = [*ENDS, out("/scan_deep", IMAGE, BEST_EFFORT)]

    def found(model, down):
        frames = mounts(deep)
        x, y, z, w = rendered.optical(down)
        frames.transforms[1].transform.rotation = Quaternion(x, y, z, w)
        heard = [(("/tf_static", TF), frames), *readings(), *messages]
        return look(Pretended(ends, heard), model, Topics(), Allowed(), 0.06)

    notes = found(deep, rendered.tilt(lidar, 0.55)).notes
    assert any("floor from 0.55 to 1.55 m, of which 100 % is seen now" in one for one in notes)
    with pytest.raises(CohelmError, match=r"floor in all of its picture from 1.05 m on"):
        found(deep, 0.0)
    later = lidar.floor.model_copy(update={"from_m": 1.05})
    given = (lidar.model_copy(update={"floor": later}),)
    found(deep.model_copy(update={"further_lidars": given}), 0.0)
    with pytest.raises(CohelmError, match=r"at no distance, .* tilt the camera down, narrow field"):
        found(deep, -0.3)
