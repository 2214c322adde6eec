"""The gate: every proposal for the wheels passes it, or is refused with a reason.

A state and what happens to it, as pure functions of numbers: `propose` a twist, `tick` when none
came, `stop`, `reset`, `drive`. A refused proposal counts as silence, and silence trips the
watchdog: whatever is wrong with the loop, the robot stands soon after.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.robot.gate.bounds import Bounds, slowed, towards
from cohelm.robot.gate.modes import GateMode, driving, latched

STANDING = Twist(0.0, 0.0)


class GateRules(NamedTuple):
    """How strict the gate is. All times in seconds, of the robot's clock."""

    bounds: Bounds
    age: float = 0.1
    """The readings behind a proposal may be this old."""
    ahead: float = 0.01
    """They may be stamped this far ahead of now; more, and a clock has jumped."""
    watchdog: float = 0.1
    """Without a sound proposal for so long, the robot stops."""
    period: float = 0.02
    """The loop's: what the accelerations allow can be saved up for so long, and no longer."""
    jitter: float = 0.01
    """A proposal may come this much early and still change the speed by a whole period's worth."""


class Proposal(NamedTuple):
    """What the loop wants of the wheels."""

    sequence: int
    """Higher than that of any proposal before."""
    stamp: float
    """When the oldest reading that it relies on was true."""
    twist: Twist


class Gate(NamedTuple):
    """The state between two calls."""

    mode: GateMode = GateMode.IDLE
    reason: str = ""
    """Why it is stopped or faulted: the first reason, until the reset."""
    out: Twist = STANDING
    """What the wheels were told last."""
    paid: float = -math.inf
    """Up to when the accelerations allowed have been used."""
    heard: float = -math.inf
    """When the last sound proposal came."""
    sequence: int = -1
    """Of that proposal."""
    clock: float = -math.inf
    """The latest time there was."""
    refused: int = 0
    """Proposals refused so far."""


class Passed(NamedTuple):
    """What became of a proposal."""

    out: Twist
    """For the wheels, now."""
    reason: str
    """Why it is not what was proposed; empty where it is."""


def propose(gate: Gate, proposal: Proposal, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """What the wheels get instead of, or as, the proposed twist."""
    gate = _watched(gate, now, rules)
    wrong = _broken(proposal, now, rules)
    if wrong:
        gate = fault(gate._replace(refused=gate.refused + 1), wrong)
        return _resting(gate, now, rules)
    refusal = _unfit(gate, proposal, now, rules)
    if refusal:
        gate = gate._replace(refused=gate.refused + 1)
        if driving(gate.mode):  # the wheels keep what they have, and the watchdog counts on
            return gate, Passed(gate.out, refusal)
        return _resting(gate, now, rules)
    gate = gate._replace(heard=now, sequence=proposal.sequence)
    if not driving(gate.mode):
        return _resting(gate, now, rules)
    goal = slowed(proposal.twist, rules.bounds)
    gate = _moved(gate, goal, now, rules)
    reason = ""
    if goal != proposal.twist:
        reason = "faster than the robot may be"
    elif gate.out != goal:
        reason = "a change faster than the robot may make"
    return gate, Passed(gate.out, reason)


def tick(gate: Gate, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """Time passes without a proposal: the watchdog looks, and what rests brakes."""
    gate = _watched(gate, now, rules)
    if driving(gate.mode):
        return gate, Passed(gate.out, "")
    return _resting(gate, now, rules)


def due(gate: Gate, rules: GateRules) -> float:
    """When the watchdog will bark if nothing comes [s]; infinite while nothing drives."""
    return gate.heard + rules.watchdog if driving(gate.mode) else math.inf


def stop(gate: Gate, reason: str) -> Gate:
    """Latch a stop; a fault stays one, and the first reason stays."""
    if latched(gate.mode):
        return gate
    return gate._replace(mode=GateMode.STOPPED, reason=reason)


def fault(gate: Gate, reason: str) -> Gate:
    """Latch a fault; of several the first reason stays."""
    if gate.mode == GateMode.FAULTED:
        return gate
    if gate.mode == GateMode.STOPPED:
        return gate._replace(mode=GateMode.FAULTED, reason=f"{reason} (and stopped: {gate.reason})")
    return gate._replace(mode=GateMode.FAULTED, reason=reason)


def reset(gate: Gate, now: float, rules: GateRules) -> tuple[Gate, str]:
    """Let go of a stop or fault, into IDLE: nothing moves by that. Else why not.

    Not while the wheels still turn, and not before sound proposals come again.
    """
    if not latched(gate.mode):
        return gate, "there is nothing to reset"
    if gate.out != STANDING:
        return gate, "the robot is still braking"
    if not _lively(gate, now, rules):
        return gate, "the loop sends nothing sound"
    return gate._replace(mode=GateMode.IDLE, reason=""), ""


def drive(gate: Gate, mode: GateMode, now: float, rules: GateRules) -> tuple[Gate, str]:
    """Choose who drives (AUTOMATIC, SHARED) or nobody (IDLE). Else why not."""
    if latched(gate.mode):
        return gate, f"reset first: {gate.reason}"
    if latched(mode):
        return gate, "stop and fault are not chosen"
    if driving(mode) and not _lively(gate, now, rules):
        return gate, "the loop sends nothing sound"
    return gate._replace(mode=mode), ""


def _watched(gate: Gate, now: float, rules: GateRules) -> Gate:
    """The watchdog, and the clock it trusts."""
    if not math.isfinite(now):
        return fault(gate, "the robot's clock is no number")
    if now < gate.clock:  # from here on the new time counts
        back = gate._replace(clock=now, paid=-math.inf, heard=-math.inf)
        return fault(back, "the robot's clock went back")
    gate = gate._replace(clock=now)
    if driving(gate.mode) and now - gate.heard > rules.watchdog:
        late = f"no sound command for more than {1000.0 * rules.watchdog:.0f} ms"
        return fault(gate, late)
    return gate


def _broken(proposal: Proposal, now: float, rules: GateRules) -> str:
    """What shows that something is broken; empty where nothing does."""
    if not (math.isfinite(proposal.twist.v) and math.isfinite(proposal.twist.omega)):
        return "the loop asked for a speed that is no number"
    if not math.isfinite(proposal.stamp):
        return "the readings' time is no number"
    if proposal.stamp > now + rules.ahead:
        return "the readings come from the future: a clock jumped"
    return ""


def _unfit(gate: Gate, proposal: Proposal, now: float, rules: GateRules) -> str:
    """Why this proposal is not to be used; empty where it is."""
    if proposal.sequence <= gate.sequence:
        return "out of order"
    if now - proposal.stamp > rules.age:
        return "its readings are too old"
    return ""


def _lively(gate: Gate, now: float, rules: GateRules) -> bool:
    return now - gate.heard <= rules.watchdog


def _moved(gate: Gate, goal: Twist, now: float, rules: GateRules) -> Gate:
    """On towards a goal, as far as the accelerations allow by now."""
    paid = max(gate.paid, now - rules.period)
    out, used = towards(gate.out, goal, rules.bounds, now + rules.jitter - paid)
    return gate._replace(out=out, paid=paid + used)


def _resting(gate: Gate, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """Brake, or stand."""
    if not math.isfinite(now):
        return gate._replace(out=STANDING), Passed(STANDING, gate.reason)
    gate = _moved(gate, STANDING, now, rules)
    return gate, Passed(gate.out, gate.reason or "idle")
