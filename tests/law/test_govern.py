"""The reference's own clock (E12): it waits, it slows, it never jumps."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from cohelm.core.scalars import wrap
from cohelm.core.types import Pose, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import (
    CourseClock,
    PaceParams,
    allowed,
    attainable,
    govern,
    governed,
    nearest_ahead,
    profile,
    reversed_twist,
    turned,
)
from cohelm.law.reference import desired, evaluate, through
from cohelm.law.track import track
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, ramps, speeds

DT = 0.02
PACE = PaceParams()
GAINS = Gains(k_x=1.0, k_psi=3.0)
BENDS = through([[0, 0], [2, 0], [3, 1.5], [5, 1], [6, 3]], 1.0)
STRAIGHT = through([[0, 0], [10, 0]], 1.0)
HAND = Twist(0.4, 0.8)
OPEN = np.full(400, math.inf)


def at(reference, t):
    return evaluate(reference.knots, reference.coeffs, t)


def paced(reference, clearance=OPEN, pace=PACE):
    return profile(reference, clearance, pace)


def follow(reference, pose, seconds, clock=None, held=(), leads=(), hand=HAND):
    """The closed loop; from held[0] to held[1] the wheels are blocked, and likewise `leads`."""
    clock = CourseClock() if clock is None else clock
    profiled = paced(reference)
    history = []
    for k in range(round(seconds / DT)):
        t = k * DT
        led = bool(leads) and leads[0] <= t < leads[1]
        clock = govern(clock, pose, reference, profiled, led, PACE, DT)
        nominal = track(pose, governed(reference, clock, pose, PACE), GAINS)
        if led:
            nominal = hand
        if not (held and held[0] <= t < held[1]):
            pose = arc(pose, nominal, DT)
        history.append((clock, pose, nominal))
    return history


poses = st.builds(Pose, st.floats(-3, 9), st.floats(-3, 6), st.floats(-10, 10))
clocks = st.builds(CourseClock, st.floats(0.0, 9.0), st.floats(0.0, 1.0), st.just(0.0))


@given(poses, clocks, st.booleans())
def test_the_rate_stays_between_0_and_1_and_never_jumps(pose, clock, leads):
    after = govern(clock, pose, BENDS, paced(BENDS), leads, PACE, DT)
    assert 0.0 <= after.rate <= 1.0
    assert -PACE.fall * DT - 1e-12 <= after.rate - clock.rate <= PACE.rise * DT + 1e-12


@given(poses, clocks, st.booleans())
def test_the_reference_never_goes_back_nor_past_its_end(pose, clock, leads):
    after = govern(clock, pose, BENDS, paced(BENDS), leads, PACE, DT)
    start = min(clock.tau, BENDS.duration)
    assert start <= after.tau <= BENDS.duration
    if not leads:
        assert after.tau - start <= DT + 1e-12


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["x", "y", "psi"])
def test_the_reference_waits_for_a_pose_that_is_not_finite(bad, field):
    pose = Pose(1.0, 0.0, 0.0)._replace(**{field: bad})
    clock = CourseClock(1.0, 0.0)
    assert govern(clock, pose, STRAIGHT, paced(STRAIGHT), False, PACE, DT)[:2] == (1.0, 0.0)
    assert govern(clock, pose, STRAIGHT, paced(STRAIGHT), True, PACE, DT)[:2] == (1.0, 0.0)


def test_the_reference_waits_while_the_robot_is_held_up():
    history = follow(BENDS, Pose(0.0, 0.0, 0.0), 32.0, held=(2.0, 22.0))
    before, after = history[round(4.0 / DT)][0], history[round(21.9 / DT)][0]
    pose = history[round(21.9 / DT)][1]
    point = at(BENDS, after.tau)
    assert math.hypot(point.x - pose.x, point.y - pose.y) <= PACE.lag + 0.05
    assert after.tau == pytest.approx(before.tau, abs=0.1)
    assert after.waited > 15.0


def test_the_reference_resumes_without_a_jump_and_arrives():
    history = follow(BENDS, Pose(0.0, 0.0, 0.0), 35.0, held=(2.0, 12.0))
    wishes = np.array([nominal for _, _, nominal in history])
    free = wishes[round(12.0 / DT) :]
    assert np.abs(np.diff(free[:, 0])).max() < (PACE.rise + PACE.fall) * DT
    clock, pose, _ = history[-1]
    assert clock.tau == BENDS.duration
    assert clock.waited == 0.0
    assert math.hypot(pose.x - 6.0, pose.y - 3.0) < 0.05


def test_an_ungoverned_reference_runs_away_from_a_robot_that_is_held_up():
    """E12, the reason for this module; the governed one is at most `lag` ahead."""
    held = Pose(2.0, 0.0, 0.0)
    assert desired(STRAIGHT, 8.0, False).x - held.x > 5.0
    clock = follow(STRAIGHT, Pose(0.0, 0.0, 0.0), 10.0, held=(2.0, 10.0))[-1][0]
    pose = follow(STRAIGHT, Pose(0.0, 0.0, 0.0), 2.0)[-1][1]
    assert at(STRAIGHT, clock.tau).x - pose.x <= PACE.lag + 1e-9


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.0, 2.0), st.floats(-1.5, 1.5), st.floats(-3.14, 3.14))
@example(0.0, 1.0, 0.0)  # beside the path
@example(0.0, -1.0, math.pi)
@example(2.0, 0.0, math.pi)  # ahead, looking back
@example(0.0, 0.0, math.pi)
def test_a_robot_beside_ahead_or_turned_away_comes_back_and_arrives(x, y, psi):
    clock, pose, _ = follow(STRAIGHT, Pose(x, y, psi), 40.0)[-1]
    assert clock.tau == STRAIGHT.duration
    assert math.hypot(pose.x - 10.0, pose.y) < 0.1


@given(st.floats(0.2, 2.0), st.integers(20, 300), st.floats(0.3, 3.0), st.floats(0.3, 3.0))
def test_curvature_limits_the_speed(speed, n, lateral, yaw_rate):
    pace = PACE._replace(lateral=lateral, yaw_rate=yaw_rate)
    path = through([[0, 0], [1, 0], [1.3, 0.6], [2, 1], [3, 1]], speed)
    rates = paced(path, np.full(n, math.inf), pace)
    assert rates.rate[-1] == 0.0
    for i, rate in enumerate(rates.rate[:-1]):
        m = at(path, path.duration * i / (n - 1))
        v = rate * math.hypot(m.vx, m.vy)
        r = rate * (m.vx * m.ay - m.vy * m.ax) / (m.vx**2 + m.vy**2)
        assert 0.0 < rate <= 1.0
        assert abs(v * r) <= lateral * (1 + 1e-9)
        assert abs(r) <= yaw_rate * (1 + 1e-9)


LIMITS = st.builds(
    Limits, st.just(3.0), st.floats(0.2, 5.0), st.floats(0.3, 5.0), st.just(3.0),
    st.floats(0.5, 5.0), st.floats(0.2, 5.0), st.floats(0.1, 1.0),
)  # fmt: skip


@given(LIMITS, st.floats(0.2, 2.0))
def test_the_reference_asks_for_no_more_than_three_quarters_of_what_the_robot_can(limits, speed):
    reference = through([[0, 0], [2, 0], [3, 1.5], [5, 1], [6, 3]], speed)
    pace = attainable(PACE, limits, speed)
    acceleration, yaw_rate = 0.75 * ramps(limits)[0], 0.75 * speeds(limits)[1]
    rates = paced(reference, np.full(80, math.inf), pace).rate
    at_samples = [at(reference, t) for t in np.linspace(0.0, reference.duration, len(rates))]
    v = [r * math.hypot(m.vx, m.vy) for r, m in zip(rates, at_samples, strict=True)]
    for vi, m in zip(v, at_samples, strict=True):
        curvature = (m.vx * m.ay - m.vy * m.ax) / math.hypot(m.vx, m.vy) ** 3
        assert abs(curvature) * vi <= yaw_rate + 1e-9
    for (before, a), (after, b) in itertools.pairwise(zip(v, at_samples, strict=True)):
        braking = before * before - after * after
        assert braking <= 2.0 * acceleration * math.hypot(b.x - a.x, b.y - a.y) + 1e-9
    clock = govern(CourseClock(), Pose(0, 0, 0), reference, paced(reference), False, pace, DT)
    assert clock.rate * speed <= acceleration * DT + 1e-9


def test_a_robot_that_can_more_is_given_what_was_set():
    sound = Limits(2.0, 20.0, 4.0, 25.0)
    assert attainable(PACE, sound, 1.0) == PACE


def test_clearance_limits_the_speed_and_the_reference_slows_ahead_of_it():
    clearance = np.full(400, 1.0)
    clearance[200:220] = PACE.tight
    rates = paced(STRAIGHT, clearance).rate
    spacing = 10.0 / 399
    assert rates[200:220] == pytest.approx(PACE.creep)
    assert rates[100] == 1.0
    assert rates[220:350].min() > 0.9
    slowing = rates[:-1] ** 2 - rates[1:] ** 2
    assert slowing.max() <= 2.0 * PACE.deceleration * spacing * (1 + 1e-9)


@pytest.mark.parametrize(
    ("clearance", "speed"),
    [
        (-1.0, PACE.creep), (PACE.tight, PACE.creep), (math.nan, PACE.creep),
        (0.5 * (PACE.tight + PACE.open), 0.5 * (1.0 + PACE.creep)), (PACE.open, 1.0), (9.0, 1.0),
    ],
)  # fmt: skip
def test_the_speed_grows_linearly_with_clearance(clearance, speed):
    rates = paced(STRAIGHT, np.full(400, clearance))
    assert allowed(rates, 5.0) == pytest.approx(speed)


def test_a_nominal_speed_below_creep_is_kept():
    slow = through([[0, 0], [10, 0]], 0.1)
    assert paced(slow, np.zeros(50)).rate[:-1] == pytest.approx(1.0)


def test_the_rate_between_two_samples_is_between_theirs():
    rates = paced(BENDS)
    for t in np.linspace(0.0, BENDS.duration - 1e-9, 997):
        i = min(int(t / BENDS.duration * 399), 398)
        low, high = sorted(rates.rate[i : i + 2])
        assert low - 1e-12 <= allowed(rates, t) <= high + 1e-12
    assert allowed(rates, BENDS.duration) == 0.0
    assert allowed(rates, math.nan) == 0.0


@given(st.floats(0.0, 0.999), st.floats(0.0, 1.0))
def test_on_the_path_the_demand_is_the_references_own_times_the_rate(share, rate):
    tau = share * BENDS.duration
    d = desired(BENDS, tau, True)
    ours = governed(BENDS, CourseClock(tau, rate), Pose(d.x, d.y, 0.3), PACE)
    assert ours == pytest.approx((d.x, d.y, d.psi, rate * d.u, rate * d.r), abs=1e-9)


@given(st.floats(-2.0, 2.0))
def test_beside_the_path_the_robot_is_turned_towards_it(beside):
    d = governed(STRAIGHT, CourseClock(5.0, 1.0), Pose(5.0, beside, 0.0), PACE)
    assert d.psi == pytest.approx(-math.atan(beside / PACE.guide))
    backwards = governed(STRAIGHT, CourseClock(5.0, 1.0), Pose(5.0, beside, math.pi), PACE)
    assert abs(backwards.psi - math.pi) == pytest.approx(0.5 * math.pi)


def test_while_the_person_leads_the_reference_waits_at_the_nearest_point_ahead():
    history = follow(STRAIGHT, Pose(0.0, 0.0, 0.0), 4.0, leads=(1.0, 4.0))
    for (clock, _, _), (_, pose, _) in zip(history[51:], history[50:], strict=False):
        nearest = max(pose.x, clock.tau - 1e-3)  # on this path tau is x
        assert clock.tau == pytest.approx(nearest, abs=0.03)
    assert history[-1][0].waited == 0.0


@pytest.mark.parametrize("speed", [0.0, 0.3, 0.6])
def test_when_the_person_lets_go_the_reference_goes_on_at_the_speed_it_finds(speed):
    hand = Twist(speed, 0.0)
    history = follow(STRAIGHT, Pose(0.0, 0.0, 0.0), 4.0, leads=(1.0, 3.0), hand=hand)
    assert history[round(3.0 / DT)][2].v == pytest.approx(speed, abs=0.1)


@pytest.mark.parametrize("rate", [0.0, 0.4])
@pytest.mark.parametrize("x", [1.0, 1.3])
def test_a_step_of_no_time_leaves_the_rate_of_a_robot_that_a_person_leads(rate, x):
    before = CourseClock(1.0, rate, 0.0)
    after = govern(before, Pose(x, 0.0, 0.0), STRAIGHT, paced(STRAIGHT), True, PACE, 0.0)
    assert after.rate == rate
    assert after.tau >= 1.0


def test_when_the_person_lets_go_off_the_path_the_reference_takes_over_smoothly():
    history = follow(BENDS, Pose(0.0, 0.0, 0.0), 40.0, leads=(1.0, 2.5))
    first = round(2.5 / DT)
    assert abs(history[first][2].v) < 0.4
    speeds = np.array([nominal.v for _, _, nominal in history[first:]])
    assert np.abs(np.diff(speeds)).max() < 0.15
    assert history[-1][0].tau == BENDS.duration


@given(st.floats(0.0, 5.0), poses)
def test_the_nearest_point_ahead_is_the_nearest_of_a_fine_search(tau, pose):
    found = nearest_ahead(BENDS, pose, tau, 2.0)
    times = np.linspace(tau, min(tau + 2.0, BENDS.duration), 4001)
    distances = [math.hypot(at(BENDS, t).x - pose.x, at(BENDS, t).y - pose.y) for t in times]
    m = at(BENDS, found)
    assert tau <= found <= BENDS.duration
    assert math.hypot(m.x - pose.x, m.y - pose.y) <= min(distances) + 1e-3


@given(poses, st.floats(-1, 1), st.floats(-1, 1))
def test_driving_the_other_way_round_is_the_same_motion(pose, v, omega):
    there = arc(turned(pose), Twist(v, omega), 0.3)
    same = arc(pose, reversed_twist(Twist(v, omega)), 0.3)
    assert (same.x, same.y) == pytest.approx((there.x, there.y), abs=1e-9)
    assert wrap(turned(same).psi - there.psi) == pytest.approx(0.0, abs=1e-9)
