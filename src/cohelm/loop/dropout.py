"""A dropout: the operator's messages stop for a moment. The robot stands, and may go on.

A page that hangs for a moment is no reason to begin anew. So what is lost without anybody's doing
brakes the robot in the mode it is, and nothing more, if the same driver's same device is heard
again soon and is seen centred. What is longer than that, and whatever somebody did (disarmed the
stick, took another one, gave the lease away), is a loss and latches a stop, as it is elsewhere.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from cohelm.link.messages import Arming, Device
from cohelm.link.operator_input import OperatorInput
from cohelm.loop.stick_arming import StickState

BACK_WITHIN = 1.0
"""Since the last that was heard before it: a longer dropout is a loss [s]."""
CENTRED_WITHIN = 3.0
"""Since the stick is back: who has not let go of it by then is not there. A driver needs 2.5 s to
see, understand and act, as roads are designed for [s]."""
WAITING = "waiting for your stick to be centred"


class Then(Enum):
    """What follows."""

    NOTHING = 0
    STAND = 1
    """A dropout begins: brake and stand in the mode it is."""
    GO_ON = 2
    """It is over."""
    STOP = 3
    """It was a loss: latch a stop."""


class Dropout(NamedTuple):
    """Whose stick is watched, and the dropout there is."""

    why: str = ""
    """What is lost; empty: nothing."""
    since: float = math.nan
    """When the last was heard before it [s]."""
    back: float = math.nan
    """Since when the stick is there again [s]; NaN: it is not."""
    driver: int = 0
    device: Device = Device.NONE
    """What the driver steered with before it."""

    @property
    def over(self) -> Dropout:
        """None any more, of the same stick."""
        return Dropout(driver=self.driver, device=self.device)


def followed(
    dropout: Dropout, lost: str, received: OperatorInput, stick_state: StickState, now: float
) -> tuple[Dropout, Then]:
    """The dropout a period later, and what follows.

    lost: why the stick in use, or the driver who must be heard, is not to be believed any more;
    empty: nothing new is lost. stick_state: of this period; one that was lost is `ARMED` again only
    after it was seen centred.
    """
    if dropout.why:
        return _further(dropout, received, stick_state, now)
    if not lost:
        return _known(dropout, received), Then.NOTHING
    silent = received.command is None or not received.command.valid
    same = received.driver == dropout.driver != 0 and dropout.device != Device.NONE
    since = now - max(received.age, 0.0) if math.isfinite(received.age) else now
    if not (silent and same) or now - since > BACK_WITHIN:
        return dropout.over, Then.STOP
    return dropout._replace(why=lost, since=since), Then.STAND


def _known(dropout: Dropout, received: OperatorInput) -> Dropout:
    """Remember whose stick it is, and which."""
    command = received.command
    if command is not None and command.valid and command.armed:
        return Dropout(driver=received.driver, device=command.device)
    return dropout if received.driver == dropout.driver else Dropout()


def _further(
    dropout: Dropout, received: OperatorInput, stick_state: StickState, now: float
) -> tuple[Dropout, Then]:  # fmt: skip
    command = received.command
    if received.driver != dropout.driver:
        return Dropout(), Then.STOP
    if command is None or not command.valid:
        if now - dropout.since > BACK_WITHIN:
            return dropout.over, Then.STOP
        return dropout._replace(back=math.nan), Then.NOTHING
    if command.device != dropout.device:
        return dropout.over, Then.STOP
    if stick_state.arming == Arming.ARMED:
        return dropout.over, Then.GO_ON
    back = dropout.back if math.isfinite(dropout.back) else now
    if now - back > CENTRED_WITHIN:
        return dropout.over, Then.STOP
    return dropout._replace(back=back), Then.NOTHING
