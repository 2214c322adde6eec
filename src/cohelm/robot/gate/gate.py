"""The gate: every proposed twist passes it, is limited, or is refused with a reason.

A state and pure functions of it: `propose` a twist, `tick` when none came, `stop`, `reset`,
`drive`. A refused proposal does not feed the watchdog: whatever is wrong with the loop, the robot
stands soon after.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.robot.gate.bounds import Bounds, towards, within_speeds
from cohelm.robot.gate.modes import GateMode, driving, latched

STANDING = Twist(0.0, 0.0)

_APART = 1.5
"""Proposals may come so many periods apart on average: what is certified holds for one."""


class GateRules(NamedTuple):
    """Parameters of the gate. All times in seconds, of the robot's clock."""

    bounds: Bounds
    age: float = 0.1
    """Maximum age of the readings behind a proposal."""
    ahead: float = 0.01
    """Maximum stamp ahead of now; beyond it, a clock has jumped."""
    watchdog: float = 0.1
    """Without a valid proposal for this long, the robot stops."""
    period: float = 0.02
    """The loop's period: unused acceleration accumulates for this long at most."""
    jitter: float = 0.01
    """A proposal may come this early and still change the speed by a whole period's worth."""
    slow: str = "a call of the robot's driver waits, or this computer is too slow"
    """Why proposals come too seldom, if they do."""


class Proposal(NamedTuple):
    """A twist that the loop proposes for the wheels."""

    sequence: int
    """Higher than that of any proposal before."""
    stamp: float
    """Stamp of the oldest reading that it relies on [s]."""
    twist: Twist


class Gate(NamedTuple):
    """The state between two calls."""

    mode: GateMode = GateMode.IDLE
    reason: str = ""
    """Why it is stopped or faulted: the first reason, until the reset."""
    applied: Twist = STANDING
    """The twist sent to the wheels last."""
    change_until: float = -math.inf
    """The time up to which the allowed acceleration has been used [s]."""
    last_proposal: float = -math.inf
    """When the last valid proposal came [s]."""
    sequence: int = -1
    """Of that proposal."""
    clock: float = -math.inf
    """The latest time seen [s]."""
    refused: int = 0
    """Proposals refused so far."""
    asked: float = -math.inf
    """When the last proposal came, valid or not [s]."""
    behind: float = 0.0
    """By how much proposals have come too seldom of late [s]."""


class Passed(NamedTuple):
    """The result of a proposal."""

    applied: Twist
    """For the wheels, now."""
    reason: str
    """Why it differs from the proposal; empty where it does not."""
    limit: float = math.inf
    """The monitors' speed limit [m/s], infinite: there is none..."""
    limit_reason: str = ""
    """... and its reason."""


def propose(gate: Gate, proposal: Proposal, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """Check a proposal; returns the new state and the command at the wheels."""
    gate = _check_pace(_check_watchdog(gate, now, rules), now, rules)
    wrong = _fault_in(proposal, now, rules)
    if wrong:
        gate = fault(gate._replace(refused=gate.refused + 1), wrong)
        return _brake(gate, now, rules)
    refusal = _refusal_of(gate, proposal, now, rules)
    if refusal:
        gate = gate._replace(refused=gate.refused + 1)
        if driving(gate.mode):  # the wheels keep what they have, and the watchdog counts on
            return gate, Passed(gate.applied, refusal)
        return _brake(gate, now, rules)
    gate = gate._replace(last_proposal=now, sequence=proposal.sequence)
    if not driving(gate.mode):
        return _brake(gate, now, rules)
    goal = within_speeds(proposal.twist, rules.bounds)
    gate = _approach(gate, goal, now, rules)
    reason = ""
    if goal != proposal.twist:
        reason = "faster than the robot may be"
    elif gate.applied != goal:
        reason = "a change faster than the robot may make"
    return gate, Passed(gate.applied, reason)


def tick(gate: Gate, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """Time passes without a proposal: check the watchdog; brake where nothing may drive."""
    gate = _check_watchdog(gate, now, rules)
    if driving(gate.mode):
        return gate, Passed(gate.applied, "")
    return _brake(gate, now, rules)


def due(gate: Gate, rules: GateRules) -> float:
    """When the watchdog trips if nothing comes [s]; infinite while nothing drives."""
    return gate.last_proposal + rules.watchdog if driving(gate.mode) else math.inf


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
    """Clear a stop or fault, into IDLE; nothing moves by that. Returns why not, or "".

    Refused while the wheels still turn, and until valid proposals come again.
    """
    if not latched(gate.mode):
        return gate, "there is nothing to reset"
    if gate.applied != STANDING:
        return gate, "the robot is still braking"
    why = _not_alive(gate, now, rules)
    return (gate, why) if why else (gate._replace(mode=GateMode.IDLE, reason=""), "")


def drive(gate: Gate, mode: GateMode, now: float, rules: GateRules) -> tuple[Gate, str]:
    """Set the mode: AUTOMATIC, SHARED or IDLE. Returns why not, or ""."""
    if latched(gate.mode):
        return gate, f"reset first: {gate.reason}"
    if latched(mode):
        return gate, "stop and fault can not be chosen"
    why = _not_alive(gate, now, rules) if driving(mode) else ""
    return (gate, why) if why else (gate._replace(mode=mode), "")


def _check_watchdog(gate: Gate, now: float, rules: GateRules) -> Gate:
    """Check the robot's clock and the watchdog."""
    if not math.isfinite(now):
        return fault(gate, "the robot's clock is not a number")
    if now < gate.clock:  # from here on the new time counts
        back = gate._replace(
            clock=now, change_until=-math.inf, last_proposal=-math.inf, asked=-math.inf
        )
        return fault(back, "the robot's clock went back")
    gate = gate._replace(clock=now)
    if driving(gate.mode) and now - gate.last_proposal > rules.watchdog:
        return fault(gate, silence(rules))
    return gate


def silence(rules: GateRules) -> str:
    """What the watchdog says of a loop that it has not heard in time."""
    return f"no valid command for more than {1000.0 * rules.watchdog:.0f} ms"


def _check_pace(gate: Gate, now: float, rules: GateRules) -> Gate:
    """Check that proposals come as often as the period says. One that is late is caught up by the
    next ones; of a loop that is always late it adds up to the watchdog's time."""
    if not math.isfinite(now):
        return gate
    apart = now - gate.asked
    behind = min(max(gate.behind + apart - _APART * rules.period, 0.0), 2.0 * rules.watchdog)
    if apart > rules.watchdog:  # silence, and the watchdog's
        behind = 0.0
    gate = gate._replace(asked=now, behind=behind)
    why = _too_slow(gate, rules)
    return fault(gate, why) if why and driving(gate.mode) else gate


def _too_slow(gate: Gate, rules: GateRules) -> str:
    """Why a loop that lives may not drive; empty where it may."""
    if not gate.behind > rules.watchdog:
        return ""
    return f"commands come too seldom, and not every {1000.0 * rules.period:.0f} ms: {rules.slow}"


def _fault_in(proposal: Proposal, now: float, rules: GateRules) -> str:
    """What in a proposal shows a fault of the loop; empty where nothing does."""
    if not (math.isfinite(proposal.twist.v) and math.isfinite(proposal.twist.omega)):
        return "the loop commanded a speed that is not a number"
    if not math.isfinite(proposal.stamp):
        return "the readings' time is not a number"
    if proposal.stamp > now + rules.ahead:
        return "the readings come from the future: a clock jumped"
    return ""


def _refusal_of(gate: Gate, proposal: Proposal, now: float, rules: GateRules) -> str:
    """Why this proposal is refused; empty where it is not."""
    if proposal.sequence <= gate.sequence:
        return "out of order"
    if now - proposal.stamp > rules.age:
        return "its readings are too old"
    return ""


def _not_alive(gate: Gate, now: float, rules: GateRules) -> str:
    """Why the loop does not count as alive; empty where it does."""
    if not now - gate.last_proposal <= rules.watchdog:
        return "the loop sends no valid command"
    return _too_slow(gate, rules)


def _approach(gate: Gate, goal: Twist, now: float, rules: GateRules) -> Gate:
    """Change the applied twist towards a goal, as far as the accelerations allow by now."""
    change_until = max(gate.change_until, now - rules.period)
    applied, used = towards(gate.applied, goal, rules.bounds, now + rules.jitter - change_until)
    return gate._replace(applied=applied, change_until=change_until + used)


def _brake(gate: Gate, now: float, rules: GateRules) -> tuple[Gate, Passed]:
    """Brake to standing, or stand."""
    if not math.isfinite(now):
        return gate._replace(applied=STANDING), Passed(STANDING, gate.reason)
    gate = _approach(gate, STANDING, now, rules)
    return gate, Passed(gate.applied, gate.reason or "idle")
