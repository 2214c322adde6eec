"""One control step: the paper's Fig. 2, with a reference that waits and a filter that holds."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.barrier import Avoidance
from cohelm.law.blend import blend
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, govern, governed
from cohelm.law.guard.step import Rules, guard
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.reference import desired
from cohelm.law.step import control_step, decided, hand_of
from cohelm.law.track import track
from cohelm.pilot.behavior import ESCAPING, EVADING, FOLLOWING, LED
from cohelm.pilot.delay_compensation import foreseen, moved_on
from cohelm.plan.course import Course, nearest_row
from cohelm.plan.evasion.evade import evade
from cohelm.plan.evasion.params import NO_EVASION, Evasion, EvasionParams
from cohelm.plan.recovery import RecoveryMove, kind, recovery_twist, rest
from cohelm.robot.limits import Limits

NO_MOVE = RecoveryMove(0.0, 0.0, 0.0)


class Settings(NamedTuple):
    """All that stays the same from step to step."""

    outline: Floats
    """(k, 2), convex, counter-clockwise, body frame [m]."""
    limits: Limits
    gains: Gains = Gains()
    rules: Rules = Rules()
    pace: PaceParams = PaceParams()
    guarded: bool = True
    """The guard filters, and the reference waits; else the paper's law as its gains say, with a
    reference that runs on with time (E12)."""
    spline_speed: bool = False
    """Feed-forward without the guard (E10): the spline's own speed instead of u_d."""
    led_below: float = 0.5
    """The person leads while the automatic share of some axis is below this."""
    recovery_speed: float = 0.4
    """Of moves out of tight spots [m/s]."""
    recovery_yaw_rate: float = 1.0
    """[rad/s]"""
    fastest: float = math.inf
    """What is asked for is slowed down to this, on the same arc [m/s]."""
    evasion: EvasionParams = EvasionParams()
    """How moving obstacles are evaded."""
    rest: float = 0.0
    """What the delay from command to wheels is longer than whole control periods [s]."""


class PilotState(NamedTuple):
    """What the pilot has in mind between two steps."""

    k: int
    """Steps so far."""
    time: float
    """Since the first step [s]."""
    clock: CourseClock
    """Of the course."""
    left: RecoveryMove
    """What is left of a move out of a tight spot."""
    row: int
    """Row of the route that is behind for good."""
    held: float
    """How long such a move has been held up [s]."""
    refused: int
    """Kinds of moves, see `plan.recovery`, that were held up since the robot last got on."""
    evasion: Evasion = NO_EVASION


START = PilotState(0, 0.0, CourseClock(0.0, 0.0, 0.0), NO_MOVE, 0, 0.0, 0)


class Decision(NamedTuple):
    """What one control step decided, and everything it decided it from."""

    safe_v: float
    safe_omega: float
    """The command U (49) [m/s, rad/s]."""
    tracking_v: float
    tracking_omega: float
    """tau_c, the tracking law's command (15), or the escape's."""
    operator_v: float
    operator_omega: float
    """tau_h, the person's command (38)."""
    nominal_v: float
    nominal_omega: float
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
    limiting: int
    """What held the nominal command back: discs, then segments, then points of the surroundings;
    -1 for nothing (or the barrier's heading term, E6)."""
    clearance_seen: float
    """Smallest clearance of the outline that the guard saw; infinite with nothing near [m]."""
    change: float
    """Distance of the command from the blend in the guard's metric [m/s]."""
    behavior: int
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
    state: PilotState, pose: Pose, twist: Twist, stick: Stick, around: Surroundings, course: Course,
    line: Floats, s: Settings, dt: float, sent: Floats, watched: Floats,
) -> tuple[PilotState, Decision]:  # fmt: skip
    """One step: where the robot will be, what it follows, what the person wants, what is let by.

    pose, twist: now; around: as of now; all in one frame. stick: deflections in [-1, 1]. line:
    (m, 2), the route. dt: time since the step before [s]. sent: (d, 2), commands under way, d
    whole control periods from command to wheels; this one is written into it. watched: from
    `nobody_watched`, what `evade` remembers of those that move; written into too.
    """
    then, before = foreseen(pose, twist, s.rest, sent, state.k, s.limits, s.rules.dt)
    delay = len(sent) * s.rules.dt + s.rest
    things = moved_on(around, delay)

    hand = hand_of(stick, s.gains)
    led = min(hand.share.x, hand.share.psi) < s.led_below
    left = NO_MOVE if led else state.left
    recovering = left.distance != 0.0 or left.turn != 0.0

    evasion = NO_EVASION
    if s.guarded and s.evasion.horizon > 0.0 and not led:
        evasion = evade(
            state.evasion, then, before, things, course, state.clock, s.outline, s.limits, s.gains,
            s.rules, s.pace, _capped(s.evasion, s.fastest), watched,
        )  # fmt: skip
    clock, target = _reference(state, then, course, led or evasion.on, recovering, s, dt)
    if evasion.on:
        tau_c, left, recovering = Twist(evasion.v, evasion.omega), NO_MOVE, False
    elif recovering:
        tau_c = recovery_twist(left, s.recovery_speed, s.recovery_yaw_rate, s.rules.dt)
    else:
        tau_c = track(then, target, s.gains)
    clearance, change = math.inf, 0.0
    if s.guarded:
        tau = _slowed(blend(tau_c, hand.operator, hand.share), s.fastest)
        asked = tau if hand.sound else Twist(math.nan, math.nan)  # not a centred stick: brake
        rules = _nearer(s.rules) if recovering else s.rules
        passed = guard(then, before, asked, things, s.outline, s.limits, rules, evasion.on)
        clearance, change = passed.clearance, passed.change
        u = Twist(passed.v - tau.v, passed.omega - tau.omega)
        step = decided(
            tau_c, hand, tau,
            Avoidance(u, 0.0, 0.0, math.inf, passed.verdict, passed.limiting),
        )  # fmt: skip
        v, omega = passed.v, passed.omega  # also when a number was none: it brakes
    else:
        step = control_step(then, target, stick, things.discs, s.gains)
        v, omega = step.safe_v, step.safe_omega
    d = len(sent)
    if d > 0:
        sent[state.k % d, 0], sent[state.k % d, 1] = v, omega
    if recovering:
        left = rest(left, Twist(v, omega), s.rules.dt)
    left, held, refused = _given_up(state, left, Twist(v, omega), clock.rate, dt)
    row = nearest_row(line, pose, state.row, max(state.row + _AHEAD, course.row))
    behavior = LED if led else (EVADING if evasion.on else (ESCAPING if recovering else FOLLOWING))
    after = PilotState(state.k + 1, state.time + dt, clock, left, row, held, refused, evasion)
    return after, Decision(
        v, omega, step.tracking_v, step.tracking_omega, step.operator_v, step.operator_omega,
        step.nominal_v, step.nominal_omega, step.avoid_v, step.avoid_omega,
        step.authority_x, step.authority_psi, step.intent_x, step.intent_psi,
        step.I, step.J, step.h, step.verdict, step.limiting, clearance, change, behavior,
        clock.tau, clock.rate, clock.waited,
        target.x, target.y, target.psi, target.u, target.r,
    )  # fmt: skip


@jit_inline
def _nearer(rules: Rules) -> Rules:
    """Moves out of tight spots are shaped to keep no more than is certified: along a wall nothing
    else would let a corner turn."""
    return Rules(
        rules.dt, rules.hard_margin, rules.hard_margin, rules.deceleration_fraction,
        rules.steer_weight,
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
        e.moving_growth, e.growth_per_speed, e.most_growth, e.social_clearance, e.risk_weight,
        e.ahead, e.slack, e.slack_growth, e.turning, e.hysteresis, e.static_clearance,
        e.certified_for, e.certified_growth, e.pass_right, e.sets_off_weight,
        e.sets_off_acceleration,
    )  # fmt: skip


PATIENCE = 0.4
"""A move held up for longer is given up [s]."""
_STILL = 0.01  # slower than this it is held up [m/s, rad/s]
_GETS_ON = 0.5  # from this rate of the clock on the robot gets on
_AHEAD = 20  # rows of the route within which the nearest is looked for


@jit_inline
def still(command: Twist) -> bool:
    """Whether it moves nothing."""
    return abs(command.v) < _STILL and abs(command.omega) < _STILL


@jit
def _given_up(
    state: PilotState, left: RecoveryMove, command: Twist, rate: float, dt: float
) -> tuple[RecoveryMove, float, int]:
    """What is left of a move, how long it has been held up, and the kinds that led nowhere."""
    if left.distance == 0.0 and left.turn == 0.0:
        return NO_MOVE, 0.0, 0 if rate > _GETS_ON else state.refused
    held = state.held + dt if still(command) else 0.0
    if held > PATIENCE:
        return NO_MOVE, 0.0, state.refused | kind(left)
    return left, held, state.refused


@jit
def _reference(
    state: PilotState,
    pose: Pose,
    course: Course,
    led: bool,
    recovering: bool,
    s: Settings,
    dt: float,
) -> tuple[CourseClock, Desired]:
    """The clock one step on, and what is desired then."""
    if not s.guarded:
        time = state.time
        return CourseClock(time, 1.0, 0.0), desired(course.reference, time, s.spline_speed)
    clock = state.clock
    if not recovering:
        clock = govern(clock, pose, course.reference, course.paced, led, s.pace, dt)
    return clock, governed(course.reference, clock, pose, s.pace)
