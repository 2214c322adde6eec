"""A stick is believed only after it was centred, and a vanished one is not a centred one."""

import math

import pytest

from cohelm.core.types import Stick
from cohelm.link.messages import Arming, Command, Device
from cohelm.link.operator_input import OperatorInput
from cohelm.loop.operator import NOBODY
from cohelm.loop.stick_arming import CENTRED, ArmingParams, Person, renewed

M = ArmingParams()


def received(x=0.0, psi=0.0, valid=True, armed=True, age=0.02):
    command = Command(Stick(x, psi), valid, armed, Device.GAMEPAD, 1.0, ())
    return OperatorInput(1, "anna", command, age, 0.0, ())


def after(*said, start=Person(), dt=0.02):  # noqa: B008
    person = start
    for one in said:
        person = renewed(person, one, M, dt)
    return person


ARMED = after(received(), received())


def test_nobody_there_is_no_stick_and_no_loss():
    person = after(NOBODY)
    assert (person.arming, person.stick, person.lost) == (Arming.ABSENT, CENTRED, "")


def test_a_deflected_stick_waits_until_it_was_centred():
    person = after(*[received(0.8)] * 50)
    assert (person.arming, person.stick) == (Arming.WAITING, CENTRED)
    person = after(received(0.05), received(0.8), start=person)
    assert person.arming == Arming.ARMED
    assert person.stick.x > 0.0


def test_the_deflection_in_use_moves_no_faster_than_a_hand():
    person, last = ARMED, 0.0
    for _ in range(30):
        person = after(received(1.0, -1.0), start=person)
        assert person.stick.x - last <= M.hand_rate * 0.02 + 1e-12
        last = person.stick.x
    assert person.stick == Stick(1.0, -1.0)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (received(valid=False), "the stick vanished"),
        (received(x=math.nan), "the stick vanished"),
        (received(armed=False), "the stick was disarmed"),
        (received(age=0.31), "the newest command is 310 ms old"),
        (received(age=math.nan), "the newest command is nan ms old"),
        (OperatorInput(1, "anna", None, 0.4, 0.0, ()), "no command for 400 ms"),
        (NOBODY, "nobody drives any more"),
    ],
)
def test_a_stick_in_use_that_can_not_be_believed_is_lost_once_and_says_why(said, why):
    person = after(said, start=ARMED._replace(stick=Stick(0.8, 0.0)))
    assert (person.arming, person.lost) == (Arming.ABSENT, why)
    assert 0.0 < person.stick.x < 0.8  # let go no faster than a hand would
    again = after(said, start=person)
    assert again.lost == ""


def test_after_a_loss_it_must_be_centred_again():
    person = after(received(valid=False), received(0.8), start=ARMED)
    assert person.arming == Arming.WAITING
    assert after(received(0.0), start=person).arming == Arming.ARMED


def test_a_stick_that_only_waited_is_not_missed():
    assert after(received(0.8), received(valid=False)).lost == ""


def test_another_drivers_stick_must_be_centred_itself():
    other = received(0.8)._replace(driver=2)
    person = after(*[other] * 20, start=ARMED)
    assert (person.arming, person.stick, person.lost) == (Arming.WAITING, CENTRED, "")
    assert after(received(0.0)._replace(driver=2), start=person).arming == Arming.ARMED


def test_while_the_robot_is_stopped_a_stick_counts_only_as_long_as_it_is_centred():
    held = renewed(ARMED, received(0.8), M, 0.02, stopped=True)
    assert held.arming == Arming.WAITING
    assert after(*[received(0.8)] * 20, start=held).stick == CENTRED
    centred = renewed(held, received(0.0), M, 0.02, stopped=True)
    assert after(received(0.8), start=centred).arming == Arming.ARMED
