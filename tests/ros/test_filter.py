"""A robot behind ROS topics in one process, the filter in two others: it stops for what it must."""

from __future__ import annotations

import math
import re

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")


from cohelm.core.types import Twist
from tests.few import first
from tests.ros.stage import Controller, stage, until

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.fixture(scope="module", params=["kinematic", pytest.param("twin", marks=pytest.mark.slow)])
def hall(request):
    with stage(plant=request.param) as made:
        yield made


def test_over_ground_that_nobody_has_seen_it_backs_slowly_and_says_so(hall):
    speeds = [0.0]

    def back() -> bool:
        speeds.append(hall.base.truth().twist.v)
        return hall.base.truth().pose.x < -0.15

    hall.controller.twist = Twist(-0.8, 0.0)
    assert until(back, 15.0)
    hall.controller.twist = Twist(0.0, 0.0)
    assert -0.36 < min(speeds) < -0.1
    assert any("ground never seen" in said for said in hall.filter.said), hall.filter.said


def test_with_full_speed_at_a_wall_it_stops_before_it(hall):
    hall.controller.twist = Twist(1.0, 0.0)
    assert until(lambda: hall.base.truth().pose.x > 3.3, 15.0)
    assert hall.stands()
    truth = hall.base.truth()
    assert truth.least_moving > 0.01  # the promise is half of the hard margin, 15 mm
    assert truth.clearance < 0.4
    assert until(  # what was said just before keeps its words for a second
        lambda: any("limited by" in said or "brakes" in said for said in hall.filter.said), 3.0
    ), hall.filter.said


def test_two_controllers_at_once_are_named(hall):
    hall.controller.twist = Twist(0.0, 0.0)
    other = Controller(hall.theirs)
    try:
        assert until(
            lambda: any("come from several nodes in turn" in said for said in hall.filter.said),
            10.0,
        )
    finally:
        other.close()


def goes_again(hall) -> bool:
    """Whether it drives once what was wrong is mended, after a reset where one is needed."""
    assert hall.filter.fault is None
    hall.base.fault("")

    def drives() -> bool:
        if hall.filter.latched:
            hall.reset()
        return hall.base.truth().twist.v > 0.05

    if not hall.filter.latched:
        assert hall.turned_round()
    hall.controller.twist = Twist(0.4, 0.0)
    return until(drives, 15.0)


def told(hall, words: str) -> str:
    """What the node has said since, which has to match: of several layers one speaks first. What
    comes again soon is not said again, but is what it says now."""

    def all_of_it() -> str:
        return " / ".join([*hall.filter.said, hall.filter.rows[-1].reason])

    until(lambda: re.search(words, all_of_it()) is not None, 3.0)
    said = all_of_it()
    assert re.search(words, said), said
    return said


FAULTS = [
    ("no scan", "the scan is"),
    ("tomorrow", "from the future: a clock jumped"),
    ("nan odometry", "the odometry is not a number"),
    ("no odometry", "the odometry is|moves at .* although it is commanded to stand"),
    ("stale scan", "stamps went back by 1.9|the scan is 2|the scan comes 2... ms after its stamp"),
    ("nan scan", "the scan is not a number|vanished from the scan|of the scan are empty"),
    (
        "step /odom,/scan -3600",
        "3600 s after its stamp: a clock jumped; if it stays so, set both|went back by 3599",
    ),
    ("step /odom,/scan 31536000", "s from the future: a clock jumped; if it stays so, set both"),
    ("step /scan -1", "stamps went back by 0.9. s, as if a clock was set|ms after its stamp"),
    ("leap", "the odometry jumped"),
]


@pytest.mark.parametrize(("fault", "reason"), first(FAULTS, 2))
def test_it_stops_for_bad_readings_with_the_reason_and_continues_once_they_are_valid(
    hall, fault, reason
):
    assert goes_again(hall)
    hall.filter.said.clear()
    hall.base.fault(fault)
    assert hall.stands(3.0)
    told(hall, reason)
    assert goes_again(hall)


def test_after_stamps_of_tomorrow_it_drives_as_fast_as_before(hall):
    assert goes_again(hall)
    hall.base.fault("tomorrow")
    assert hall.stands(3.0)
    assert goes_again(hall)
    assert until(lambda: hall.speed() > 0.3, 5.0), hall.filter.said


def test_a_controller_that_falls_silent_stops_it(hall):
    assert goes_again(hall)
    hall.filter.said.clear()
    hall.controller.twist = None
    assert hall.stands(3.0)
    told(hall, "no command on /cmd_vel_nav for 0.")
    assert not hall.filter.latched


def test_a_command_that_is_no_number_stops_it(hall):
    assert goes_again(hall)
    hall.filter.said.clear()
    hall.controller.twist = Twist(math.nan, 0.0)
    assert hall.stands(3.0)
    told(hall, "the command is not a number")
    assert not hall.filter.latched


def test_half_of_all_messages_lost_does_no_harm(hall):
    assert goes_again(hall)
    hall.base.fault("half")
    assert until(lambda: hall.base.truth().stamp > 0.0 and len(hall.filter.rows) > 0)
    before = hall.base.truth()
    until(lambda: hall.base.truth().stamp > before.stamp + 1.5, 5.0)
    assert goes_again(hall)
    assert hall.base.truth().least_moving > 0.05
