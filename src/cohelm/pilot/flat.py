"""`pilot_step` for callers in Python: numba unpacks an array in 150 ns, a named tuple in 800."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, Profile
from cohelm.law.guard.step import Rules
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.reference import Reference
from cohelm.pilot.step import Decision, PilotState, Settings, pilot_step
from cohelm.plan.course import Course
from cohelm.plan.evasion.params import Evasion, EvasionParams
from cohelm.plan.recovery import RecoveryMove
from cohelm.robot.limits import Limits

Flat = Callable[
    [PilotState, Pose, Twist, Stick, Surroundings, Course, float, Floats, Floats, float],
    tuple[PilotState, Decision],
]
"""`pilot_step` of one robot on one route, from Python."""

_STATE = 18  # of the numbers that come back, so many are the state


def step_of(settings: Settings, line: Floats) -> Flat:
    """The step with what stays the same taken in once."""
    s = settings
    row = np.array(
        [*s.limits, *s.gains, *s.rules, *s.pace, s.guarded, s.spline_speed, s.led_below,
         s.recovery_speed, s.recovery_yaw_rate, *s.evasion, s.rest], dtype=np.float64,
    )  # fmt: skip
    outline = np.ascontiguousarray(s.outline, dtype=np.float64)
    line = np.ascontiguousarray(line, dtype=np.float64)

    def step(
        state: PilotState, pose: Pose, twist: Twist, stick: Stick, around: Surroundings,
        course: Course, dt: float, sent: Floats, watched: Floats, fastest: float,
    ) -> tuple[PilotState, Decision]:  # fmt: skip
        k, time, clock, left, at, held, refused, evasion = state
        reference = course.reference
        # a whole number would compile another step
        x, y, psi, v = float(pose[0]), float(pose[1]), float(pose[2]), float(twist[0])
        n = _flat(
            k, time, *clock, *left, at, held, refused, *evasion, x, y, psi, v, float(twist[1]),
            float(stick[0]), float(stick[1]), *around,
            reference.knots, reference.coeffs, reference.speed, course.poses,
            course.paced.rate, course.row, line, outline, row, float(dt), sent,
            watched, float(fastest),
        )  # fmt: skip
        after = PilotState(
            n[0], n[1], CourseClock(n[2], n[3], n[4]), RecoveryMove(n[5], n[6], n[7]), n[8],
            n[9], n[10],
            Evasion(n[11], n[12], n[13], n[14], n[15], n[16], n[17]),
        )  # fmt: skip
        return after, Decision._make(n[_STATE:])

    return step


@jit
def _flat(
    k: int, time: float, tau: float, rate: float, waited: float, distance: float,
    curvature: float, turn: float, at: int, held: float, refused: int,
    on: bool, evade_v: float, evade_omega: float, then: float, turns: float, after_it: float,
    wait: int,
    x: float, y: float, psi: float, v: float,
    omega: float, stick_x: float, stick_psi: float, discs: Floats, agility: Floats,
    segments: Floats, points: Floats, knots: Floats, coeffs: Floats, speed: float, poses: Floats,
    rates: Floats, back: int, line: Floats, outline: Floats, r: Floats, dt: float, sent: Floats,
    watched: Floats, fastest: float,
) -> tuple[Any, ...]:  # fmt: skip
    limits = Limits(r[0], r[1], r[2], r[3], r[4], r[5], r[6])
    gains = Gains(
        r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16], r[17] != 0.0,
        r[18] != 0.0, r[19] != 0.0,
    )  # fmt: skip
    rules = Rules(r[20], r[21], r[22], r[23], r[24])
    pace = PaceParams(
        r[25], r[26], r[27], r[28], r[29], r[30], r[31], r[32], r[33], r[34], r[35], r[36], r[37]
    )
    evasion = EvasionParams(
        r[43], r[44], r[45], r[46], r[47], r[48], r[49], r[50], r[51], r[52], r[53], r[54], r[55],
        r[56], r[57], r[58], r[59], r[60], r[61], r[62], r[63],
    )  # fmt: skip
    s = Settings(
        outline, limits, gains, rules, pace, r[38] != 0.0, r[39] != 0.0, r[40], r[41], r[42],
        fastest, evasion, r[64],
    )  # fmt: skip
    before = PilotState(
        k,
        time,
        CourseClock(tau, rate, waited),
        RecoveryMove(distance, curvature, turn),
        at,
        held,
        refused,
        Evasion(on, evade_v, evade_omega, then, turns, after_it, wait),
    )
    reference = Reference(knots, coeffs, speed)
    course = Course(reference, poses, Profile(rates, knots[-1]), back, True)
    after, d = pilot_step(
        before, Pose(x, y, psi), Twist(v, omega), Stick(stick_x, stick_psi),
        Surroundings(discs, agility, segments, points), course, line, s, dt, sent,
        watched,
    )  # fmt: skip
    return (
        after.k, after.time, after.clock.tau, after.clock.rate, after.clock.waited,
        after.left.distance, after.left.curvature, after.left.turn, after.row, after.held,
        after.refused, after.evasion.on, after.evasion.v, after.evasion.omega, after.evasion.then,
        after.evasion.turns, after.evasion.after, after.evasion.left,
        d.safe_v, d.safe_omega, d.tracking_v, d.tracking_omega, d.operator_v, d.operator_omega,
        d.nominal_v, d.nominal_omega, d.avoid_v, d.avoid_omega, d.authority_x, d.authority_psi,
        d.intent_x, d.intent_psi, d.I, d.J, d.h, d.verdict, d.limiting, d.clearance_seen,
        d.change, d.behavior, d.tau, d.rate, d.waited, d.x_d, d.y_d, d.psi_d, d.u_d, d.r_d,
    )  # fmt: skip
