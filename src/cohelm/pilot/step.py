"""One control step: the paper's Fig. 2, with a reference that waits and a filter that holds."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist, is_finite
from cohelm.law.barrier import Avoidance, barrier
from cohelm.law.blend import authority, blend
from cohelm.law.gains import Gains
from cohelm.law.govern import Clock, Pace, govern, governed
from cohelm.law.guard.step import NOTHING, Rules, guard
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.human import finite, human, intent, limited
from cohelm.law.reference import desired
from cohelm.law.track import track
from cohelm.law.verdict import INVALID, UNTOUCHED
from cohelm.perceive.escape import Escape, kind, rest, wish
from cohelm.pilot.course import Course, nearest_row
from cohelm.pilot.evasion import NO_EVASION, Evasion, EvasionParams, evade
from cohelm.pilot.foresee import foreseen, moved_on, stopping
from cohelm.robot.limits import Limits

GUARD, BARRIER, NONE = range(3)
"""Filters: the guard, with a reference that waits; the paper's barrier; none. With the last two
the reference runs on with time, as in the paper (E12)."""

FOLLOWING, LED, ESCAPING, EVADING = range(4)
"""What the robot is doing: following its course, led by the person, getting out of a tight spot,
getting out of somebody's way."""

NO_MOVE = Escape(0.0, 0.0, 0.0)


class Settings(NamedTuple):
    """All that stays the same from step to step."""

    outline: Floats
    """(k, 2), convex, counter-clockwise, body frame [m]."""
    limits: Limits
    gains: Gains = Gains()
    rules: Rules = Rules()
    pace: Pace = Pace()
    filter: int = GUARD
    spline_speed: bool = False
    """Feed-forward without the guard (E10): the spline's own speed instead of u_d."""
    led_below: float = 0.5
    """The person leads while the automatic share of some axis is below this."""
    escape_speed: float = 0.4
    """Of moves out of tight spots [m/s]."""
    escape_yaw_rate: float = 1.0
    """[rad/s]"""
    fastest: float = math.inf
    """What is asked for is slowed down to this, on the same arc [m/s]."""
    evasion: EvasionParams = EvasionParams()
    """How moving obstacles are evaded."""


class State(NamedTuple):
    """What the pilot has in mind between two steps."""

    k: int
    """Steps so far."""
    time: float
    """Since the first step [s]."""
    clock: Clock
    """Of the course."""
    left: Escape
    """What is left of a move out of a tight spot."""
    row: int
    """Row of the route that is behind for good."""
    held: float
    """How long such a move has been held up [s]."""
    refused: int
    """Kinds of moves, see `perceive.escape`, that were held up since the robot last got on."""
    evasion: Evasion = NO_EVASION


START = State(0, 0.0, Clock(0.0, 0.0, 0.0), NO_MOVE, 0, 0.0, 0)


class Decision(NamedTuple):
    """What one control step decided, and everything it decided it from."""

    v: float
    omega: float
    """The command U (49) [m/s, rad/s]."""
    automatic_v: float
    automatic_omega: float
    """tau_c, the tracking law's wish (15), or the escape's."""
    human_v: float
    human_omega: float
    """tau_h, the person's wish (38)."""
    shared_v: float
    shared_omega: float
    """tau, the blend (34)."""
    avoid_v: float
    avoid_omega: float
    """u (33): what the filter added to the blend."""
    authority_x: float
    authority_psi: float
    """Diagonal of K_c: the automatic share of each axis."""
    intent_x: float
    intent_psi: float
    """V_hx and V_hpsi (41)(42)."""
    I: float
    J: float
    """Both sides of the barrier's test (31)(32); 0 with another filter."""
    h: float
    """Smallest h_i of the discs [m^2]; infinite without any, and with another filter."""
    verdict: int
    """See `law.verdict`."""
    culprit: int
    """What held the wish back: discs, then segments, then points of the surroundings; -1 for
    nothing (or the barrier's heading term, E6)."""
    gap: float
    """Smallest gap of the outline that the guard saw; infinite with nothing near [m]."""
    change: float
    """Distance of the command from the blend in the guard's metric [m/s]."""
    doing: int
    """FOLLOWING, LED, ESCAPING or EVADING."""
    tau: float
    """The course's clock [s]."""
    rate: float
    """d tau / d t, in [0, 1]."""
    waited: float
    """How long the clock has stood still though the way was not over [s]."""
    x_d: float
    y_d: float
    psi_d: float
    u_d: float
    r_d: float
    """What was tracked (7)(10)."""


@jit
def pilot_step(
    state: State, pose: Pose, twist: Twist, stick: Stick, around: Surroundings, course: Course,
    line: Floats, s: Settings, dt: float, sent: Floats,
) -> tuple[State, Decision]:  # fmt: skip
    """One step: where the robot will be, what it follows, what the person wants, what is let by.

    pose, twist: now; around: as of now; all in one frame. stick: deflections in [-1, 1]. line:
    (m, 2), the route. dt: time since the step before [s]. sent: (d, 2), commands under way, d
    control periods from command to wheels; this one is written into it.
    """
    then, before = foreseen(pose, twist, sent, state.k, s.limits, s.rules.dt)
    delay = len(sent) * s.rules.dt
    things = moved_on(around, delay, stopping(before, s.limits, s.rules.dt))

    hand = limited(stick, s.gains)
    energy = intent(hand, s.gains)
    share = authority(energy, s.gains)
    led = min(share.x, share.psi) < s.led_below
    left = NO_MOVE if led else state.left
    escaping = left.distance != 0.0 or left.turn != 0.0

    evasion = NO_EVASION
    if s.filter == GUARD and s.evasion.horizon > 0.0 and not led:
        evasion = evade(
            state.evasion, then, before, things, course, state.clock, s.outline, s.limits, s.gains,
            s.rules, s.pace, _capped(s.evasion, s.fastest),
        )  # fmt: skip
    clock, target = _reference(state, then, course, led or evasion.on, escaping, s, dt)
    if evasion.on:
        tau_c, left, escaping = Twist(evasion.v, evasion.omega), NO_MOVE, False
    elif escaping:
        tau_c = wish(left, s.escape_speed, s.escape_yaw_rate, s.rules.dt)
    else:
        tau_c = track(then, target, s.gains)
    tau_h = human(hand, s.gains)
    tau = _slowed(blend(tau_c, tau_h, share), s.fastest)

    v, omega, verdict, culprit, gap, change = 0.0, 0.0, UNTOUCHED, NOTHING, math.inf, 0.0
    avoid = Avoidance(Twist(0.0, 0.0), 0.0, 0.0, math.inf, UNTOUCHED, -1)
    if s.filter == GUARD:
        asked = tau if finite(stick) else Twist(math.nan, math.nan)  # not a centred stick: brake
        passed = guard(then, before, asked, things, s.outline, s.limits, s.rules)
        v, omega = passed.v, passed.omega
        verdict, culprit, gap, change = passed.verdict, passed.culprit, passed.gap, passed.change
    else:
        if s.filter == BARRIER:
            avoid = barrier(then, tau, things.discs, s.gains)
        v, omega = tau.v + avoid.input.v, tau.omega + avoid.input.omega
        verdict, culprit = avoid.verdict, avoid.culprit
    sound = is_finite(v) and is_finite(omega) and finite(stick)
    if not sound:
        verdict, culprit = INVALID, NOTHING
        v, omega = (v, omega) if s.filter == GUARD else (0.0, 0.0)
    d = len(sent)
    if d > 0:
        sent[state.k % d, 0], sent[state.k % d, 1] = v, omega
    if escaping:
        left = rest(left, Twist(v, omega), s.rules.dt)
    left, held, refused = _given_up(state, left, Twist(v, omega), clock.rate, dt)
    row = nearest_row(line, pose, state.row, max(state.row + _AHEAD, course.row))
    doing = LED if led else (EVADING if evasion.on else (ESCAPING if escaping else FOLLOWING))
    return State(state.k + 1, state.time + dt, clock, left, row, held, refused, evasion), Decision(
        v, omega,
        _or_0(tau_c.v), _or_0(tau_c.omega), _or_0(tau_h.v), _or_0(tau_h.omega),
        _or_0(tau.v), _or_0(tau.omega), _or_0(v - tau.v), _or_0(omega - tau.omega),
        _or_0(share.x), _or_0(share.psi), _or_0(energy.x), _or_0(energy.psi),
        _or_0(avoid.I), _or_0(avoid.J), avoid.h, verdict, culprit, gap, change, doing,
        clock.tau, clock.rate, clock.waited,
        target.x, target.y, target.psi, target.u, target.r,
    )  # fmt: skip


@jit
def _slowed(asked: Twist, fastest: float) -> Twist:
    """The same arc, no faster than that."""
    if abs(asked.v) > fastest:
        share = fastest / abs(asked.v)
        return Twist(asked.v * share, asked.omega * share)
    return asked


@jit_inline
def _capped(e: EvasionParams, fastest: float) -> EvasionParams:
    """An evasion is no faster than anything else may be."""
    return EvasionParams(
        e.horizon, e.period, min(e.speed, fastest), e.yaw_rate, e.clearance, e.standing_growth,
        e.growth_per_speed, e.most_growth, e.social_clearance, e.comfortable, e.clearance_weight,
        e.hysteresis, e.static_clearance, e.certified_for, e.pass_right,
    )  # fmt: skip


_PATIENCE = 0.4  # a move held up for longer is given up [s]
_STILL = 0.01  # slower than this it is held up [m/s, rad/s]
_GETS_ON = 0.5  # from this rate of the clock on the robot gets on
_AHEAD = 20  # rows of the route within which the nearest is looked for


@jit
def _given_up(
    state: State, left: Escape, command: Twist, rate: float, dt: float
) -> tuple[Escape, float, int]:
    """What is left of a move, how long it has been held up, and the kinds that led nowhere."""
    if left.distance == 0.0 and left.turn == 0.0:
        return NO_MOVE, 0.0, 0 if rate > _GETS_ON else state.refused
    still = abs(command.v) < _STILL and abs(command.omega) < _STILL
    held = state.held + dt if still else 0.0
    if held > _PATIENCE:
        return NO_MOVE, 0.0, state.refused | kind(left)
    return left, held, state.refused


@jit
def _reference(
    state: State, pose: Pose, course: Course, led: bool, escaping: bool, s: Settings, dt: float
) -> tuple[Clock, Desired]:
    """The clock one step on, and what is desired then."""
    if s.filter != GUARD:
        time = state.time
        return Clock(time, 1.0, 0.0), desired(course.reference, time, s.spline_speed)
    clock = state.clock
    if not escaping:
        clock = govern(clock, pose, course.reference, course.paced, led, s.pace, dt)
    return clock, governed(course.reference, clock, pose, s.pace)


@jit_inline
def _or_0(value: float) -> float:
    """The value, or 0 where it is not finite."""
    return value if is_finite(value) else 0.0
