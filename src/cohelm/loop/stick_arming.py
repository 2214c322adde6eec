"""Arms the stick: whether it may be believed, and how fast a hand may take over.

A stick that vanished is not a stick that is centred: with the authority exp(-V_h) of (48), centred
means that the controller leads. So validity travels beside the deflection, a stick steers only
after it was seen centred, and what it says reaches the law no faster than a hand would move it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Arming, Command, is_centred
from cohelm.link.operator_input import OperatorInput


class ArmingParams(NamedTuple):
    """How a person takes over."""

    hand_rate: float = 8.0
    """The deflection in use changes no faster than this [1/s]."""
    silence: float = 0.3
    """A driver who was not heard of for so long is lost, also without a stick [s]."""


class StickState(NamedTuple):
    """The stick as of the last period."""

    arming: Arming = Arming.ABSENT
    stick: Stick = CENTRED
    """The deflection in use."""
    age: float = math.nan
    """Of the newest command [s]."""
    driver: int = 0
    """Whose it is."""
    lost: str = ""
    """Why the stick, armed a period ago, is not to be believed any more; else empty."""


def updated(
    stick_state: StickState,
    received: OperatorInput,
    params: ArmingParams,
    dt: float,
    stopped: bool = False,
) -> StickState:
    """The stick a period of `dt` later, with what was received.

    stopped: the robot stays stopped until somebody resets it; a stick that is held through that
    must be seen centred again, or the robot would set off with the mode that is chosen next.
    """
    command, why = _believed(received, params)
    if command is None:
        lost = why if stick_state.arming == Arming.ARMED else ""
        stick = _towards(stick_state.stick, CENTRED, params.hand_rate * dt)
        return StickState(Arming.ABSENT, stick, received.age, received.driver, lost)
    stick = command.stick
    same = received.driver == stick_state.driver  # another hand must be seen centred itself
    arming = stick_state.arming if same and not stopped else Arming.WAITING
    if arming != Arming.ARMED:
        arming = Arming.ARMED if is_centred(stick) else Arming.WAITING
    goal = stick if arming == Arming.ARMED else CENTRED
    return StickState(
        arming,
        _towards(stick_state.stick, goal, params.hand_rate * dt),
        received.age,
        received.driver,
        "",
    )


def _believed(received: OperatorInput, params: ArmingParams) -> tuple[Command | None, str]:
    """The command, or why there is none to be believed."""
    command = received.command
    if command is None:
        silent = received.driver != 0 and math.isfinite(received.age)
        said = (
            f"no command for {1000.0 * received.age:.0f} ms" if silent else "nobody drives any more"
        )
        return None, received.why or said
    if not received.age <= params.silence:  # whoever handed it on; `STALE` ones are not
        return None, f"the newest command is {1000.0 * received.age:.0f} ms old"
    if not (command.valid and math.isfinite(command.stick.x + command.stick.psi)):
        return None, received.why or "the stick vanished"
    if not command.armed:
        return None, "the stick was disarmed"
    return command, ""


def _towards(now: Stick, goal: Stick, most: float) -> Stick:
    """Both axes on towards their goal, by at most `most`."""
    return Stick(
        now.x + min(max(goal.x - now.x, -most), most),
        now.psi + min(max(goal.psi - now.psi, -most), most),
    )
