"""Bumpers and cliff sensors: driven against, a latched stop; then only away; unheard, no motion."""

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Twist
from cohelm.robot.clock import SteppedClock
from cohelm.robot.contact_monitor import ContactMonitor
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.port import Contact, Readings
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic

STILL = Twist(0.0, 0.0)
FRONT = ContactModel(name="front", mount_x_m=0.35, width_m=0.4)
REAR = ContactModel(name="rear", mount_x_m=-0.35, mount_yaw_deg=180.0)
CLIFF = CliffModel(name="left", mount_x_m=0.3, mount_y_m=0.15)
MODEL = robot("sally").model_copy(update={"bumpers": (FRONT, REAR), "cliff_sensors": (CLIFF,)})
HALF = 0.5 * MODEL.track_m


def said(now, *on, without=()):
    names = [one.name for one in MODEL.contacts if one.name not in without]
    return Readings(contacts=tuple(Contact(now, name, name in on) for name in names))


def watching(*on, applied=STILL):
    it = ContactMonitor(MODEL)
    it.observe(0.0, said(0.0), STILL)
    return it, it.observe(0.02, said(0.02, *on), applied)


def passes(it, v, omega, now=0.02) -> bool:
    found = it.restrict(now, Twist(v, omega))
    assert found.share in (0.0, 1.0)
    assert not found.fault
    return found.share == 1.0


def test_while_none_is_on_everything_passes():
    it, found = watching()
    assert found == UNRESTRICTED
    assert passes(it, 1.0, 0.5)
    assert passes(it, -1.0, 0.5)


@pytest.mark.parametrize(
    ("on", "applied", "reason"),
    [
        ("front", Twist(0.3, 0.0), "contact monitor: the front bumper is pressed"),
        ("rear", Twist(-0.3, 0.0), "contact monitor: the rear bumper is pressed"),
        ("left", Twist(0.3, 0.0), "contact monitor: the left cliff sensor sees no floor"),
    ],
)
def test_driven_against_it_is_a_fault_that_names_it(on, applied, reason):
    assert watching(on, applied=applied)[1] == Restriction(0.0, reason, True)
    assert watching(on, applied=STILL)[1] == UNRESTRICTED
    assert watching(on, applied=Twist(-applied.v, 0.0))[1] == UNRESTRICTED


def test_it_is_a_fault_once_and_not_while_it_stays_on():
    it, _ = watching("front", applied=Twist(0.3, 0.0))
    assert it.observe(0.04, said(0.04, "front"), Twist(0.2, 0.0)) == UNRESTRICTED
    it.observe(0.06, said(0.06), STILL)
    assert it.observe(0.08, said(0.08, "front"), Twist(0.2, 0.0)).fault


def test_while_a_bumper_is_pressed_only_motion_away_from_it_passes():
    it, _ = watching("front")
    assert passes(it, -0.3, 0.0)
    assert passes(it, -0.3, 1.0)  # neither end of it goes forward
    assert not passes(it, 0.01, 0.0)
    assert not passes(it, -0.1, 1.0)  # one end does
    assert not passes(it, 0.0, 0.3)
    assert not passes(it, 0.3, -0.3)
    reason = it.restrict(0.02, Twist(0.1, 0.0)).reason
    assert reason == (
        "contact monitor: the front bumper is pressed: the robot can only drive away from it"
    )
    behind, _ = watching("rear")
    assert passes(behind, 0.3, 0.0)
    assert not passes(behind, -0.3, 0.0)


def test_before_a_drop_no_wheel_goes_forward():
    it, _ = watching("left")
    assert passes(it, -0.3, 0.3 / HALF - 1e-6)
    assert not passes(it, -0.3, 0.3 / HALF + 1e-3)
    assert not passes(it, 0.0, 0.1)
    assert not passes(it, 0.0, -0.1)


@given(
    v=st.floats(-2.0, 2.0),
    omega=st.floats(-4.0, 4.0),
    on=st.sampled_from(["front", "rear", "left"]),
)
def test_no_motion_that_passes_moves_a_pressed_bumper_outwards(v, omega, on):
    it, _ = watching(on)
    side = next(one for one in MODEL.contacts if one.name == on)
    yaw = math.radians(side.mount_yaw_deg)
    if passes(it, v, omega):
        for x, y in side.ends():
            assert (v - omega * y) * math.cos(yaw) + omega * x * math.sin(yaw) <= 1e-9


@pytest.mark.parametrize(
    ("readings", "now", "reason"),
    [
        (said(1.0, without=("rear",)), 1.0, "no message from the rear bumper"),
        (Readings(), 1.0, "no message from the front bumper"),
        (said(1.0), 1.51, "no message from the front bumper for more than 500 ms"),
        (said(1.0), 0.9, "the front bumper comes from the future: a clock jumped"),
        (said(math.nan), 1.0, "the time of the front bumper is not a number"),
    ],
)
def test_without_the_messages_of_any_of_them_nothing_passes(readings, now, reason):
    it = ContactMonitor(MODEL)
    it.observe(1.0, readings, STILL)
    for twist in (Twist(0.3, 0.0), Twist(-0.3, 0.0), Twist(0.0, 0.2)):
        assert it.restrict(now, twist) == Restriction(0.0, f"contact monitor: {reason}")
    assert it.restrict(now, STILL) == UNRESTRICTED


class Bumped:
    """A simulated robot, whose sensors somebody presses."""

    def __init__(self):
        self._robot = Kinematic(MODEL, clock=SteppedClock())
        self.on = ()
        self.mute = ()

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def read(self):
        given = said(self._robot.now(), *self.on, without=self.mute)
        return self._robot.read()._replace(contacts=given.contacts)


def test_behind_the_gate_the_robot_stops_at_once_latches_and_after_a_reset_only_backs():
    plant, events = Bumped(), []
    gated = LocalGatedRobot(
        plant, rules(MODEL, 0.02), events.append, watched_by=(ContactMonitor(MODEL),)
    )
    count = 0

    def driven(v, seconds):
        nonlocal count
        for _ in range(round(seconds / 0.02)):
            gated.read()
            passed = gated.propose(Proposal(count, gated.now(), Twist(v, 0.0)))
            count += 1
            gated.wait(gated.now() + 0.02)
        return passed

    driven(0.0, 0.1)
    assert gated.drive(GateMode.SHARED) == ""
    driven(0.5, 1.5)
    assert plant.truth().twist.v > 0.4
    plant.on = ("front",)
    driven(0.5, 1.0)
    assert plant.truth().twist.v == 0.0
    assert gated.gate.reason == "contact monitor: the front bumper is pressed"
    assert any("FAULTED: contact monitor: the front bumper" in one.text for one in events)
    assert gated.reset() == ""
    assert gated.drive(GateMode.SHARED) == ""
    where = plant.truth().pose.x
    assert "only drive away" in driven(0.5, 1.0).reason
    assert plant.truth().pose.x == where
    driven(-0.3, 1.0)
    assert plant.truth().pose.x < where - 0.1
    plant.on = ()
    driven(0.3, 1.0)
    assert plant.truth().twist.v > 0.2
    plant.mute = ("rear",)
    driven(0.3, 1.0)
    assert plant.truth().twist.v == 0.0
    assert gated.gate.mode == GateMode.SHARED  # goes on when it is heard again
