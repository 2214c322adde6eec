"""The collision monitor with the real gate, robot and LiDAR, and no filter at all."""

import pytest

from tests.robot.collision_monitor.rooms import KINDS, drive

HARD = 0.1
"""No contact is faster [m/s]."""


@pytest.mark.parametrize("number", range(len(KINDS)))
def test_without_a_filter_it_hits_nothing_at_speed(number):
    row = drive(number, 300, all_round=True)
    assert row.hit <= HARD
    assert row.acted > 0
    assert row.way > 0.5
    assert row.faulted == ""


def test_without_the_monitor_the_same_drive_hits_hard():
    assert drive(2, 300, all_round=True, watched=False).hit > 0.5


def test_a_forward_lidar_keeps_points_that_it_drives_towards():
    row = drive(0, 300, ahead=True)
    assert row.hit <= HARD
    assert row.acted > 0


@pytest.mark.parametrize("number", [17, 26])
def test_ground_that_a_lidar_never_saw_is_not_driven_into_at_speed(number):
    """Hit at 1.0 and 0.9 m/s by a monitor that knows only returns."""
    row = drive(number, 7002)
    assert row.hit <= HARD
    assert row.acted > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_in_fifty_rooms_it_hits_nothing_at_speed(kind):
    for number in range(kind, 50 * len(KINDS), len(KINDS)):
        row = drive(number, 301, all_round=True)
        assert row.hit <= HARD, row
        assert row.faulted == "", row
