"""A joystick on a topic: teleop_twist_joy's axes and buttons, and when there is no stick."""

import math
from types import SimpleNamespace

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.link.messages import Arming
from cohelm.loop.stick import ArmingParams, StickState, current, updated
from cohelm.ros.joy import JoyOperator, JoyParams, joy_params
from cohelm.ros.port import Received

CENTRED = Stick(0.0, 0.0)


class Topic:
    """A joystick in a test's hands, and the wall's time."""

    def __init__(self, **params):
        self.now, self.ahead, self.sender = 10.0, 1.7e9, "pad"
        self.operator = JoyOperator(self, "/joy", JoyParams()._replace(**params), lambda: self.now)

    def subscribe(self, topic, kind, qos, heard):
        self._heard = heard
        return lambda: None

    def endpoints(self):
        return []

    def say(self, x=0.0, psi=0.0, held=True, axes=6, buttons=8, late=0.0, stamp=None,
            odd=0.0):  # fmt: skip
        given = ([odd] + [0.0] * axes)[:axes]
        if axes > 5:
            given[5], given[2] = x, psi
        pressed = [0] * buttons
        if buttons > 5:
            pressed[5] = int(held)
        stamped = self.now + self.ahead - late if stamp is None else stamp
        stamp = SimpleNamespace(sec=int(stamped), nanosec=int(stamped % 1.0 * 1e9))
        message = SimpleNamespace(header=SimpleNamespace(stamp=stamp), axes=given, buttons=pressed)
        self._heard(Received(message, self.now, sender=self.sender))

    def heard(self):
        """As the loop takes it."""
        return current(self.operator.receive(), ArmingParams())

    @property
    def stick(self):
        heard = self.heard()
        return heard.command.stick if heard.command and heard.command.valid else None


def test_its_axes_are_those_of_teleop_twist_joy():
    joy = Topic()
    joy.say(0.5, -0.25)
    assert joy.stick == Stick(0.5, -0.25)
    joy.say(1.005, -1.0)
    assert joy.stick == Stick(1.0, -1.0)
    assert joy.operator.problem() == ""


def test_without_its_enable_button_it_is_centred_and_not_lost():
    joy = Topic()
    joy.say(0.5, 0.5, held=False)
    assert joy.stick == CENTRED
    assert not joy.operator.held()
    joy.say(0.5, 0.5)
    assert joy.stick == Stick(0.5, 0.5)
    assert joy.operator.held()
    free = Topic(required=False)
    free.say(0.5, 0.5, held=False, buttons=0)
    assert free.stick == Stick(0.5, 0.5)


def test_silent_it_is_no_centred_stick_but_none():
    joy = Topic()
    nobody = joy.operator.receive()
    assert nobody.command is None
    assert math.isnan(nobody.age)
    assert joy.operator.problem() == "/joy: nothing is received"
    joy.say(0.5)
    joy.now += 0.25
    assert joy.stick is not None
    joy.now += 0.05
    heard = joy.heard()
    assert (heard.driver, heard.command) == (1, None)
    assert heard.age == pytest.approx(0.3)
    assert joy.operator.problem() == "/joy: silent for 0.3 s"
    assert not joy.operator.held()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"axes": 5}, "it has 5 axes, and axis_linear.x is 5: choose it with --joy-param"),
        ({"axes": 0}, "it has 0 axes"),
        ({"buttons": 5}, "it has 5 buttons, and enable_button is 5"),
        ({"x": math.nan}, "its axes are nan and 0, and go from -1 to 1"),
        ({"psi": math.inf}, "its axes are 0 and inf"),
        ({"x": 32767.0}, "its axes are 32767 and 0, and go from -1 to 1: fix its driver"),
    ],
)
def test_invalid_joystick_messages_are_refused_and_steer_nothing(wrong, said):
    joy = Topic()
    joy.say(**wrong)
    assert joy.stick is None
    assert joy.operator.problem().startswith(f"/joy: {said}")
    assert joy.operator.receive().why == joy.operator.problem()
    assert not joy.operator.held()


@pytest.mark.parametrize(("x", "patience"), [(0.5, 3.0), (1.0, 10.0)])
def test_a_deflection_that_nothing_changes_is_of_no_hand(x, patience):
    joy = Topic()
    for k in range(round(patience / 0.05)):
        joy.say(x)
        assert joy.stick == Stick(x, 0.0), k
        joy.now += 0.05
    joy.now += 0.05
    joy.say(x)
    assert joy.stick is None
    assert "nothing of it has changed" in joy.operator.problem()
    joy.say(x + 0.001 if x < 1 else 0.9)
    assert joy.stick is not None
    for _ in range(400):  # centred it may rest
        joy.say(0.0)
        joy.now += 0.05
    assert joy.operator.problem() == ""


def test_an_axis_that_is_no_number_does_not_hide_that_nothing_changes():
    """NaN differs from itself: with one on any other axis a frozen stick would be held for ever."""
    joy = Topic()
    for _ in range(40):
        joy.now += 0.1
        joy.say(0.5, odd=float("nan"))
    assert "nothing of it has changed" in joy.operator.problem()


def test_the_reason_of_a_lost_stick_comes_from_its_topic():
    joy, dt = Topic(), 0.02
    joy.say()
    state = updated(StickState(), joy.heard(), ArmingParams(), dt)
    joy.say(0.5)
    state = updated(state, joy.heard(), ArmingParams(), dt)
    assert (state.arming, state.lost) == (Arming.ARMED, "")
    joy.say(axes=4)
    lost = updated(state, joy.heard(), ArmingParams(), dt).lost
    assert lost.startswith("/joy: it has 4 axes, and axis_linear.x is 5: choose it with")
    joy.now += 1.0
    lost = updated(state, joy.heard(), ArmingParams(), dt).lost
    assert lost == "/joy: silent for 1.0 s"


def test_bytes_that_are_no_message_are_none():
    joy = Topic()
    joy._heard(Received(None, 0.0, "3 bytes are no sensor_msgs/msg/Joy"))
    assert joy.stick is None


def test_parameters_are_those_of_teleop_twist_joy():
    given = ["axis_linear.x=1", "axis_angular.yaw=0", "enable_button=4", "hold_to_run=true"]
    assert joy_params(given) == JoyParams(1, 0, 4, True, True)
    assert joy_params(["require_enable_button=False"]).required is False
    assert joy_params([]) == JoyParams(5, 2, 5, True, False)


@pytest.mark.parametrize(
    ("pair", "said"),
    [
        ("axis_linear=1", "no parameter 'axis_linear'; did you mean axis_linear.x"),
        ("turbo", "there is no parameter 'turbo'; there are axis_linear.x"),
        ("enable_button=-1", "give the number of an axis or button"),
        ("enable_button=", "give the number"),
        ("axis_linear.x=left", "give the number"),
        ("hold_to_run=1", "give true or false"),
    ],
)
def test_a_parameter_that_is_none_is_refused(pair, said):
    with pytest.raises(CohelmError, match=said):
        joy_params([pair])


def test_a_joystick_topic_without_publisher_is_reported(monkeypatch):
    monkeypatch.setattr("cohelm.ros.joy._WAITS", 0.05)
    assert (
        Topic()
        .operator.nothing_received()
        .startswith("no node publishes /joy: start its driver, or")
    )
    joy = Topic()
    joy.say()
    assert joy.operator.nothing_received() == ""


def test_a_stick_that_comes_seconds_late_is_none():
    """As over a bridge that holds messages up, and delivers them one right after the other."""
    joy = Topic()
    for _ in range(50):
        joy.say(0.5, late=0.03)
        joy.now += 0.02
    assert joy.stick == Stick(0.5, 0.0)
    for k in range(100):  # three seconds of them, delivered within one
        joy.say(0.5, late=3.0 - 0.02 * k)
        if k < 80:
            assert joy.stick is None
            assert joy.operator.problem().endswith("s late, by its stamps")
            assert not joy.operator.held()
        joy.now += 0.01
    for _ in range(20):
        joy.say(0.5, late=0.03)
        joy.now += 0.02
    assert joy.operator.problem() == ""


def test_stamps_that_say_nothing_make_no_stick_late():
    joy = Topic()
    for _ in range(100):
        joy.say(0.5, stamp=1.7e9)  # the first one's, repeated
        assert joy.stick == Stick(0.5, 0.0)
        joy.say(0.25, stamp=0.0)
        assert joy.stick == Stick(0.25, 0.0)
        joy.now += 0.02
    for k in range(100):  # by a simulator's time, at half the speed
        joy.say(0.5 + 1e-3 * k, stamp=100.0 + 0.01 * k)
        assert joy.stick is not None
        joy.now += 0.02


def test_clocks_that_differ_drift_or_are_set_lose_no_stick_for_long():
    joy = Topic()
    for second in range(3600):  # an hour at 200 ppm
        joy.ahead -= 200e-6
        joy.say(1e-4 * second, late=0.02)
        assert joy.stick is not None
        joy.now += 1.0
    joy.ahead -= 5.0  # its clock is set back: all it says seems late
    joy.say(0.4)
    assert joy.stick is None
    joy.sender = "the same pad, its driver started again"
    joy.say(0.5)
    assert joy.stick is not None
    joy.ahead -= 5.0
    lost = 0.0
    while joy.stick is None or not lost:
        lost += 1.0
        joy.now += 1.0
        joy.say(1e-4 * lost, late=0.02)
        assert lost < 700.0
