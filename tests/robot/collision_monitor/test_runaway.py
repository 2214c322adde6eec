"""Motion that nobody commands."""

import pytest

from cohelm.core.types import Twist
from cohelm.robot.collision_monitor.runaway import MOVES, PATIENCE, Runaway

DELAY, BRAKING = 0.1, 0.4
STOPPING = DELAY + BRAKING
STILL, DRIVES = Twist(0.0, 0.0), Twist(0.3, 0.0)


def noticed_after(speed, moved_before=True, commanded=lambda t: False):
    """How long after the first 0 it is noticed; None within 3 s."""
    watch = Runaway(DELAY, BRAKING)
    if moved_before:
        assert not watch.noticed(-0.02, DRIVES, 0.3)
    for k in range(150):
        t = 0.02 * k
        if watch.noticed(t, DRIVES if commanded(t) else STILL, speed(t)):
            return t
    return None


def test_a_robot_that_continues_is_detected_as_soon_as_it_should_stand():
    after = noticed_after(lambda t: 0.3)
    assert STOPPING + PATIENCE < after <= STOPPING + PATIENCE + 0.021


def test_one_that_brakes_as_it_can_is_not():
    assert noticed_after(lambda t: max(0.5 - t, 0.0)) is None
    assert noticed_after(lambda t: MOVES) is None


def test_one_that_sets_off_by_itself_is_noticed_sooner():
    after = noticed_after(lambda t: 0.3 if t > 1.0 else 0.0)
    assert 1.0 + PATIENCE < after <= 1.0 + PATIENCE + 0.041
    assert noticed_after(lambda t: 0.3 if t > 1.0 else 0.0, moved_before=False) == after


def test_a_nudge_is_none_and_a_second_one_neither():
    assert noticed_after(lambda t: 0.3 if 1.0 < t < 1.2 or 1.3 < t < 1.5 else 0.0) is None


def test_a_robot_commanded_to_drive_may_and_the_time_restarts():
    assert noticed_after(lambda t: 0.3, commanded=lambda t: True) is None
    after = noticed_after(lambda t: 0.3, commanded=lambda t: 0.4 < t < 1.0)
    assert 1.0 + STOPPING + PATIENCE < after <= 1.0 + STOPPING + PATIENCE + 0.041


def test_a_robot_that_has_stood_and_is_commanded_to_drive_has_the_full_time_again():
    def speed(t):
        return 0.0 if t < 0.4 else 0.3

    after = noticed_after(speed, commanded=lambda t: 0.4 < t < 1.0)
    assert after > 1.0 + STOPPING + PATIENCE


def test_turning_by_either_hand_or_backing_is_driving():
    watch = Runaway(DELAY, BRAKING)
    for k in range(200):
        for twist in (Twist(0.0, 0.3), Twist(-0.2, 0.0)):
            assert not watch.noticed(0.02 * k, twist, 0.3)


def test_a_robot_that_had_not_begun_to_move_has_the_full_stopping_time():
    """Its drives lag: it speeds up yet for a reading, and brakes then."""
    watch = Runaway(DELAY, BRAKING)
    assert not watch.noticed(0.0, DRIVES, 0.0)
    assert not watch.noticed(0.02, STILL, 0.0)
    for k in range(2, 25):
        assert not watch.noticed(0.02 * k, STILL, 0.3)


@pytest.mark.parametrize(("delay", "lasts"), [(0.1, 0.6), (0.32, 0.3), (0.5, 0.45), (1.0, 0.6)])
def test_a_short_command_that_takes_effect_late_is_no_motion_by_itself(delay, lasts):
    """Of a robot with a long delay it is over before the robot begins to move."""
    watch = Runaway(delay, BRAKING)
    for k in range(200):
        t = 0.02 * k
        applied = DRIVES if t < lasts else STILL
        moves = delay <= t < delay + lasts
        assert not watch.noticed(t, applied, 0.3 if moves else 0.0)
    for k in range(200, 214):
        found = watch.noticed(0.02 * k, STILL, 0.3)
    assert found


def test_it_is_noticed_after_its_patience_and_not_at_its_end():
    watch = Runaway(DELAY, BRAKING)
    for k in range(9):
        assert not watch.noticed(0.125 * k, STILL, 0.0)
    assert not watch.noticed(1.0 + PATIENCE, STILL, 0.3)
    assert watch.noticed(1.0 + PATIENCE + 0.001, STILL, 0.3)
