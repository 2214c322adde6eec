"""One control step: the paper's Fig. 2 with a reference governor, evasion, and the guard."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.flat import names
from cohelm.core.jit import jit, jit_inline, jit_no_refcount
from cohelm.core.obstacles import Surroundings
from cohelm.core.scalars import wrap
from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.barrier import Avoidance
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, govern, governed
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import guard
from cohelm.law.human import Authority, Intent, blend, operator_command
from cohelm.law.reference import desired
from cohelm.law.step import control_step, total_command
from cohelm.law.track import pose_error, track
from cohelm.pilot.behavior import ESCAPING, EVADING, FOLLOWING, LED
from cohelm.pilot.delay_compensation import predict_obstacles, predict_robot
from cohelm.plan.course import Course, row_on_route
from cohelm.plan.evasion.evade import evade, not_evading
from cohelm.plan.evasion.params import NO_EVASION, Evasion, EvasionParams
from cohelm.plan.recovery import RecoveryMove, kind, recovery_twist, rest
from cohelm.robot.limits import Limits

NO_MOVE = RecoveryMove(0.0, 0.0, 0.0)


class Settings(NamedTuple):
    """Parameters of the control step."""

    outline: Floats
    """(k, 2), convex, counter-clockwise, body frame [m]."""
    limits: Limits
    gains: Gains = Gains()
    rules: Rules = Rules()
    pace: PaceParams = PaceParams()
    guarded: bool = True
    """Whether the guard filters and the reference is governed; else the paper's law by its gains,
    with a reference that runs on with time (E12)."""
    spline_speed: bool = False
    """Feed-forward without the guard (E10): the spline's own speed instead of u_d."""
    led_below: float = 0.5
    """The operator leads while the automatic share of some axis is below this."""
    recovery_speed: float = 0.4
    """Of recovery moves [m/s]."""
    recovery_yaw_rate: float = 1.0
    """[rad/s]"""
    fastest: float = math.inf
    """The nominal command is slowed down to this, on the same arc; see `limit_speed` [m/s]."""
    evasion: EvasionParams = EvasionParams()
    """Of moving obstacles."""
    rest: float = 0.0
    """Delay from command to wheels beyond whole control periods [s]."""


_FASTEST, _EVADES = map(names(Settings).index, ("fastest", "evasion.speed"))


def limit_speed(row: Floats, s: Settings, fastest: float) -> None:
    """Write into row, the `numbers` of the settings: no faster than `fastest`, evasions included
    [m/s]."""
    fastest = min(fastest, s.fastest)
    row[_FASTEST], row[_EVADES] = fastest, min(s.evasion.speed, fastest)


class PilotState(NamedTuple):
    """State of the pilot between two steps."""

    k: int
    """Steps so far."""
    time: float
    """Since the first step [s]."""
    clock: CourseClock
    """Of the path."""
    left: RecoveryMove
    """Rest of a recovery move."""
    row: int
    """Row of the route that has been passed."""
    held: float
    """How long the recovery move has been held up [s]."""
    refused: int
    """Kinds of recovery moves, see `plan.recovery`, held up since the robot last made progress."""
    evasion: Evasion = NO_EVASION
    moves: int = 0
    """Recovery moves begun since then."""
    awaits: bool = False
    """Whether it stands until the next plan, which continues a sequence of recovery moves."""
    barred: int = 0
    """Kinds of motion, see `plan.recovery`, that no evasion chooses: monitors hold them back."""
    place: Pose = Pose(math.inf, math.inf, 0.0)
    """Where the robot was when it last got anywhere, see `_pinned`."""
    pinned: float = 0.0
    """How long it has been there [s]."""


START = PilotState(0, 0.0, CourseClock(0.0, 0.0, 0.0), NO_MOVE, 0, 0.0, 0)


class Decision(NamedTuple):
    """What one control step decided, and everything it decided it from: `law.step.Step` and more.
    I and J are 0, and h is infinite, with another filter than the barrier; tracking is of recovery
    or evasion too; obstacles are numbered discs, segments, points."""

    safe: Twist
    tracking: Twist
    operator: Twist
    nominal: Twist
    avoid: Twist
    authority: Authority
    intent: Intent
    I: float
    J: float
    h: float
    verdict: int
    limiting: int
    clearance_seen: float
    """Smallest clearance of the outline in the guard; infinite with no obstacle near [m]."""
    change: float
    """Distance of the command from the blend in the guard's metric [m/s]."""
    behavior: int
    """FOLLOWING, LED, ESCAPING or EVADING."""
    tau: float
    """The path's clock [s]."""
    rate: float
    """d tau / d t, in [0, 1]."""
    waited: float
    """How long clock or robot have stood still before the end of the path [s]."""
    desired: Desired
    """What was tracked (7)(10)."""
    e_p: float
    """E_P (51) [m and rad], of the pose when the command takes effect: the desired one is for
    then."""


@jit
def pilot_step(
    state: PilotState, pose: Pose, twist: Twist, stick: Stick, obstacles: Surroundings,
    course: Course, line: Floats, s: Settings, dt: float, sent: Floats, mover_history: Floats,
    fresh: bool,
) -> tuple[PilotState, Decision]:  # fmt: skip
    """One step: delay compensation, evasion or tracking, blending, filter.

    pose, twist: now; obstacles: as of now; all in one frame. stick: deflections in [-1, 1]. line:
    (m, 2), the route. dt: time since the step before [s]. sent: (d, 2), commands under way, d
    whole control periods from command to wheels; this one is written into it. mover_history: of
    `evade`, from `empty_mover_history`; written into too. fresh: whether a new scan has updated
    the obstacles since the step before.
    """
    pose_ahead, twist_ahead = predict_robot(
        pose, twist, s.rest, sent, state.k, s.limits, s.rules.dt
    )
    delay = len(sent) * s.rules.dt + s.rest
    obstacles_ahead = predict_obstacles(obstacles, delay)

    operator = operator_command(stick, s.gains)
    operator_leads = min(operator.authority.x, operator.authority.psi) < s.led_below
    left = NO_MOVE if operator_leads else state.left
    recovering = left.distance != 0.0 or left.turn != 0.0
    recovering = recovering or (state.awaits and not operator_leads)

    evasion = not_evading(state.evasion, s.rules.dt)
    if s.guarded and s.evasion.horizon > 0.0 and not operator_leads:
        evasion = evade(
            state.evasion, pose_ahead, twist_ahead, obstacles_ahead, course, state.clock, s.outline,
            s.limits, s.gains, s.rules, s.pace, s.evasion, mover_history,
            obstacles.velocity_error, state.barred, fresh,
        )  # fmt: skip
    clock, target = _reference(
        state, pose_ahead, course, operator_leads or evasion.on, recovering, s, dt
    )
    if recovering and _faces_path(state, left, pose_ahead, target):
        left, recovering = NO_MOVE, False
    if evasion.on:
        tau_c, left, recovering = Twist(evasion.v, evasion.omega), NO_MOVE, False
    elif recovering:
        tau_c = recovery_twist(left, s.recovery_speed, s.recovery_yaw_rate, s.rules.dt)
    else:
        tau_c = track(pose_ahead, target, s.gains)
    follows = s.guarded and not (operator_leads or evasion.on or recovering)
    clearance, change = math.inf, 0.0
    if s.guarded:
        tau = _slowed(blend(tau_c, operator.twist, operator.authority), s.fastest)
        nominal = tau if operator.valid else Twist(math.nan, math.nan)  # not a centred stick: brake
        rules = _to_hard_margin(s.rules) if recovering else s.rules
        filtered = guard(
            pose_ahead, twist_ahead, nominal, obstacles_ahead, s.outline, s.limits, rules,
            evasion.on,
        )  # fmt: skip
        clearance, change = filtered.clearance, filtered.change
        u = Twist(filtered.twist.v - tau.v, filtered.twist.omega - tau.omega)
        step = total_command(
            tau_c, operator, tau,
            Avoidance(u, 0.0, 0.0, math.inf, filtered.verdict, filtered.limiting),
        )  # fmt: skip
        safe = filtered.twist  # also for INVALID: it brakes
    else:
        step = control_step(pose_ahead, target, stick, obstacles_ahead.discs, s.gains)
        safe = Twist(step.safe_v, step.safe_omega)
    d = len(sent)
    if d > 0:
        sent[state.k % d, 0], sent[state.k % d, 1] = safe.v, safe.omega
    if recovering:
        left = rest(left, safe, s.rules.dt)
    clock = _standing(state, clock, safe, course, dt) if follows else clock
    left, held, refused = _recovery_progress(state, left, safe, clock.rate, dt)
    awaits = recovering and left == NO_MOVE and state.moves >= MOVES
    row = row_on_route(line, pose, state.row, course, clock.tau)
    behavior = (
        LED
        if operator_leads
        else (EVADING if evasion.on else (ESCAPING if recovering else FOLLOWING))
    )
    moves = 0 if left == NO_MOVE and clock.rate > _PROGRESS_RATE else state.moves
    place, pinned = pose, 0.0
    if (follows or recovering) and clock.tau < course.reference.knots[-1]:
        place, pinned = _pinned(state, pose, min(course.reference.speed, s.fastest), dt)
    next_state = PilotState(
        state.k + 1, state.time + dt, clock, left, row, held, refused, evasion, moves, awaits,
        state.barred, place, pinned,
    )  # fmt: skip
    return next_state, Decision(
        safe, Twist(step.tracking_v, step.tracking_omega),
        Twist(step.operator_v, step.operator_omega), Twist(step.nominal_v, step.nominal_omega),
        Twist(step.avoid_v, step.avoid_omega), Authority(step.authority_x, step.authority_psi),
        Intent(step.intent_x, step.intent_psi), step.I, step.J, step.h, step.verdict, step.limiting,
        clearance, change, behavior,
        clock.tau, clock.rate, clock.waited, target, pose_error(pose_ahead, target),
    )  # fmt: skip


@jit_inline
def _to_hard_margin(rules: Rules) -> Rules:
    """Recovery moves are shaped to the hard margin only: along a wall a corner could not turn with
    the soft one."""
    return Rules(
        rules.dt, rules.hard_margin, rules.hard_margin, rules.deceleration_fraction,
        rules.steer_weight,
    )  # fmt: skip


@jit_no_refcount
def _slowed(nominal: Twist, fastest: float) -> Twist:
    """The same arc, no faster than `fastest`."""
    if abs(nominal.v) > fastest:
        share = fastest / abs(nominal.v)
        return Twist(nominal.v * share, nominal.omega * share)
    return nominal


MOVES = 3
"""Recovery moves without progress, before a sequence of them is searched for."""
PATIENCE = 0.4
"""A recovery move held up for longer is given up [s]."""
_FACING = 0.03  # heading error at which a turn is over [rad]
_STILL = 0.01  # a slower recovery move is held up [m/s, rad/s]
_AWAY, _AWAY_S = 0.4, 1.0  # so far from a place the robot has left it [m, s at its speed]
_TURNED = 1.0  # so has one that has turned by so much [rad]
_PROGRESS_RATE = 0.5  # rate of the clock above which the robot makes progress


@jit_inline
def still(command: Twist) -> bool:
    """Whether a command practically stands."""
    return abs(command.v) < _STILL and abs(command.omega) < _STILL


@jit_no_refcount
def _standing(
    state: PilotState, clock: CourseClock, command: Twist, course: Course, dt: float
) -> CourseClock:
    """The clock of a robot that follows its path: while the robot stands before the end, it is held
    up, even if the clock of a path just begun runs."""
    if still(command) and clock.tau < course.reference.knots[-1]:
        return CourseClock(clock.tau, clock.rate, state.clock.waited + dt)
    return clock


@jit_no_refcount
def _pinned(state: PilotState, pose: Pose, speed: float, dt: float) -> tuple[Pose, float]:
    """The place that the robot does not get away from, and how long it has been there [s].

    Neither clock nor wheels need to stand for that: before a door that it meets askew a robot
    twitches for ever, or backs off and comes again.
    """
    place = state.place
    away = math.hypot(pose.x - place.x, pose.y - place.y)
    if away > min(_AWAY, _AWAY_S * speed) or abs(wrap(pose.psi - place.psi)) > _TURNED:
        return pose, 0.0
    return place, state.pinned + dt


@jit_inline
def _faces_path(state: PilotState, left: RecoveryMove, pose: Pose, target: Desired) -> bool:
    """Whether the robot faces its path in the turn of a single move. That was planned for where the
    move began; from its end the path may lie in another direction."""
    turning = left.distance == 0.0 and left.turn != 0.0 and state.moves < MOVES
    return turning and abs(wrap(target.psi - pose.psi)) < _FACING


@jit_no_refcount
def _recovery_progress(
    state: PilotState, left: RecoveryMove, command: Twist, rate: float, dt: float
) -> tuple[RecoveryMove, float, int]:
    """The rest of a recovery move, how long it has been held up, and the kinds that were given
    up. After a move of a sequence all may be possible again."""
    if left.distance == 0.0 and left.turn == 0.0:
        moved = state.left != NO_MOVE and state.moves >= MOVES
        return NO_MOVE, 0.0, 0 if moved or rate > _PROGRESS_RATE else state.refused
    held = state.held + dt if still(command) else 0.0
    if held > PATIENCE:
        return NO_MOVE, 0.0, state.refused | kind(left)
    return left, held, state.refused


@jit_no_refcount
def _reference(
    state: PilotState, pose: Pose, course: Course, operator_leads: bool, recovering: bool,
    s: Settings, dt: float,
) -> tuple[CourseClock, Desired]:  # fmt: skip
    """The clock one step later, and the desired pose then."""
    if not s.guarded:
        time = state.time
        return CourseClock(time, 1.0, 0.0), desired(course.reference, time, s.spline_speed)
    clock = state.clock
    if not recovering:
        clock = govern(clock, pose, course.reference, course.paced, operator_leads, s.pace, dt)
    return clock, governed(course.reference, clock, pose, s.pace)
