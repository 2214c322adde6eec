"""The stick: centred first, and a lost stick is not a centred one; loss of the driver."""

import math

import pytest

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Arming, Command, Device
from cohelm.link.operator import NO_INPUT, OperatorInput
from cohelm.loop.stick import ArmingParams, StickState, updated

M = ArmingParams()


def received(x=0.0, psi=0.0, valid=True, armed=True, age=0.02):
    command = Command(Stick(x, psi), valid, armed, Device.GAMEPAD, 1.0)
    return OperatorInput(1, "anna", command, age, 0.0, ())


def after(*said, start=StickState(), dt=0.02):  # noqa: B008
    stick_state = start
    for one in said:
        stick_state = updated(stick_state, one, M, dt)
    return stick_state


ARMED = after(received(), received())


def test_without_an_operator_there_is_no_stick_and_no_loss():
    stick_state = after(NO_INPUT)
    assert (stick_state.arming, stick_state.stick, stick_state.lost) == (Arming.ABSENT, CENTRED, "")


def test_a_deflected_stick_waits_until_it_was_centred():
    stick_state = after(*[received(0.8)] * 50)
    assert (stick_state.arming, stick_state.stick) == (Arming.WAITING, CENTRED)
    stick_state = after(received(0.05), received(0.8), start=stick_state)
    assert stick_state.arming == Arming.ARMED
    assert stick_state.stick.x > 0.0


def test_the_deflection_in_use_is_rate_limited():
    stick_state, last = ARMED, 0.0
    for _ in range(30):
        stick_state = after(received(1.0, -1.0), start=stick_state)
        assert stick_state.stick.x - last <= M.max_rate * 0.02 + 1e-12
        last = stick_state.stick.x
    assert stick_state.stick == Stick(1.0, -1.0)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (received(valid=False), "no valid stick input"),
        (received(x=math.nan), "no valid stick input"),
        (received(armed=False), "the stick was disarmed"),
        (received(age=0.26), "no command for 260 ms"),
        (received(age=0.31), "no command for 310 ms"),
        (received(age=math.nan), "there is no driver any more"),
        (OperatorInput(1, "anna", None, 0.4, 0.0, ()), "no command for 400 ms"),
        (NO_INPUT, "there is no driver any more"),
    ],
)
def test_an_invalid_stick_in_use_is_lost_once_with_the_reason(said, why):
    stick_state = after(said, start=ARMED._replace(stick=Stick(0.8, 0.0)))
    assert (stick_state.arming, stick_state.lost) == (Arming.ABSENT, why)
    assert 0.0 < stick_state.stick.x < 0.8  # let go no faster than a hand would
    again = after(said, start=stick_state)
    assert again.lost == ""


def test_after_a_loss_it_must_be_centred_again():
    stick_state = after(received(valid=False), received(0.8), start=ARMED)
    assert stick_state.arming == Arming.WAITING
    assert after(received(0.0), start=stick_state).arming == Arming.ARMED


def test_losing_a_stick_that_was_not_armed_is_no_loss():
    assert after(received(0.8), received(valid=False)).lost == ""


def test_another_drivers_stick_must_be_centred_first():
    other = received(0.8)._replace(driver=2)
    stick_state = after(*[other] * 20, start=ARMED)
    assert (stick_state.arming, stick_state.stick, stick_state.lost) == (
        Arming.WAITING,
        CENTRED,
        "",
    )
    assert after(received(0.0)._replace(driver=2), start=stick_state).arming == Arming.ARMED


def test_while_it_steers_nothing_a_stick_counts_only_as_long_as_it_is_centred():
    before = ARMED._replace(stick=Stick(0.8, 0.0))
    held = updated(before, received(0.8), M, 0.02, anew=True)
    assert (held.arming, held.stick) == (Arming.WAITING, CENTRED)  # at once: a mode may follow
    assert held.deflection == Stick(0.8, 0.0)
    assert after(*[received(0.8)] * 20, start=held).stick == CENTRED
    centred = updated(held, received(0.0), M, 0.02, anew=True)
    assert after(received(0.8), start=centred).arming == Arming.ARMED


def heard(age=0.02, driver=1, fresh=True, scale=1.0, round_trip=0.0):
    command = Command(CENTRED, False, False, Device.NONE, scale)
    return OperatorInput(driver, "anna", command if fresh else None, age, round_trip, ())


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (heard(), ""),
        (heard(0.24, fresh=False), ""),  # a new driver: what it sent before does not count
        (heard(0.26, fresh=False), "no command for 260 ms"),
        (heard(math.nan, fresh=False), "no command yet"),
        (heard(driver=0), "there is no driver any more"),
    ],
)
def test_a_driver_is_lost_after_the_watchdog_whether_there_was_a_stick_or_not(said, why):
    assert after(said).driver_lost == why


def test_the_newest_speed_scale_applies():
    slow = after(heard(scale=0.25))
    assert slow.speed_scale == 0.25
    assert after(heard(fresh=False), start=slow).speed_scale == 0.25


def test_only_the_round_trip_of_a_stick_that_steers_counts():
    far = received()._replace(round_trip=0.6)
    assert after(far).delay == 0.6
    assert math.isnan(after(far._replace(command=None)).delay)
    assert math.isnan(after(heard(round_trip=0.6)).delay)
