"""Arms the stick: whether its deflection is used, and how fast it may change.

A lost stick is not a centred stick: with the authority exp(-V_h) of (48), centred means that the
controller leads. So validity is transmitted beside the deflection, a stick steers only after it was
seen centred, and the deflection in use is rate-limited.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Arming, Command, is_centred
from cohelm.link.operator import OperatorInput


class ArmingParams(NamedTuple):
    """Parameters of arming."""

    max_rate: float = 8.0
    """Rate limit of the deflection in use [1/s]."""
    silence: float = 0.3
    """A driver without a command for this long is lost, also without a stick [s]."""


class StickState(NamedTuple):
    """The stick as of the last period."""

    arming: Arming = Arming.ABSENT
    stick: Stick = CENTRED
    """The deflection in use."""
    age: float = math.nan
    """Of the newest command [s]."""
    driver: int = 0
    """The client it belongs to."""
    lost: str = ""
    """Why the stick, armed a period ago, is no longer valid; else empty."""


def updated(
    stick_state: StickState,
    received: OperatorInput,
    params: ArmingParams,
    dt: float,
    stopped: bool = False,
) -> StickState:
    """The stick's state a period of `dt` [s] later.

    stopped: the robot is latched; a stick that is held meanwhile must be centred again, or the
    robot would set off with the next mode.
    """
    command, why = _valid_command(received, params)
    if command is None:
        lost = why if stick_state.arming == Arming.ARMED else ""
        stick = _rate_limited(stick_state.stick, CENTRED, params.max_rate * dt)
        return StickState(Arming.ABSENT, stick, received.age, received.driver, lost)
    stick = command.stick
    same = received.driver == stick_state.driver  # another driver's stick must be centred again
    arming = stick_state.arming if same and not stopped else Arming.WAITING
    if arming != Arming.ARMED:
        arming = Arming.ARMED if is_centred(stick) else Arming.WAITING
    goal = stick if arming == Arming.ARMED else CENTRED
    return StickState(
        arming,
        _rate_limited(stick_state.stick, goal, params.max_rate * dt),
        received.age,
        received.driver,
        "",
    )


def _valid_command(received: OperatorInput, params: ArmingParams) -> tuple[Command | None, str]:
    """The command, or why there is no valid one."""
    command = received.command
    if command is None:
        silent = received.driver != 0 and math.isfinite(received.age)
        reason = (
            f"no command for {1000.0 * received.age:.0f} ms"
            if silent
            else "there is no driver any more"
        )
        return None, received.why or reason
    if not received.age <= params.silence:  # the link passes on none older than `STALE`
        return None, f"the newest command is {1000.0 * received.age:.0f} ms old"
    if not (command.valid and math.isfinite(command.stick.x + command.stick.psi)):
        return None, received.why or "no valid stick input"
    if not command.armed:
        return None, "the stick was disarmed"
    return command, ""


def _rate_limited(now: Stick, goal: Stick, max_change: float) -> Stick:
    """Both axes moved towards their goal, by at most `max_change`."""
    return Stick(
        now.x + min(max(goal.x - now.x, -max_change), max_change),
        now.psi + min(max(goal.psi - now.psi, -max_change), max_change),
    )
