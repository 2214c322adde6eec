"""The operator's stick: whether its deflection is used, and what follows when it is lost.

A lost stick is not a centred stick: with the authority exp(-V_h) of (48), centred means that the
controller leads. So validity is transmitted beside the deflection, a stick steers only after it was
seen centred, and the deflection in use is rate-limited.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Arming, Command, Device, is_centred
from cohelm.link.operator import NO_INPUT, STALE, OperatorInput, is_current


class ArmingParams(NamedTuple):
    """Parameters of arming."""

    max_rate: float = 8.0
    """Rate limit of the deflection in use [1/s]."""
    stale: float = STALE
    """A driver without a command for this long is lost, also without a stick [s]."""


_NO_DRIVER = "there is no driver any more"


class StickState(NamedTuple):
    """The stick as of the last period."""

    arming: Arming = Arming.ABSENT
    stick: Stick = CENTRED
    """The deflection in use."""
    received: OperatorInput = NO_INPUT
    """What the operator gave, without a command that is too old."""
    lost: str = ""
    """Why the stick, armed a period ago, is no longer valid; else empty."""
    driver_lost: str = _NO_DRIVER
    """Why the driver counts as lost, with or without a stick; empty: not lost."""
    speed_scale: float = 1.0
    """Share of the usual speed that the driver allows: the newest command counts."""

    @property
    def deflection(self) -> Stick:
        """That of the driver's stick, whether it is in use or not; centred where there is none."""
        command, _ = _valid_command(self.received)
        return CENTRED if command is None else command.stick

    @property
    def delay(self) -> float:
        """The round trip over which a person steers [s]; NaN: nobody does, or not known."""
        return self.received.round_trip if self.arming == Arming.ARMED else math.nan


def current(received: OperatorInput, params: ArmingParams) -> OperatorInput:
    """The input without a command that is too old. Here alone the loop judges whether one is used;
    whether its driver is silent is another question: see `_driver_lost`."""
    return received if is_current(received.age, params.stale) else received._replace(command=None)


def updated(
    stick_state: StickState,
    received: OperatorInput,
    params: ArmingParams,
    dt: float,
    anew: bool = False,
) -> StickState:
    """The stick's state a period of `dt` [s] later.

    anew: the robot stands without a mode, or its mode steers by the stick from this period on. A
    stick that is deflected then must be centred first, or the robot would set off with the mode:
    nobody may be holding it.
    """
    received = current(received, params)
    command, why = _valid_command(received)
    arming, goal, lost = Arming.ABSENT, CENTRED, ""
    before = CENTRED if anew else stick_state.stick
    if command is not None:
        # another driver's stick must be centred again
        same = received.driver == stick_state.received.driver
        keeps = stick_state.arming == Arming.ARMED and same and not anew
        if keeps or is_centred(command.stick):
            arming, goal = Arming.ARMED, command.stick
        else:
            arming = Arming.WAITING
    elif stick_state.arming == Arming.ARMED:
        lost = why
    newest = received.command
    return StickState(
        arming, _rate_limited(before, goal, params.max_rate * dt), received, lost,
        _driver_lost(received, params.stale),
        stick_state.speed_scale if newest is None else newest.speed_scale,
    )  # fmt: skip


def _valid_command(received: OperatorInput) -> tuple[Command | None, str]:
    """The command, or why there is no valid one."""
    command = received.command
    if command is None:
        silent = received.driver != 0 and math.isfinite(received.age)
        return None, received.why or (_silent_for(received.age) if silent else _NO_DRIVER)
    if not (command.valid and math.isfinite(command.stick.x + command.stick.psi)):
        return None, received.why or "no valid stick input"
    if not command.armed:
        return None, "the stick was disarmed"
    return command, ""


def _driver_lost(received: OperatorInput, stale: float) -> str:
    """See `StickState.driver_lost`. A new driver has no command to use yet, as those from before it
    was the driver do not count; but it is not silent: its age says so."""
    if received.driver == 0:
        return _NO_DRIVER
    if not is_current(received.age, stale):
        return _silent_for(received.age) if math.isfinite(received.age) else "no command yet"
    return ""


def _silent_for(age: float) -> str:
    return f"no command for {1000.0 * age:.0f} ms"


def _rate_limited(now: Stick, goal: Stick, max_change: float) -> Stick:
    """Both axes moved towards their goal, by at most `max_change`."""
    return Stick(
        now.x + min(max(goal.x - now.x, -max_change), max_change),
        now.psi + min(max(goal.psi - now.psi, -max_change), max_change),
    )


# Dropouts: the operator's commands stop for a moment. The robot stands, and may continue.
#
# A short involuntary loss brakes the robot but keeps its mode, if the same driver's same device
# returns soon and is seen centred. A longer one, and any deliberate act (disarming the stick,
# another device, releasing the lease), is a loss and latches a stop.


BACK_WITHIN = 1.0
"""Since the last command before it: a longer dropout is a loss [s]."""
CENTRED_WITHIN = 3.0
"""Since the stick is back [s]: time to release it. Road design gives a driver 2.5 s to perceive and
react."""
WAITING = "waiting for your stick to be centred"


class DropoutAction(Enum):
    """What the supervisor does."""

    NOTHING = 0
    STAND = 1
    """A dropout begins: brake and stand in the present mode."""
    GO_ON = 2
    """It is over."""
    STOP = 3
    """It was a loss: latch a stop."""


class Loss(NamedTuple):
    """What is lost of those who drive."""

    what: str
    """stick or driver, as the alarm of it is called."""
    why: str

    @property
    def text(self) -> str:
        """As the reason of a stop."""
        return f"the {self.what} is lost: {self.why}"


class Dropout(NamedTuple):
    """The stick that is watched, and its dropout, if any."""

    lost: Loss | None = None
    """What is lost; None: nothing."""
    since: float = math.nan
    """When the last command before it came [s]."""
    back: float = math.nan
    """Since when the stick is back [s]; NaN: it is not."""
    driver: int = 0
    device: Device = Device.NONE
    """The device that was used before it."""

    @property
    def cleared(self) -> Dropout:
        """The same stick without a dropout."""
        return Dropout(driver=self.driver, device=self.device)


def stepped(
    dropout: Dropout, lost: Loss | None, stick_state: StickState, now: float
) -> tuple[Dropout, DropoutAction]:
    """The dropout a period later, and what the supervisor does.

    lost: the stick in use, or the driver; None: nothing new is lost. stick_state: of
    this period; a stick that was lost is `ARMED` again only after it was centred.
    """
    received = stick_state.received
    if dropout.lost:
        return _continued(dropout, stick_state, now)
    if not lost:
        return _remembered(dropout, received), DropoutAction.NOTHING
    silent = received.command is None or not received.command.valid
    same = received.driver == dropout.driver != 0 and dropout.device != Device.NONE
    since = now - max(received.age, 0.0) if math.isfinite(received.age) else now
    if not (silent and same) or now - since > BACK_WITHIN:
        return dropout.cleared, DropoutAction.STOP
    return dropout._replace(lost=lost, since=since), DropoutAction.STAND


def _remembered(dropout: Dropout, received: OperatorInput) -> Dropout:
    command = received.command
    if command is not None and command.valid and command.armed:
        return Dropout(driver=received.driver, device=command.device)
    return dropout if received.driver == dropout.driver else Dropout()


def _continued(
    dropout: Dropout, stick_state: StickState, now: float
) -> tuple[Dropout, DropoutAction]:  # fmt: skip
    received = stick_state.received
    command = received.command
    if received.driver != dropout.driver:
        return Dropout(), DropoutAction.STOP
    if command is None or not command.valid:
        if now - dropout.since > BACK_WITHIN:
            return dropout.cleared, DropoutAction.STOP
        return dropout._replace(back=math.nan), DropoutAction.NOTHING
    if command.device != dropout.device:
        return dropout.cleared, DropoutAction.STOP
    if stick_state.arming == Arming.ARMED:
        return dropout.cleared, DropoutAction.GO_ON
    back = dropout.back if math.isfinite(dropout.back) else now
    if now - back > CENTRED_WITHIN:
        return dropout.cleared, DropoutAction.STOP
    return dropout._replace(back=back), DropoutAction.NOTHING
