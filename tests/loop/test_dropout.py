"""A dropout brakes the robot; only a stick that was centred since resumes."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from hypothesis import example, given, settings, strategies as st

from cohelm.core.types import Stick
from cohelm.link.messages import Command, Device
from cohelm.link.operator import OperatorInput
from cohelm.loop.stick import (
    BACK_WITHIN,
    CENTRED_WITHIN,
    ArmingParams,
    Dropout,
    DropoutAction,
    Loss,
    StickState,
    stepped,
    updated,
)

DT = 0.02
SILENCE = 0.26
"""A link gives nothing to go by once the newest command is older than 250 ms [s]."""
AWAY = ("gone", "driver_lost")
"""What nobody does: the page hangs, the link is dark."""
STICKS = {"other driver": "berta's gamepad", "other device": "anna's touch pads"}
DONE = ("disarmed", "other device", "other driver", "released")
"""What somebody does."""


def said(what: str, age: float) -> OperatorInput:
    """What the loop hears in one period; age: how long nothing was heard [s]."""
    driver = {"other driver": 2, "released": 0}.get(what, 1)
    if what in ("driver_lost", "released"):
        return OperatorInput(driver, "anna", None, age, 0.0, ())
    x = 0.8 if what == "deflected" else 0.0
    device = {"gone": Device.NONE, "other device": Device.TOUCH}.get(what, Device.GAMEPAD)
    good = what != "gone"
    command = Command(Stick(x, 0.0), good, good and what != "disarmed", device, 1.0)
    return OperatorInput(driver, "anna", command, 0.02, 0.0, ())


class Period(NamedTuple):
    t: float
    what: str
    then: DropoutAction

    @property
    def stick(self) -> str:
        """Whose, and which; of what is none: nothing."""
        return "" if self.what in (*AWAY, "released") else STICKS.get(self.what, "anna's gamepad")


def lived(script: list[tuple[str, int]]) -> list[Period]:
    """A robot in shared mode, its driver armed, until it is stopped."""
    stick_state, dropout = StickState(), Dropout()
    quiet, t, periods = 0.0, 100.0, []
    for what, count in [("centred", 2), *script]:
        for _ in range(count):
            t += DT
            quiet = quiet + DT if what in ("driver_lost", "released") else 0.0
            heard = said(what, quiet + (SILENCE if quiet else 0.0))
            stick_state = updated(stick_state, heard, ArmingParams(), DT)
            why = stick_state.lost or stick_state.driver_lost
            lost = Loss("stick" if stick_state.lost else "driver", why) if why else None
            dropout, then = stepped(dropout, lost, stick_state, t)
            periods.append(Period(t, what, then))
            if then is DropoutAction.STOP:
                return periods
    return periods


scripts = st.lists(
    st.tuples(
        st.sampled_from(["centred", "deflected", *AWAY, *DONE]),
        st.integers(1, 60) | st.just(1) | st.integers(100, 200),
    ),
    max_size=8,
)


@given(scripts)
@settings(max_examples=300)
@example([("deflected", 5), ("gone", 20), ("deflected", 30), ("centred", 1)])
@example([("gone", 20), ("disarmed", 20), ("centred", 5)])
def test_only_the_same_stick_back_in_time_and_centred_resumes(script):
    standing, mine = None, ""
    for k, period in enumerate(periods := lived(script)):
        if period.then is DropoutAction.STAND:
            assert standing is None
            assert period.what in AWAY
            standing = period
        elif period.then is DropoutAction.GO_ON:
            assert standing is not None
            assert period.what not in ("deflected", "disarmed", *AWAY)
            meanwhile = [p for p in periods[: k + 1] if p.t >= standing.t]
            assert {p.stick for p in meanwhile} <= {mine, ""}
            away = [p.t for p in meanwhile if p.what in AWAY]
            assert away[-1] - standing.t <= BACK_WITHIN + 1e-9
            assert period.t - away[-1] <= CENTRED_WITHIN + 2 * DT
            standing = None
        elif period.then is DropoutAction.STOP:
            standing = None
        elif standing is None and period.what != "disarmed":
            mine = period.stick or mine
    if standing is not None:  # still undecided: it has not been for long
        assert periods[-1].t - standing.t <= BACK_WITHIN + CENTRED_WITHIN + 2 * DT


@given(scripts)
@settings(max_examples=200)
def test_any_loss_brakes_or_stops_the_robot_in_the_same_period(script):
    steers, standing, mine = True, False, "anna's gamepad"
    for period in lived(script)[1:]:
        if steers and period.what in (*AWAY, "disarmed", "released"):
            assert period.then in (DropoutAction.STAND, DropoutAction.STOP)
        if period.then in (DropoutAction.STAND, DropoutAction.STOP):
            steers = False
        elif period.stick != mine and period.stick:
            mine, steers = period.stick, period.what != "deflected"  # another's must be centred
        elif period.then is DropoutAction.GO_ON or (period.what == "centred" and not standing):
            steers = True
        standing = period.then is DropoutAction.STAND or (
            standing and period.then is DropoutAction.NOTHING
        )


@pytest.mark.parametrize("away", AWAY)
@pytest.mark.parametrize("held", ["deflected", "centred"])
def test_a_short_dropout_is_over_when_the_stick_was_centred(away, held):
    periods = lived([("deflected", 20), (away, 15), (held, 40), ("centred", 1)])
    thens = [p.then for p in periods if p.then is not DropoutAction.NOTHING]
    assert thens == [DropoutAction.STAND, DropoutAction.GO_ON]
    over = next(p for p in periods if p.then is DropoutAction.GO_ON)
    assert over.what == "centred"


@pytest.mark.parametrize("away", AWAY)
def test_a_long_dropout_is_a_loss(away):
    periods = lived([("deflected", 20), (away, 100)])
    assert periods[-1].then is DropoutAction.STOP
    stood = next(p for p in periods if p.then is DropoutAction.STAND)
    assert 0.7 <= periods[-1].t - stood.t <= BACK_WITHIN + 2 * DT


def test_a_stick_that_is_never_centred_again_is_a_loss():
    periods = lived([("deflected", 20), ("gone", 15), ("deflected", 400)])
    assert periods[-1].then is DropoutAction.STOP
    assert periods[-1].t - 100.0 == pytest.approx(0.7 + CENTRED_WITHIN, abs=0.1)


@pytest.mark.parametrize("what", DONE)
def test_a_deliberate_action_is_no_dropout(what):
    periods = lived([("deflected", 20), (what, 10)])
    # another driver's stick is not this one's; it waits to be centred, as it always did
    assert [p.then for p in periods][-1] is (
        DropoutAction.STOP if what in ("disarmed", "released") else DropoutAction.NOTHING
    )


def test_a_driver_without_a_stick_has_none_to_centre():
    dropout, now = Dropout(driver=1), 100.0
    heard = StickState(received=OperatorInput(1, "anna", None, 0.31, 0.0, ()))
    assert stepped(dropout, Loss("driver", "silent"), heard, now)[1] is DropoutAction.STOP


def test_an_unknown_age_does_not_extend_the_time_limit():
    dropout = Dropout(driver=1, device=Device.GAMEPAD)
    heard = StickState(received=OperatorInput(1, "anna", None, math.nan, 0.0, ()))
    stood, then = stepped(dropout, Loss("stick", "silent"), heard, 100.0)
    assert then is DropoutAction.STAND
    assert stepped(stood, None, heard, 101.01)[1] is DropoutAction.STOP
