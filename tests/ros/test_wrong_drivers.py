"""Drivers that do what drivers should not: each is one sentence with topic and cure, or no harm."""

import copy
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import tf2_msgs__msg__TFMessage as TFMessage

from cohelm.core.types import Pose, Twist
from cohelm.record.ros2 import header
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.port import Odometry as Reading, Scan
from cohelm.ros import interlock, look as looking
from cohelm.ros.clock import seconds
from cohelm.ros.found import Allowed
from cohelm.ros.inspection import Inspection
from cohelm.ros.mismatch import ODOMETRY, SCAN, STAMPED, TF
from cohelm.ros.port import Received
from cohelm.ros.robot import Ros2Robot
from cohelm.ros.served import odometry, scan
from tests.ros.stage import until
from tests.ros.test_unheard import (
    BEST_EFFORT,
    ENDS,
    FRAMES,
    REAR,
    REAR_ENDS,
    REAR_FRAMES,
    SALLY,
    Pretended,
    Spoken,
    behind,
    fixed,
    into,
    out,
    readings,
    refused,
    seen,
)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(looking, "_LEAST", 0.0)


@pytest.fixture
def robot():
    found = seen(ENDS, FRAMES + readings())
    made = Ros2Robot(found.model, found, Spoken(ENDS))
    yield made
    made.close()


def laser(k: int = 0, value: float = 2.0, age: float = 0.02):
    return scan(Scan(0.0, k, np.full(720, value), 0.0), SALLY, time.time() - age)


def hears(robot, *messages):
    """What is read after each, as a driver sends them."""
    read = []
    for message in messages:
        robot._on_scan(SALLY.lidar.name, Received(message, time.monotonic()))
        read.append(robot.read())
    return read


def wrong(message, **fields):
    for name, value in fields.items():
        setattr(message, name, value)
    return message


NONE = np.empty(0, np.float32)
NO_SCANS = [
    {"ranges": NONE},
    {"ranges": np.full(1, 2.0, np.float32)},
    {"angle_increment": math.nan},
    {"angle_increment": 0.0},
    {"angle_min": math.inf},
    {"angle_increment": 1.0},
]


@pytest.mark.parametrize("fields", NO_SCANS)
def test_scans_that_are_none_are_left_out_and_three_of_them_name_topic_and_cure(robot, fields):
    (sound,) = hears(robot, laser())
    assert sound.scan is not None
    one, two = hears(robot, wrong(laser(1), **fields), wrong(laser(2), **fields))
    assert one.scan is None
    assert one.health.faults == two.health.faults == ()
    (again,) = hears(robot, laser(3))
    assert again.scan is not None
    assert again.health.faults == ()
    *_, third = hears(robot, *(wrong(laser(k), **fields) for k in range(4, 7)))
    (fault,) = third.health.faults
    assert fault.startswith("/scan ")
    assert "fix" in fault


@pytest.mark.parametrize("off", [2.0, 0.0, -3.0])
def test_commands_are_stamped_by_the_clock_of_the_base(off):
    """Which drops those that are older than its time-out (diff_drive_controller), and drives on for
    2 s more, when they cease, by those from 2 s ahead."""
    ends, sent = [*ENDS[:2], into("/cmd_vel", STAMPED)], []
    found = seen(ends, FRAMES + readings(off=off))
    made = Ros2Robot(found.model, found, Spoken(ends))
    made._out = SimpleNamespace(send=sent.append)
    made.send(Twist(0.3, 0.0))
    made.close()
    (one,) = sent
    assert seconds(one.header.stamp) == pytest.approx(time.time() - off, abs=0.3)


def test_other_readings_count_though_one_lidar_sends_no_scan():
    found = looking.look(
        Pretended(REAR_ENDS, REAR_FRAMES + readings() + behind()), REAR, wait=0.06,
        topics=looking.Topics(), allowed=Allowed(),
    )  # fmt: skip
    robot = Ros2Robot(found.model, found, Spoken(REAR_ENDS))
    empty = wrong(laser(), ranges=NONE)
    empty.header = header(time.time_ns(), "laser_rear")
    robot._on_scan("rear", Received(empty, time.monotonic()))
    robot._on_scan("front", Received(laser(), time.monotonic()))
    read = robot.read()
    assert read.scan is not None
    assert read.further == ()
    robot.close()


def test_a_scan_that_comes_twice_is_read_once(robot):
    """By a relay, or a bridge that bridges two ways: the same message, stamp and all."""
    rng, given, monitor = np.random.default_rng(3), [], PlausibilityMonitor(robot.model)
    for k in range(20):
        message = laser(k)
        message.ranges = (2.0 + 0.02 * rng.normal(size=720)).astype(np.float32)
        for one in (message, copy.deepcopy(message)):
            made = odometry(Reading(0.0, Pose(0, 0, 0), Twist(0, 0)), time.time())
            robot._on_odometry(Received(made, time.monotonic()))
            (read,) = hears(robot, one)
            given.append(read.scan)
            if read.scan is not None:
                now = robot.now()
                assert not monitor.observe(now, read, Twist(0.0, 0.0)).fault
        time.sleep(0.05)
    assert sum(one is not None for one in given) == 20


def test_a_scan_with_the_stamp_of_the_one_before_and_other_ranges_is_still_read(robot):
    """It is no copy: the plausibility monitor faults for it."""
    first = laser()
    second = copy.deepcopy(first)
    second.ranges = second.ranges + np.float32(0.01)
    assert all(one.scan is not None for one in hears(robot, first, second))


def test_a_scan_without_a_frame_names_the_drivers_parameter():
    said = refused(ENDS, FRAMES + readings(frame=""))
    assert said.startswith("/scan names no frame (its header.frame_id is empty)")
    assert "frame_id" in said.split(":", 1)[1]
    found = seen(ENDS, readings(frame=""), Allowed(mount_from_model=True))
    assert found.model.lidar.mount_x_m == SALLY.lidar.mount_x_m


def test_a_frame_with_a_leading_slash_is_the_one_without():
    found = seen(ENDS, FRAMES + readings(frame="/laser"))
    assert found.model.lidar.mount_x_m == pytest.approx(SALLY.lidar.mount_x_m)
    robot = Ros2Robot(found.model, found, Spoken(ENDS, readings(frame="laser")))
    read = robot.read()
    assert read.scan is not None
    assert read.health.faults == ()
    robot.close()


TREES = [
    [fixed("base_link", "laser", (0.1, 0.0, 0.2))],
    [fixed("base_footprint", "laser", (0.3, 0.0, 0.2))],
    [fixed("base_link", "mast"), fixed("mast", "laser", (0.3, 0.0, 0.1))],
]


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("other", TREES)
def test_a_lidar_with_two_places_is_refused_and_both_are_named(other, order):
    """Whichever came last would count: the robot's description, or what someone tried by hand."""
    trees = [*FRAMES, (("/tf_static", TF), TFMessage(other))][::order]
    said = refused(ENDS, trees + readings())
    assert said.startswith("/scan may be in two places: /tf_static has two places of 'laser', at x")
    assert "static_transform_publisher" in said


def test_a_place_that_is_published_again_or_of_another_sensor_is_no_second_one():
    camera = [fixed("base_link", "camera"), fixed("mast", "camera", (1.0, 0.0, 0.0))]
    found = seen(ENDS, [*FRAMES, *FRAMES, (("/tf_static", TF), TFMessage(camera)), *readings()])
    assert found.model.lidar.mount_x_m == pytest.approx(SALLY.lidar.mount_x_m)


SECOND = [
    (out("/scan", SCAN, BEST_EFFORT, "/rear_driver"), "one LiDAR is needed"),
    (out("/odom", ODOMETRY, node="/ekf"), "one odometry is needed"),
]


@pytest.mark.parametrize(("end", "why"), SECOND)
def test_a_second_driver_that_comes_later_is_a_fault_until_it_goes(monkeypatch, end, why):
    """In the same frame nothing else tells its readings from the first one's."""
    monkeypatch.setattr(interlock, "_LOOK", 0.01)
    transport = Spoken(list(ENDS))
    found = seen(ENDS, FRAMES + readings())
    robot = Ros2Robot(found.model, found, transport)
    time.sleep(0.05)
    assert robot.read().health.faults == ()
    transport.ends.append(end)
    assert until(lambda: bool(robot.read().health.faults), 2.0)
    (fault,) = robot.read().health.faults
    assert fault.startswith(f"{end.topic} is published by /driver, {end.node} at once, and {why}")
    transport.ends.remove(end)
    assert until(lambda: not robot.read().health.faults, 2.0)
    robot.close()


def alive(robot, transport: Spoken, senders: str) -> tuple[str, ...]:
    """What is wrong after an odometry and a scan of each of these senders, and a look at who is
    there after each."""
    for k, sender in enumerate(senders):
        made = odometry(Reading(0.0, Pose(0, 0, 0), Twist(0, 0)), time.time())
        robot._on_odometry(Received(made, time.monotonic(), "", sender))
        message = laser(k, 2.0 + 0.001 * time.monotonic() % 0.01)
        robot._on_scan(SALLY.lidar.name, Received(message, time.monotonic(), "", sender))
        before = transport.looks
        assert until(lambda before=before: transport.looks > before + 1)  # the next is over
    return robot.read().health.faults


@pytest.mark.parametrize("end", [end for end, _ in SECOND], ids=["scan", "odom"])
def test_a_driver_started_again_under_another_name_is_one_and_a_second_that_sends_is_two(
    monkeypatch, end
):
    """Whoever was killed is listed until its lease is over, and sends nothing any more."""
    monkeypatch.setattr(interlock, "_LOOK", 0.01)
    transport = Spoken(list(ENDS))
    robot = Ros2Robot(*_found(), transport)
    assert alive(robot, transport, "aaa") == ()
    transport.ends.append(end)
    assert alive(robot, transport, "a") == ()  # the other has sent nothing yet
    assert alive(robot, transport, "bbbbb") == ()
    (fault,) = alive(robot, transport, "a")  # it was not dead
    assert fault.startswith(f"{end.topic} is published by /driver, {end.node} at once")
    assert alive(robot, transport, "bbbbb") == (fault,)  # and may send again any time
    transport.ends.remove(end)
    assert until(lambda: not robot.read().health.faults, 2.0)
    transport.ends.append(end)
    assert alive(robot, transport, "ccc") == ()
    assert alive(robot, transport, "b") == (fault,)
    robot.close()


def test_a_second_driver_of_whom_nobody_knows_what_it_sends_is_a_fault(monkeypatch):
    """As through a bridge, whose messages name no sender."""
    monkeypatch.setattr(interlock, "_LOOK", 0.01)
    transport = Spoken([*ENDS, SECOND[0][0]])
    robot = Ros2Robot(*_found(), transport)
    message = laser(1)
    robot._on_scan(SALLY.lidar.name, Received(message, time.monotonic(), "", "a"))
    robot._on_scan(SALLY.lidar.name, Received(laser(2), time.monotonic()))
    assert until(lambda: bool(robot.read().health.faults), 2.0)
    robot.close()


def _found():
    found = seen(ENDS, FRAMES + readings())
    return found.model, found


def turned(psi: float, v: float, world: bool):
    """Odometry of a robot that drives where it looks."""
    made = odometry(Reading(0.0, Pose(1.0, 2.0, psi), Twist(v, 0.0)), time.time())
    if world:
        made.twist.twist.linear.x = v * math.cos(psi)
        made.twist.twist.linear.y = v * math.sin(psi)
    return made


@pytest.mark.parametrize("psi", [0.5, 1.57, 2.5, -2.0])
@pytest.mark.parametrize("v", [0.3, -0.3])
def test_a_twist_in_the_frame_of_the_odometry_is_named(robot, psi, v):
    for k in range(5):
        robot._on_odometry(Received(turned(psi, v, True), 0.0))
        if k < 2:
            assert robot.read().health.faults == ()
    (fault,) = robot.read().health.faults
    assert fault == (
        "/odom gives its twist along the axes of 'odom', and those of 'base_link' are needed "
        "(REP-105, nav_msgs/msg/Odometry): fix its driver"
    )


@pytest.mark.parametrize(("psi", "v"), [(0.5, 0.3), (1.57, -0.3), (0.05, 0.3), (1.0, 0.02)])
def test_a_twist_in_the_frame_of_the_base_is_not(robot, psi, v):
    for sideways in (0.0, 0.01, -0.03):
        for _ in range(5):
            made = turned(psi, v, False)
            made.twist.twist.linear.y = sideways
            robot._on_odometry(Received(made, 0.0))
        read = robot.read()
        assert read.health.faults == ()
        assert read.odometry is not None


@pytest.mark.parametrize(("rate", "told"), [(1.0, True), (3.0, True), (5.0, False)])
def test_a_lidar_that_is_too_slow_for_people_is_told(monkeypatch, rate, told):
    monkeypatch.setattr(Inspection, "rate", lambda self, rows: rate)
    found = seen(ENDS, FRAMES + readings())
    notes = [note for note in found.notes if f"/scan comes {rate:.1f} times a second" in note]
    assert bool(notes) == told
