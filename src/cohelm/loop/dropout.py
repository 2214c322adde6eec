"""Dropouts: the operator's commands stop for a moment. The robot stands, and may continue.

A short involuntary loss brakes the robot but keeps its mode, if the same driver's same device
returns soon and is seen centred. A longer one, and any deliberate act (disarming the stick, another
device, releasing the lease), is a loss and latches a stop.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from cohelm.link.messages import Arming, Device
from cohelm.link.operator import OperatorInput
from cohelm.loop.stick_arming import StickState

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


class Dropout(NamedTuple):
    """The stick that is watched, and its dropout, if any."""

    why: str = ""
    """What is lost; empty: nothing."""
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
    dropout: Dropout, lost: str, received: OperatorInput, stick_state: StickState, now: float
) -> tuple[Dropout, DropoutAction]:
    """The dropout a period later, and what the supervisor does.

    lost: why the stick in use, or the driver, is lost; empty: nothing new is lost. stick_state: of
    this period; a stick that was lost is `ARMED` again only after it was centred.
    """
    if dropout.why:
        return _continued(dropout, received, stick_state, now)
    if not lost:
        return _remembered(dropout, received), DropoutAction.NOTHING
    silent = received.command is None or not received.command.valid
    same = received.driver == dropout.driver != 0 and dropout.device != Device.NONE
    since = now - max(received.age, 0.0) if math.isfinite(received.age) else now
    if not (silent and same) or now - since > BACK_WITHIN:
        return dropout.cleared, DropoutAction.STOP
    return dropout._replace(why=lost, since=since), DropoutAction.STAND


def _remembered(dropout: Dropout, received: OperatorInput) -> Dropout:
    """Remember the driver and the device."""
    command = received.command
    if command is not None and command.valid and command.armed:
        return Dropout(driver=received.driver, device=command.device)
    return dropout if received.driver == dropout.driver else Dropout()


def _continued(
    dropout: Dropout, received: OperatorInput, stick_state: StickState, now: float
) -> tuple[Dropout, DropoutAction]:  # fmt: skip
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
