"""`pilot_step` for callers in Python: arguments and results packed in rows (`core.flat`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cohelm.core.flat import made, names, numbers, read, write
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Stick, Twist
from cohelm.law.govern import Profile
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.reference import Reference
from cohelm.pilot.step import Decision, PilotState, Settings, pilot_step
from cohelm.plan.course import Course

Flat = Callable[
    [PilotState, Pose, Twist, Stick, Surroundings, Course, float, Floats, Floats, float],
    tuple[PilotState, Decision],
]
"""`pilot_step` of one robot on one route, from Python."""

_STATE = len(names(PilotState))
_FASTEST = names(Settings).index("fastest")


def step_of(settings: Settings, line: Floats) -> Flat:
    """`pilot_step` with its constant arguments bound."""
    row = numbers(settings)
    outline = np.ascontiguousarray(settings.outline, dtype=np.float64)
    line = np.ascontiguousarray(line, dtype=np.float64)
    out = np.empty(_STATE + len(names(Decision)))

    def step(
        state: PilotState, pose: Pose, twist: Twist, stick: Stick, obstacles: Surroundings,
        course: Course, dt: float, sent: Floats, mover_history: Floats, fastest: float,
    ) -> tuple[PilotState, Decision]:  # fmt: skip
        row[_FASTEST] = fastest
        reference = course.reference
        # an int would compile another specialization
        x, y, psi, v = float(pose[0]), float(pose[1]), float(pose[2]), float(twist[0])
        _flat(
            numbers(state), x, y, psi, v, float(twist[1]), float(stick[0]), float(stick[1]),
            *obstacles, reference.knots, reference.coeffs, reference.speed, course.poses,
            course.paced.rate, course.row, line, outline, row, float(dt), sent, mover_history, out,
        )  # fmt: skip
        row_out = out.tolist()
        return made(PilotState, row_out), made(Decision, row_out, _STATE)

    return step


@jit
def _flat(
    state: Floats, x: float, y: float, psi: float, v: float, omega: float, stick_x: float,
    stick_psi: float, discs: Floats, max_acceleration: Floats, velocity_error: Floats,
    segments: Floats, points: Floats,
    knots: Floats, coeffs: Floats, speed: float, poses: Floats, rates: Floats, back: int,
    line: Floats, outline: Floats, settings: Floats, dt: float, sent: Floats, mover_history: Floats,
    out: Floats,
) -> None:  # fmt: skip
    course = Course(Reference(knots, coeffs, speed), poses, Profile(rates, knots[-1]), back, True)
    next_state, decision = pilot_step(
        read(PilotState, state, 0), Pose(x, y, psi), Twist(v, omega), Stick(stick_x, stick_psi),
        Surroundings(discs, max_acceleration, velocity_error, segments, points), course, line,
        read(Settings, settings, 0, (outline,)), dt, sent, mover_history,
    )  # fmt: skip
    write(next_state, out, 0)
    write(decision, out, _STATE)
