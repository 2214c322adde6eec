"""What the gate lets through, what it refuses, and what only a deliberate reset undoes."""

import math

import pytest

from cohelm.core.types import Twist
from cohelm.robot.gate import gate as g
from cohelm.robot.gate.bounds import Bounds, change_time, towards, within_speeds
from cohelm.robot.gate.gate import STANDING, Gate, GateRules, Passed, Proposal
from cohelm.robot.gate.modes import GateMode, driving, latched

BOUNDS = Bounds(1.0, 4.0, 2.0, 16.0, 1.2, 2.0, 0.5)
RULES = GateRules(BOUNDS)
NAN, INF = math.nan, math.inf


def ready(
    now: float = 10.0, applied: Twist = STANDING, mode: GateMode = GateMode.AUTOMATIC
) -> Gate:
    """A gate in the middle of good work: the last proposal, number 7, came a period ago."""
    return Gate(mode, "", applied, now - 0.02, now - 0.02, 7, now - 0.02, 0, now - 0.02)


def ask(gate: Gate, v: float, omega: float = 0.0, *, now=10.0, stamp=None, n=8):
    stamp = now if stamp is None else stamp
    return g.propose(gate, Proposal(n, stamp, Twist(v, omega)), now, RULES)


# -- what passes ---------------------------------------------------------------------------------


def test_a_sound_proposal_within_the_bounds_passes_as_it_is():
    gate, passed = ask(ready(), 0.03, 0.02)
    assert passed == Passed(Twist(0.03, 0.02), "")
    assert gate == Gate(
        GateMode.AUTOMATIC, "", Twist(0.03, 0.02),
        pytest.approx(10.0 - 0.02 + 0.0175), 10.0, 8, 10.0, 0, 10.0,
    )  # fmt: skip


@pytest.mark.parametrize("mode", [GateMode.AUTOMATIC, GateMode.SHARED])
def test_both_driving_modes_let_the_wheels_turn(mode):
    assert ask(ready(mode=mode), 0.02)[1].applied == Twist(0.02, 0.0)


@pytest.mark.parametrize("mode", [GateMode.IDLE, GateMode.STOPPED, GateMode.FAULTED])
def test_in_all_other_modes_the_robot_brakes_and_stands(mode):
    gate = ready(applied=Twist(0.1, 0.0), mode=mode)._replace(reason="why")
    now, speeds = 10.0, []
    for n in range(8, 20):
        gate, passed = ask(gate, 0.5, now=now, n=n)
        speeds.append(passed.applied.v)
        assert passed.reason == "why"
        now += 0.02
    assert speeds[:3] == pytest.approx([0.04, 0.0, 0.0])  # 2 m/s^2 for 20 ms, and 10 ms ahead
    assert all(v == 0.0 for v in speeds[2:])
    assert gate.mode == mode


def test_an_idle_robot_reports_idle():
    assert ask(ready(mode=GateMode.IDLE), 0.5)[1] == Passed(STANDING, "idle")
    assert g.tick(ready(mode=GateMode.IDLE), 10.0, RULES)[1] == Passed(STANDING, "idle")


# -- speed and acceleration ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "allowed"),
    [
        (Twist(1.0, 0.0), Twist(1.0, 0.0)),
        (Twist(2.0, 0.4), Twist(1.0, 0.2)),
        (Twist(-2.0, 0.4), Twist(-1.0, 0.2)),
        (Twist(0.0, 4.0), Twist(0.0, 2.0)),
        (Twist(0.0, -4.0), Twist(0.0, -2.0)),
        (Twist(0.8, 2.0), Twist(0.8 * 1.2 / 1.3, 2.0 * 1.2 / 1.3)),  # right wheel 1.3
        (Twist(0.8, -2.0), Twist(0.8 * 1.2 / 1.3, -2.0 * 1.2 / 1.3)),  # left wheel 1.3
        (Twist(0.95, 1.0), Twist(0.95, 1.0)),  # right wheel 1.2, exactly
        (Twist(0.0, 0.0), Twist(0.0, 0.0)),
    ],
)
def test_a_twist_that_is_too_fast_is_slowed_on_its_arc(asked, allowed):
    assert within_speeds(asked, BOUNDS) == pytest.approx(allowed, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "takes"),
    [
        (Twist(0.4, 0.0), 0.2),  # the wheels' 2 m/s^2, not the body's 4
        (Twist(-0.4, 0.0), 0.2),
        (Twist(0.2, 0.8), 0.2),  # right wheel
        (Twist(0.2, -0.8), 0.2),  # left wheel
        (Twist(0.0, 1.6), 0.2),
        (Twist(0.0, 0.0), 0.0),
    ],
)
def test_how_long_a_change_takes_by_its_slowest_wheel(change, takes):
    assert change_time(change, BOUNDS) == pytest.approx(takes, rel=1e-12)


def test_the_body_has_its_own_accelerations():
    heavy = BOUNDS._replace(acceleration=1.0, yaw_acceleration=0.5)
    assert change_time(Twist(0.2, 0.0), heavy) == pytest.approx(0.2)
    assert change_time(Twist(-0.2, 0.0), heavy) == pytest.approx(0.2)
    assert change_time(Twist(0.0, 0.2), heavy) == pytest.approx(0.4)
    assert change_time(Twist(0.0, -0.2), heavy) == pytest.approx(0.4)


def test_towards_goes_straight_and_says_what_it_used():
    there = towards(Twist(0.1, 0.2), Twist(0.12, 0.2), BOUNDS, 0.02)
    assert there == (Twist(0.12, 0.2), pytest.approx(0.01))
    exactly = towards(Twist(0.0, 0.0), Twist(0.04, 0.0), BOUNDS, 0.04 / 2.0)
    assert exactly == (Twist(0.04, 0.0), 0.02)
    part, used = towards(Twist(0.1, 0.2), Twist(0.9, 0.6), BOUNDS, 0.1)
    assert part == pytest.approx((0.1 + 0.8 * 0.1 / 0.45, 0.2 + 0.4 * 0.1 / 0.45))
    assert used == 0.1


def test_just_enough_time_reaches_the_goal_to_the_last_bit():
    before, goal = Twist(0.5, 0.0), Twist(0.1, 0.0)
    assert before.v + (goal.v - before.v) != goal.v  # what rounding would make of it
    takes = change_time(Twist(goal.v - before.v, 0.0), BOUNDS)
    assert towards(before, goal, BOUNDS, takes) == (goal, takes)


def test_no_time_allows_no_change():
    for time in (0.0, -1.0):
        assert towards(Twist(0.1, 0.2), Twist(0.9, 0.6), BOUNDS, time) == (Twist(0.1, 0.2), 0.0)


def test_what_is_there_already_takes_no_time_though_rounding_has_left_less_than_none():
    assert towards(Twist(0.1, 0.2), Twist(0.1, 0.2), BOUNDS, -1e-18) == (Twist(0.1, 0.2), 0.0)


def test_too_high_a_speed_is_reported():
    slow = RULES._replace(bounds=BOUNDS._replace(wheel_acceleration=INF, acceleration=INF,
                                                 yaw_acceleration=INF))  # fmt: skip
    _, passed = g.propose(ready(), Proposal(8, 10.0, Twist(5.0, 0.0)), 10.0, slow)
    assert passed == Passed(Twist(1.0, 0.0), "faster than the robot may be")


def test_too_fast_a_change_is_made_as_fast_as_it_may():
    gate, passed = ask(ready(), 0.5)
    assert passed.applied == pytest.approx((2.0 * 0.03, 0.0))  # a period, and the jitter
    assert passed.reason == "a change faster than the robot may make"
    gate, passed = ask(gate, 0.5, now=10.02, n=9)
    assert passed.applied == pytest.approx((2.0 * 0.05, 0.0))  # the jitter is not allowed twice


def test_many_proposals_at_once_gain_no_speed():
    gate = ready()
    for n in range(8, 200):
        gate, passed = ask(gate, 0.5, n=n)
    assert passed.applied.v == pytest.approx(2.0 * 0.03)


def test_what_acceleration_allows_is_saved_up_for_one_period_only():
    gate = ready()._replace(change_until=0.0)
    assert ask(gate, 0.5)[1].applied.v == pytest.approx(2.0 * 0.03)


def test_the_first_proposal_of_all_gains_no_more():
    gate, _ = ask(Gate(), 0.5)
    gate, said = g.drive(gate, GateMode.AUTOMATIC, 10.0, RULES)
    assert said == ""
    assert ask(gate, 0.5, n=9)[1].applied.v == pytest.approx(2.0 * 0.03)


# -- what is refused, and what is a fault --------------------------------------------------------


@pytest.mark.parametrize("n", [7, 6, -5])
def test_out_of_order_is_refused_and_the_wheels_keep_what_they_have(n):
    gate, passed = ask(ready(applied=Twist(0.3, 0.1)), 0.2, n=n)
    assert passed == Passed(Twist(0.3, 0.1), "out of order")
    assert (gate.refused, gate.last_proposal, gate.sequence, gate.mode) == (
        1,
        9.98,
        7,
        GateMode.AUTOMATIC,
    )


def test_a_gap_in_the_numbers_is_no_disorder():
    assert ask(ready(), 0.02, n=800)[1].reason == ""


def test_old_readings_are_refused():
    gate, passed = ask(ready(applied=Twist(0.3, 0.0)), 0.2, stamp=10.0 - 0.1001)
    assert passed == Passed(Twist(0.3, 0.0), "its readings are too old")
    assert (gate.refused, gate.last_proposal, gate.sequence) == (1, 9.98, 7)
    assert ask(ready(), 0.02, stamp=10.0 - 0.0999)[1].reason == ""


def test_a_refused_proposal_does_not_move_a_robot_at_rest():
    gate, passed = ask(ready(applied=Twist(0.3, 0.0), mode=GateMode.IDLE), 0.2, n=3)
    assert passed.applied.v == pytest.approx(0.24)
    assert gate.refused == 1


@pytest.mark.parametrize(
    ("proposal", "said"),
    [
        (Proposal(8, 10.0, Twist(NAN, 0.0)), "the loop commanded a speed that is not a number"),
        (Proposal(8, 10.0, Twist(0.0, NAN)), "the loop commanded a speed that is not a number"),
        (Proposal(8, 10.0, Twist(INF, 0.0)), "the loop commanded a speed that is not a number"),
        (Proposal(8, 10.0, Twist(0.0, -INF)), "the loop commanded a speed that is not a number"),
        (Proposal(8, NAN, Twist(0.1, 0.0)), "the readings' time is not a number"),
        (Proposal(8, -INF, Twist(0.1, 0.0)), "the readings' time is not a number"),
        (
            Proposal(8, 10.0101, Twist(0.1, 0.0)),
            "the readings come from the future: a clock jumped",
        ),
    ],
)
def test_a_broken_sensor_is_a_fault_at_once(proposal, said):
    gate, passed = g.propose(ready(applied=Twist(0.3, 0.0)), proposal, 10.0, RULES)
    assert gate.mode == GateMode.FAULTED
    assert gate.reason == passed.reason == said
    assert passed.applied == pytest.approx((0.24, 0.0))  # braking has begun
    assert (gate.refused, gate.last_proposal) == (1, 9.98)


def test_a_little_ahead_is_the_clocks_jitter():
    assert ask(ready(), 0.02, stamp=10.0099)[1].reason == ""


@pytest.mark.parametrize("mode", [GateMode.AUTOMATIC, GateMode.SHARED])
def test_silence_trips_the_watchdog(mode):
    gate = ready(applied=Twist(0.3, 0.0), mode=mode)
    assert g.due(gate, RULES) == pytest.approx(10.08)
    early, passed = g.tick(gate, 10.0799, RULES)
    assert early.mode == mode
    assert passed == Passed(Twist(0.3, 0.0), "")
    late, passed = g.tick(early, 10.0801, RULES)
    assert late.mode == GateMode.FAULTED
    assert passed.reason == late.reason == "no valid command for more than 100 ms"
    assert passed.applied.v == pytest.approx(0.24)


def test_refused_proposals_are_silence():
    gate, now = ready(), 10.0
    while now < 10.095:
        gate, _ = ask(gate, 0.1, now=now, n=7)
        now += 0.01
    assert gate.mode == GateMode.FAULTED


def test_a_late_proposal_does_not_hide_that_it_is_late():
    gate, passed = ask(ready(), 0.1, now=10.1)
    assert gate.mode == GateMode.FAULTED
    assert passed.applied == STANDING


@pytest.mark.parametrize("mode", [GateMode.IDLE, GateMode.STOPPED, GateMode.FAULTED])
def test_an_idle_robot_needs_no_watchdog(mode):
    gate = ready(mode=mode)
    assert g.due(gate, RULES) == INF
    assert g.tick(gate, 99.0, RULES)[0].mode == mode


def test_a_clock_that_goes_back_is_a_fault_and_the_new_time_counts():
    gate = ready(applied=Twist(0.3, 0.0))
    gate, passed = g.tick(gate, 9.5, RULES)
    assert (gate.mode, gate.reason) == (GateMode.FAULTED, "the robot's clock went back")
    assert passed.applied.v == pytest.approx(0.24)
    assert gate.asked == -INF  # there was no proposal yet in the new time
    for k in range(1, 20):
        gate, passed = g.propose(
            gate, Proposal(8 + k, 9.5 + 0.02 * k, Twist(0.3, 0.0)), 9.5 + 0.02 * k, RULES
        )
    assert passed.applied == STANDING
    assert g.reset(gate, 9.89, RULES)[1] == ""


def test_after_the_clock_went_back_the_loop_must_show_that_it_lives():
    gate, _ = g.tick(ready(), 9.5, RULES)
    assert g.reset(gate, 9.5, RULES)[1] == "the loop sends no valid command"


def test_every_limit_in_time_is_still_allowed():
    """With numbers that binary fractions hold exactly."""
    rules = RULES._replace(age=0.125, ahead=0.0625, watchdog=2.0)
    gate = ready()._replace(last_proposal=8.0)
    assert g.tick(gate, 10.0, rules)[0].mode == GateMode.AUTOMATIC
    late, _ = g.tick(gate, 10.25, rules)
    assert late.reason == "no valid command for more than 2000 ms"
    for stamp in (10.0 - 0.125, 10.0 + 0.0625):
        _, passed = g.propose(gate, Proposal(8, stamp, Twist(0.02, 0.0)), 10.0, rules)
        assert passed.reason == ""
    idle = gate._replace(mode=GateMode.IDLE)
    assert g.drive(idle, GateMode.SHARED, 10.0, rules)[1] == ""


def test_the_same_time_twice_is_no_step_back():
    gate, _ = g.tick(ready(), 10.0, RULES)
    assert g.tick(gate, 10.0, RULES)[0].mode == GateMode.AUTOMATIC


@pytest.mark.parametrize("now", [NAN, INF, -INF])
def test_a_clock_that_is_no_number_stops_at_once(now):
    gate, passed = g.tick(ready(applied=Twist(0.3, 0.0)), now, RULES)
    assert passed == Passed(STANDING, "the robot's clock is not a number")
    assert gate.mode == GateMode.FAULTED
    assert gate.applied == STANDING
    assert gate.clock == 9.98


SLOW = (
    "commands come too seldom, and not every 20 ms: a call of the robot's driver waits, or this "
    "computer is too slow"
)


def paced(gate: Gate, *apart: float) -> Gate:
    """Sound proposals that come so far apart [s]."""
    for after in apart:
        gate, _ = ask(gate, 0.02, now=gate.clock + after, n=gate.sequence + 1)
    return gate


@pytest.mark.parametrize("apart", [0.04, 0.06, 0.09])
def test_a_loop_that_is_always_late_is_a_fault_though_the_watchdog_never_trips(apart):
    """What was certified holds for a period: at 50 ms instead of 20 a driven cart hit the wall."""
    gate, times = ready(), 0
    while gate.mode == GateMode.AUTOMATIC:
        gate, times = paced(gate, apart), times + 1
    assert (gate.mode, gate.reason) == (GateMode.FAULTED, SLOW)
    assert times == math.floor(0.1 / (apart - 0.03) + 1e-9) + 1


def test_a_slow_loop_is_told_its_period_in_milliseconds():
    slow = ready(mode=GateMode.IDLE)._replace(behind=1.0)
    said = g.drive(slow, GateMode.SHARED, slow.clock, RULES._replace(period=0.75))[1]
    assert said == SLOW.replace("20 ms", "750 ms")


def test_who_knows_why_the_loop_is_slow_has_it_said():
    late, said = ready()._replace(behind=1.0, asked=9.98), SLOW.partition(":")[0] + ": read waits"
    proposal, rules = Proposal(8, 10.0, STANDING), RULES._replace(slow="read waits")
    assert g.propose(late, proposal, 10.0, rules)[0].reason == said
    idle = late._replace(mode=GateMode.IDLE)
    assert g.drive(idle, GateMode.SHARED, 9.98, rules)[1] == said
    stopped = late._replace(mode=GateMode.STOPPED)
    assert g.reset(stopped, 9.98, rules)[1] == said


def test_a_loop_that_is_late_now_and_then_is_not():
    gate = ready()
    for _ in range(100):
        gate = paced(gate, 0.02, 0.02, 0.04)  # two periods of three in time
    assert gate.mode == GateMode.AUTOMATIC
    for _ in range(100):
        gate = paced(gate, *12 * [0.02], 0.09)
    assert gate.mode == GateMode.AUTOMATIC
    assert paced(gate, *6 * [0.02], 0.09, 0.06).mode == GateMode.AUTOMATIC
    assert paced(gate, *6 * [0.02], 0.09, 0.09).reason == SLOW


def test_a_loop_may_be_late_by_the_watchdogs_time_in_all():
    """With numbers that binary fractions hold exactly."""
    rules = RULES._replace(watchdog=0.125, period=0.03125)
    gate = ready()._replace(asked=9.0, clock=9.0, last_proposal=9.0, change_until=9.0)
    for now in (9.125, 9.171875, 9.21875):  # by a period and a half more, then in time
        gate, _ = g.propose(gate, Proposal(gate.sequence + 1, now, STANDING), now, rules)
    assert gate.behind == 0.078125
    gate, _ = g.propose(gate, Proposal(99, 9.3125, STANDING), 9.3125, rules)
    assert (gate.behind, gate.mode) == (0.125, GateMode.AUTOMATIC)


def test_a_slow_loop_neither_resets_nor_drives_until_it_has_caught_up():
    slow = paced(ready(mode=GateMode.IDLE), *100 * [0.06])
    assert slow.behind == 0.2
    for mode in (GateMode.AUTOMATIC, GateMode.SHARED):
        assert g.drive(slow, mode, slow.clock, RULES) == (slow, SLOW)
    stopped = g.stop(slow, "why")
    assert g.reset(stopped, stopped.clock, RULES) == (stopped, SLOW)
    assert g.drive(slow, GateMode.IDLE, slow.clock, RULES) == (slow, "")
    better = paced(slow, *9 * [0.02])
    assert g.drive(better, GateMode.SHARED, better.clock, RULES)[1] == SLOW
    better = paced(better, 0.021)
    assert g.drive(better, GateMode.SHARED, better.clock, RULES)[1] == SLOW
    better = paced(better, 0.02)
    assert g.drive(better, GateMode.SHARED, better.clock, RULES)[0].mode == GateMode.SHARED


def test_after_silence_a_loop_need_not_catch_up():
    slow = paced(ready(mode=GateMode.IDLE), *100 * [0.06])
    awake = paced(slow, 0.1001)
    assert awake.behind == 0.0
    assert g.drive(awake, GateMode.SHARED, awake.clock, RULES)[1] == ""


def test_refused_proposals_are_no_slow_loop():
    """Old readings are the watchdog's, which says so."""
    gate, now = ready(), 10.0
    while gate.mode == GateMode.AUTOMATIC:
        gate, _ = ask(gate, 0.1, now=now, stamp=now - 0.2)
        now += 0.02
    assert gate.behind == 0.0
    assert gate.reason == "no valid command for more than 100 ms"


def test_a_clock_that_went_back_begins_to_count_anew():
    slow = paced(ready(mode=GateMode.IDLE), *100 * [0.06])
    back, _ = ask(slow, 0.0, now=5.0, n=200)
    assert (back.asked, back.behind) == (5.0, 0.0)
    for now in (NAN, INF, -INF):
        broken, _ = ask(slow, 0.0, now=now, n=200)
        assert (broken.asked, broken.behind) == (slow.asked, slow.behind)


# -- stop, fault, reset, drive -------------------------------------------------------------------


@pytest.mark.parametrize("mode", [GateMode.IDLE, GateMode.AUTOMATIC, GateMode.SHARED])
def test_stop_and_fault_latch_with_their_reason(mode):
    stopped = g.stop(ready(mode=mode), "the person pressed STOP")
    assert (stopped.mode, stopped.reason) == (GateMode.STOPPED, "the person pressed STOP")
    faulted = g.fault(ready(mode=mode), "bumper")
    assert (faulted.mode, faulted.reason) == (GateMode.FAULTED, "bumper")


def test_the_first_reason_stays():
    stopped = g.stop(g.stop(ready(), "first"), "second")
    assert stopped.reason == "first"
    faulted = g.fault(g.fault(ready(), "first"), "second")
    assert faulted.reason == "first"
    assert g.stop(faulted, "third") == faulted


def test_a_fault_while_stopped_keeps_both_reasons():
    both = g.fault(g.stop(ready(), "STOP"), "bumper")
    assert (both.mode, both.reason) == (GateMode.FAULTED, "bumper (and stopped: STOP)")


@pytest.mark.parametrize("latch", [g.stop, g.fault])
def test_only_a_reset_leads_out_and_it_moves_nothing(latch):
    gate = latch(ready(), "why")
    for n in range(8, 40):
        gate, passed = ask(gate, 0.5, now=10.0 + 0.02 * (n - 8), n=n)
        assert passed.applied == STANDING
    assert g.drive(gate, GateMode.AUTOMATIC, 10.62, RULES) == (gate, "reset first: why")
    gate, said = g.reset(gate, 10.62, RULES)
    assert (gate.mode, gate.reason, said) == (GateMode.IDLE, "", "")
    gate, passed = ask(gate, 0.5, now=10.64, n=40)
    assert passed.applied == STANDING  # still nobody has chosen to drive
    gate, said = g.drive(gate, GateMode.SHARED, 10.64, RULES)
    assert (gate.mode, said) == (GateMode.SHARED, "")
    assert ask(gate, 0.5, now=10.66, n=41)[1].applied.v > 0.0


def test_no_reset_where_there_is_nothing_to_reset():
    for mode in (GateMode.IDLE, GateMode.AUTOMATIC, GateMode.SHARED):
        gate = ready(mode=mode)
        assert g.reset(gate, 10.0, RULES) == (gate, "there is nothing to reset")


@pytest.mark.parametrize("out", [Twist(0.01, 0.0), Twist(0.0, 0.01)])
def test_no_reset_while_the_wheels_still_turn(out):
    gate = g.stop(ready(applied=out), "why")
    assert g.reset(gate, 10.0, RULES) == (gate, "the robot is still braking")


def test_no_reset_and_no_driving_without_a_living_loop():
    stopped = g.stop(ready(), "why")
    assert g.reset(stopped, 10.0801, RULES) == (stopped, "the loop sends no valid command")
    assert g.reset(stopped, 10.0799, RULES)[1] == ""
    idle = ready(mode=GateMode.IDLE)
    for mode in (GateMode.AUTOMATIC, GateMode.SHARED):
        assert g.drive(idle, mode, 10.0801, RULES) == (idle, "the loop sends no valid command")
        assert g.drive(idle, mode, 10.0799, RULES)[0].mode == mode
    assert g.drive(idle, GateMode.IDLE, 99.0, RULES) == (idle, "")


def test_the_modes_one_can_choose():
    gate = ready(mode=GateMode.AUTOMATIC)
    for mode in (GateMode.SHARED, GateMode.AUTOMATIC, GateMode.IDLE):
        assert g.drive(gate, mode, 10.0, RULES)[0].mode == mode
    for mode in (GateMode.STOPPED, GateMode.FAULTED):
        assert g.drive(gate, mode, 10.0, RULES) == (gate, "stop and fault can not be chosen")


def test_which_modes_drive_and_which_are_latched():
    assert [m for m in GateMode if driving(m)] == [GateMode.AUTOMATIC, GateMode.SHARED]
    assert [m for m in GateMode if latched(m)] == [GateMode.STOPPED, GateMode.FAULTED]


def test_a_new_gate_is_idle():
    assert Gate() == Gate(GateMode.IDLE, "", STANDING, -INF, -INF, -1, -INF, 0, -INF, 0.0)
    assert RULES[1:-1] == (0.1, 0.01, 0.1, 0.02, 0.01)
