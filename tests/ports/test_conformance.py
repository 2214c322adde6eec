"""The promises of `robot.port.Robot`, held by every adapter in `adapters.py`.

Adapters in real time share a machine with other work: what is a question of time is asked of
them with slack, and by the stamps of their own readings.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.robot.port import Odometry, RobotPort
from tests.few import first
from tests.ports.adapters import ADAPTERS, Adapter

SLACK = 1.0  # a busy machine may be so late [s]
LATE = 0.3  # between two commands, with room for the 0.5 s after which a robot stops by itself [s]
STILL = 1e-3  # as fast as a standing robot may seem, gyro apart [m/s]


def marks(name: str) -> list[pytest.MarkDecorator]:
    """In real time the twin stands for all; `make test-all` takes the others too. What the base
    class does in real time only, tests/api/test_robot.py has by default."""
    real = [pytest.mark.xdist_group("realtime")] if ADAPTERS[name].real_time else []
    return [*real, *([pytest.mark.slow] if real and name != "twin, real time" else [])]


@pytest.fixture(params=[pytest.param(a, id=n, marks=marks(n)) for n, a in ADAPTERS.items()])
def adapter(request):
    return request.param


on_any_clock = pytest.mark.parametrize(
    "adapter",
    [
        pytest.param(a, id=n, marks=pytest.mark.slow if a.real_time else ())
        for n, a in ADAPTERS.items()
    ],
    indirect=True,
)
"""What time has no part in: by default only where it is simulated."""


@pytest.fixture
def robot(adapter: Adapter):
    made = adapter.make()
    yield made
    made.close()


@pytest.fixture
def _obeys(adapter: Adapter) -> None:
    if not adapter.obeys:
        pytest.skip("it moves as it did")


moves_as_told = pytest.mark.usefixtures("_obeys")  # before a robot is made


def drive(robot: RobotPort, twist: Twist, seconds: float) -> list[Odometry]:
    """Ask for a twist at 50 Hz; every new odometry reading meanwhile. From the beginning where
    nothing was asked for a while on a busy machine: whoever drives has rightly stopped then."""
    seen: list[Odometry] = []
    last = robot.now()
    end = last + seconds
    while last < end:
        robot.send(twist)
        robot.wait(robot.now() + 0.02)
        odometry = robot.read().odometry
        if odometry is not None and (not seen or odometry.stamp > seen[-1].stamp):
            seen.append(odometry)
        now = robot.now()
        if now - last > LATE:
            seen.clear()
            end = now + seconds
        last = now
    return seen


def braking(robot: RobotPort) -> float:
    """How long Sally may take to stand from full speed, with everything between [s]."""
    bounds = robot.model.bounds()
    return robot.model.delay_s + bounds.wheel_speed / bounds.wheel_acceleration + 0.15


def test_waiting_returns_at_its_time_and_not_before(adapter, robot):
    for step in (0.001, 0.02, 0.05, 0.1):
        until = robot.now() + step
        robot.wait(until)
        late = robot.now() - until
        assert 0.0 <= late + 1e-9
        assert late <= (SLACK if adapter.real_time else 0.005)


def test_waiting_for_the_past_returns_at_once(adapter, robot):
    robot.wait(0.1)
    before = robot.now()
    robot.wait(before - 0.05)
    assert 0.0 <= robot.now() - before <= (SLACK if adapter.real_time else 0.0)


def test_the_clock_never_goes_back(robot):
    last = robot.now()
    for _ in range(100):
        robot.wait(robot.now() + 0.001)
        robot.read()
        assert robot.now() >= last
        last = robot.now()


@on_any_clock
def test_odometry_comes_at_its_rate_stamped_and_in_order(adapter, robot):
    seen = drive(robot, Twist(0.0, 0.0), 1.0)
    stamps = np.array([o.stamp for o in seen])
    assert (np.diff(stamps) > 0.0).all()
    assert stamps[-1] <= robot.now()
    if not adapter.real_time:
        assert len(seen) >= 0.9 * min(robot.model.odometry.rate_hz, 50.0)
    assert robot.now() - stamps[-1] <= 2.0 / robot.model.odometry.rate_hz + (
        SLACK if adapter.real_time else 0.0
    )


@on_any_clock
def test_every_number_of_the_odometry_is_finite(robot):
    for o in drive(robot, Twist(0.2, 0.3), 0.5):
        assert all(math.isfinite(value) for value in (o.stamp, *o.pose, *o.twist))


@on_any_clock
def test_scans_are_as_the_model_describes_them(robot):
    lidar = robot.model.lidar
    if lidar is None:
        pytest.skip("this robot has no LiDAR")
    seen = {}
    for _ in range(40):
        robot.send(Twist(0.1, 0.2))
        robot.wait(robot.now() + 0.02)
        scan = robot.read().scan
        if scan is not None:
            seen[scan.number] = scan
            assert scan.stamp + scan.duration <= robot.now() + 1e-9
    assert seen
    numbers = sorted(seen)
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert all(seen[a].stamp < seen[b].stamp for a, b in pairwise(numbers))
    for scan in seen.values():
        assert scan.ranges.shape == (lidar.beams,)
        assert not np.isnan(scan.ranges).any()
        measured = scan.ranges[np.isfinite(scan.ranges)]
        assert (measured >= lidar.range_min_m).all()
        assert (measured <= lidar.range_max_m).all()
        assert len(measured) > 0


def test_reading_twice_gives_the_same(robot):
    robot.wait(robot.now() + 0.3)
    first, again = robot.read(), robot.read()
    if robot.now() < 0.3 + 1e-6:  # time stood still in between
        assert again.odometry == first.odometry
        assert again.scan is first.scan
    else:
        assert first.odometry is not None
        assert again.odometry is not None
        assert again.odometry.stamp >= first.odometry.stamp


def test_a_healthy_robot_reports_no_fault(robot):
    robot.wait(robot.now() + 0.1)
    health = robot.read().health
    assert health is not None
    assert health.stamp <= robot.now()
    assert health.faults == ()
    assert math.isnan(health.battery) or 0.0 <= health.battery <= 1.0


@on_any_clock
@moves_as_told
def test_it_stands_until_it_is_told_to_move(robot):
    robot.wait(robot.now() + 0.5)
    odometry = robot.read().odometry
    assert odometry is not None
    assert abs(odometry.twist.v) <= STILL


@moves_as_told
def test_sending_answers_with_what_it_will_try(robot):
    assert robot.send(Twist(0.3, -0.4)) == pytest.approx(Twist(0.3, -0.4), abs=1e-12)
    bounds = robot.model.bounds()
    for wild in (Twist(50.0, 0.0), Twist(-50.0, 3.0), Twist(0.0, 90.0), Twist(1e300, -1e300)):
        tried = robot.send(wild)
        assert abs(tried.v) <= bounds.speed
        assert abs(tried.omega) <= bounds.yaw_rate
        assert abs(tried.v) + 0.5 * bounds.track * abs(tried.omega) <= bounds.wheel_speed + 1e-9


@pytest.mark.parametrize(
    "broken",
    first(
        [
            Twist(math.nan, 0.0),
            Twist(0.0, math.nan),
            Twist(math.inf, 0.0),
            Twist(0.0, -math.inf),
        ]
    ),
)
@moves_as_told
def test_a_twist_that_is_no_number_stops_it(robot, broken):
    drive(robot, Twist(0.4, 0.0), 0.6)
    assert robot.send(broken) == Twist(0.0, 0.0)
    seen = drive(robot, broken, braking(robot) + 0.1)
    assert abs(seen[-1].twist.v) <= STILL


@pytest.mark.parametrize("asked", first([Twist(0.2, 0.5), Twist(0.4, 0.0), Twist(-0.3, 0.0)]))
@on_any_clock
@moves_as_told
def test_it_moves_as_commanded(robot, asked):
    drive(robot, asked, 1.0)
    seen = drive(robot, asked, 1.5)
    v = np.mean([o.twist.v for o in seen])
    omega = np.mean([o.twist.omega for o in seen])
    assert v == pytest.approx(asked.v, rel=0.05, abs=0.01)
    assert omega == pytest.approx(asked.omega, rel=0.05, abs=0.02)
    start, end = seen[0], seen[-1]
    dt = end.stamp - start.stamp
    assert end.pose.psi - start.pose.psi == pytest.approx(asked.omega * dt, abs=0.05)
    chord = math.hypot(end.pose.x - start.pose.x, end.pose.y - start.pose.y)
    half = 0.5 * asked.omega * dt
    want = abs(asked.v) * dt * (math.sin(half) / half if half else 1.0)
    assert chord == pytest.approx(want, rel=0.06, abs=0.02)


@on_any_clock
@moves_as_told
def test_its_wheels_gather_speed_no_faster_than_they_can(robot):
    bounds = robot.model.bounds()
    seen = drive(robot, Twist(bounds.speed, 0.0), 0.8)
    for a in seen:
        for b in seen:
            if (
                0.18 <= b.stamp - a.stamp <= 0.22
            ):  # long enough for the odometer's noise not to tell
                gained = abs(b.twist.v - a.twist.v)
                assert gained <= bounds.wheel_acceleration * (b.stamp - a.stamp) + 0.15


@moves_as_told
def test_stop_brakes_to_standing_and_again_does_no_harm(robot):
    robot.stop()
    drive(robot, Twist(0.6, 0.2), 0.8)
    robot.stop()
    robot.stop()
    robot.wait(robot.now() + braking(robot))
    robot.stop()
    robot.wait(robot.now() + 0.1)
    first = robot.read().odometry
    robot.wait(robot.now() + 0.2)
    again = robot.read().odometry
    assert first is not None
    assert again is not None
    assert abs(again.twist.v) <= STILL
    assert math.hypot(again.pose.x - first.pose.x, again.pose.y - first.pose.y) <= STILL


@moves_as_told
def test_stop_called_again_and_again_is_no_slower(robot):
    drive(robot, Twist(0.6, 0.2), 0.8)
    end = robot.now() + braking(robot)
    while robot.now() < end:
        robot.stop()
        robot.wait(robot.now() + 0.01)
    odometry = robot.read().odometry
    assert odometry is not None
    assert abs(odometry.twist.v) <= STILL


@moves_as_told
def test_it_stops_by_itself_when_nothing_is_sent(robot, adapter):
    drive(robot, Twist(0.6, 0.0), 0.8)
    robot.wait(robot.now() + adapter.timeout + braking(robot))
    odometry = robot.read().odometry
    assert odometry is not None
    assert abs(odometry.twist.v) <= STILL


def test_after_closing_every_call_is_refused_with_the_reason(adapter):
    robot = adapter.make()
    robot.close()
    robot.close()
    for call in (robot.now, robot.read, robot.stop, lambda: robot.send(Twist(0.0, 0.0))):
        with pytest.raises(CohelmError, match="closed"):
            call()
