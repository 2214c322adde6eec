"""A monitor can only slow or stop, and what it says is heeded and told."""

import math
from pathlib import Path

import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.base import Robot
from cohelm.robot.gate.bounds import Bounds
from cohelm.robot.gate.gate import GateRules, Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.monitor import UNRESTRICTED, Restriction, strictest
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.port import Odometry, Readings
from cohelm.scenario import load
from cohelm.sim.kinematic import Kinematic

RULES = GateRules(Bounds(1.0, 50.0, 3.0, 50.0, math.inf, math.inf, 0.5))


class Says:
    """A monitor that answers as told."""

    def __init__(self, at_reading=UNRESTRICTED, of_twist=UNRESTRICTED):
        self.at_reading, self.of_twist = at_reading, of_twist
        self.seen = []

    def observe(self, now, readings, applied, stopped=False):
        self.seen.append((readings, applied))
        return self.at_reading

    def restrict(self, now, twist):
        return self.of_twist


def kept(*monitors):
    made = load.scenario("minimal", [])
    alone = load.standing_alone(made, Path())
    robot = Kinematic(alone.robot, Pose(0.0, 0.0, 0.0), alone.build_world(), seed=0)
    events = []
    it = LocalGatedRobot(robot, RULES, events.append, monitors)
    it.wait(0.1)
    it.read()
    it.propose(Proposal(0, it.now(), Twist(0.0, 0.0)))
    assert it.drive(GateMode.SHARED) == ""
    return it, events


def test_the_smallest_share_passes_on_the_same_arc_with_its_reason():
    half, third = Restriction(0.5, "half"), Restriction(1.0 / 3.0, "third")
    it, events = kept(Says(at_reading=half), Says(of_twist=third))
    passed = it.propose(Proposal(1, it.now(), Twist(0.3, 0.6)))
    assert passed.applied == pytest.approx((0.1, 0.2))
    assert passed.reason == "third"
    assert any("limited: third" in event.text for event in events)


def test_a_fault_is_latched_whatever_other_monitors_report():
    watch = Says()
    it, _ = kept(Says(), watch)
    watch.of_twist = Restriction(1.0, "a broken sense", fault=True)
    passed = it.propose(Proposal(1, it.now(), Twist(0.3, 0.0)))
    assert passed.applied == (0.0, 0.0)
    assert it.gate.mode == GateMode.FAULTED
    assert it.gate.reason == "a broken sense"


def test_a_fault_in_a_reading_stops_an_idle_robot():
    watch = Says()
    it, _ = kept(watch)
    watch.at_reading = Restriction(fault=True, reason="the scan repeats")
    it.read()
    assert it.gate.mode == GateMode.FAULTED


def test_of_several_a_fault_comes_before_the_least_share():
    slow, fault = Restriction(0.0, "stands"), Restriction(1.0, "broken", True)
    assert strictest([UNRESTRICTED, slow, fault]) is fault
    assert strictest([UNRESTRICTED, slow]) is slow
    assert strictest([]) == UNRESTRICTED


@pytest.mark.parametrize(
    ("pose", "twist"),
    [
        (Pose(1e300, 0.0, 0.0), Twist(0.0, 0.0)),
        (Pose(0.0, -1e160, 0.0), Twist(0.0, 0.0)),
        (Pose(0.0, 0.0, 1e9), Twist(0.0, 0.0)),
        (Pose(0.0, 0.0, 0.0), Twist(1e155, 0.0)),
    ],
)
def test_odometry_that_no_wheels_can_have_measured_is_no_number_to_anybody(pose, twist):
    """Its square would be none, and so would all that is computed of it."""
    watch = Says()
    it, _ = kept(watch)
    it._robot.read = lambda: Readings(Odometry(it.now(), pose, twist))
    for readings in (it.read(), watch.seen[-1][0]):
        assert all(math.isnan(x) for x in (*readings.odometry.pose, *readings.odometry.twist))
        assert readings.odometry.stamp == it.now()


BLIND = load.load_robot("sally").model_copy(update={"lidar": None})


class StopsDead(Robot):
    """Wheels that do at once what they are sent, and block when they are stopped."""

    real_time = False

    def __init__(self):
        super().__init__(BLIND)
        self.t, self.x, self.twist = 0.0, 0.0, Twist(0.0, 0.0)

    def now(self):
        return self.t

    def wait(self, until):
        self.x += self.twist.v * (until - self.t)
        self.t = until

    def read(self):
        return Readings(self.odometry(Pose(self.x, 0.0, 0.0), self.twist))

    def send(self, twist):
        self.twist = twist

    def stop(self):
        self.twist = Twist(0.0, 0.0)


@pytest.mark.parametrize("speed", [0.6, -0.6, 1.0])
def test_a_robot_that_stops_harder_than_the_gate_brakes_is_stopped_and_not_at_fault(speed):
    it = LocalGatedRobot(
        RobotAdapter(StopsDead()), rules(BLIND, 0.02), watched_by=(PlausibilityMonitor(BLIND),)
    )
    for k in range(120):
        it.wait(0.02 * k)
        it.read()
        it.propose(Proposal(k, it.now(), Twist(speed, 0.0)))
        if k == 1:
            assert it.drive(GateMode.AUTOMATIC) == ""
        if k == 60:
            assert it.gate.applied.v == pytest.approx(speed)
            it.stop("the drive is over")
    assert (it.gate.mode, it.gate.reason) == (GateMode.STOPPED, "the drive is over")


class Waits(StopsDead):
    """One call of its takes long."""

    def __init__(self):
        super().__init__()
        self.call, self.takes = "", 0.0

    def _pass(self, call):
        if call == self.call:
            self.wait(self.now() + self.takes)

    def read(self):
        self._pass("read")
        return super().read()

    def send(self, twist):
        self._pass("send")
        super().send(twist)


@pytest.mark.parametrize("call", ["read", "send"])
@pytest.mark.parametrize("takes", [0.05, 1.5])
@pytest.mark.parametrize("mode", [GateMode.IDLE, GateMode.AUTOMATIC, GateMode.SHARED])
def test_a_call_of_the_driver_that_stops_the_robot_by_waiting_is_named(call, mode, takes):
    robot = Waits()
    it = LocalGatedRobot(RobotAdapter(robot), rules(BLIND, 0.02), watched_by=())
    it.propose(Proposal(0, it.now(), Twist(0.0, 0.0)))
    assert it.drive(mode) == ""
    robot.call, robot.takes = call, takes
    it.read()
    it.propose(Proposal(1, it.now(), Twist(0.3, 0.0)))
    it.tick()
    if mode == GateMode.IDLE or takes < 0.1:
        assert it.gate.mode == mode
        return
    assert it.gate.mode == GateMode.FAULTED
    assert it.gate.reason == (
        f"no valid command for more than 100 ms: {call} of the robot's driver took 1.50 s"
    )
    assert robot.twist == (0.0, 0.0)


@pytest.mark.parametrize(
    ("call", "takes", "said"),
    [
        ("read", 0.04, "read of the robot's driver takes 40 ms"),
        ("send", 0.06, "send of the robot's driver takes 60 ms"),
        ("read", 0.001, "this computer is too slow"),
    ],
)
def test_a_call_of_the_driver_that_makes_the_loop_late_is_named(call, takes, said):
    robot = Waits()
    it = LocalGatedRobot(RobotAdapter(robot), rules(BLIND, 0.02), watched_by=())
    it.propose(Proposal(0, it.now(), Twist(0.0, 0.0)))
    assert it.drive(GateMode.AUTOMATIC) == ""
    robot.call, robot.takes = call, takes
    for k in range(1, 40):
        it.wait(it.now() + max(0.02, 0.045 - takes))
        it.read()
        it.propose(Proposal(k, it.now(), Twist(0.0, 0.0)))
    assert it.gate.reason == f"commands come too seldom, and not every 20 ms: {said}"
