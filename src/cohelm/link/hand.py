"""What the robot makes of its driver: whether the stick steers, and when to stop, pure.

A stick that is gone is not a stick that is centred. It steers only once it has been seen centred
after it came (armed); if it is lost while armed, or the link is, the robot does what was chosen
for that: stop and stay, with an alarm, or go on alone. A stop stays until the driver resets it.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from cohelm.core.types import Stick
from cohelm.link.messages import Arming, Ask, Command, Mode, Request

CENTRE = Stick(0.0, 0.0)


class OnLoss(IntEnum):
    """What the robot does when it loses its driver."""

    STOP = 0
    """Stop and stay."""
    ALONE = 1
    """Go on alone, where there is a plan."""


class Rules(NamedTuple):
    """When the driver counts as lost, and what then."""

    watchdog: float = 0.3
    """Without a command for so long, the link is lost [s]."""
    link_lost: OnLoss = OnLoss.STOP
    stick_lost: OnLoss = OnLoss.STOP
    centred: float = 0.05
    """A stick deflected by no more than this is centred."""


class State(NamedTuple):
    """What is remembered from step to step."""

    mode: Mode = Mode.HOLD
    arming: Arming = Arming.ABSENT
    driver: int = 0
    heard: float = -math.inf
    """When there was a command last [s]."""
    stopped: str = "not started"
    """Why it is stopped, until reset; empty: it is not."""
    lost: bool = False
    """The link is."""
    speed_scale: float = 1.0


class Hand(NamedTuple):
    """What follows from the driver now."""

    state: State
    stick: Stick
    """Deflection to steer with; centred unless armed."""
    brake: bool
    """Stand, now: stopped, or waiting for the driver."""
    alarm: str
    """What has just happened that the person must know; empty: nothing."""


def step(
    state: State, command: Command | None, driver: int, now: float, rules: Rules | None = None
) -> Hand:
    """One step.

    command: the driver's newest that is not stale, or None. driver: its number, 0: nobody.
    now: a steady clock [s].
    """
    rules = rules or Rules()
    if driver != state.driver:  # another hand: it must be centred first
        state = state._replace(driver=driver, arming=Arming.ABSENT)
        if driver:  # and has a watchdog's time to say something
            state = state._replace(heard=now, lost=False)
    if command is None:
        return _without(state, now, rules)
    state = state._replace(heard=now, lost=False, speed_scale=command.speed_scale)
    return _with(state, command, rules)


def ask(
    state: State, request: Request, name: str, command: Command | None, rules: Rules | None = None
) -> tuple[State, bool, str]:
    """STOP, RESET or MODE: the state that follows, whether it is granted, and why not.

    command: the driver's newest that is not stale, or None.
    """
    rules = rules or Rules()
    if request.what is Ask.STOP:
        return _stopped(state, f"{name or 'somebody'} pressed stop"), True, ""
    if request.what is Ask.RESET:
        if command is None:
            return state, False, "the driver is not heard"
        if command.valid and not _is_centred(command.stick, rules):
            return state, False, "centre the stick first"
        return state._replace(stopped=""), True, ""
    if request.what is Ask.MODE:
        try:
            mode = Mode(request.value)
        except ValueError:
            return state, False, "there is no such mode"
        return state._replace(mode=mode, arming=min(state.arming, Arming.WAITING)), True, ""
    return state, False, "not for the driver's hand"


def _without(state: State, now: float, rules: Rules) -> Hand:
    """No command that could be used."""
    gone = state.driver == 0 or now - state.heard > rules.watchdog
    if not gone:
        # What is too old is not used, and a stick in use is not let go either: wait.
        steered = state.mode is Mode.SHARED and state.arming is Arming.ARMED
        waits = steered or state.mode is Mode.MANUAL
        return Hand(state, CENTRE, bool(state.stopped) or waits or _holds(state), "")
    first = not state.lost
    state = state._replace(lost=True, arming=Arming.ABSENT)
    why = "nobody drives" if state.driver == 0 else "the link to the driver was lost"
    moves = not state.stopped and state.mode is not Mode.HOLD
    if rules.link_lost is OnLoss.ALONE and state.mode in (Mode.SHARED, Mode.AUTOMATIC):
        return Hand(state, CENTRE, bool(state.stopped), why if first and moves else "")
    if not moves:
        return Hand(state, CENTRE, True, "")
    return Hand(_stopped(state, why), CENTRE, True, why)


def _with(state: State, command: Command, rules: Rules) -> Hand:
    was = state.arming
    if not command.valid:
        state = state._replace(arming=Arming.ABSENT)
        in_use = was is Arming.ARMED and state.mode in (Mode.SHARED, Mode.MANUAL)
        if in_use and not state.stopped:
            why = "the stick was lost"
            alone = rules.stick_lost is OnLoss.ALONE and state.mode is Mode.SHARED
            state = state if alone else _stopped(state, why)
            return Hand(state, CENTRE, bool(state.stopped), why)
    elif not command.armed:
        state = state._replace(arming=Arming.WAITING)
    elif was is not Arming.ARMED:
        centred = _is_centred(command.stick, rules)
        state = state._replace(arming=Arming.ARMED if centred else Arming.WAITING)
    steers = state.arming is Arming.ARMED and state.mode in (Mode.SHARED, Mode.MANUAL)
    stands = state.mode is Mode.MANUAL and not steers
    brake = bool(state.stopped) or _holds(state) or stands
    return Hand(state, command.stick if steers and not brake else CENTRE, brake, "")


def _stopped(state: State, why: str) -> State:
    return state._replace(stopped=state.stopped or why, arming=min(state.arming, Arming.WAITING))


def _holds(state: State) -> bool:
    return state.mode is Mode.HOLD


def _is_centred(stick: Stick, rules: Rules) -> bool:
    return max(abs(stick.x), abs(stick.psi)) <= rules.centred
