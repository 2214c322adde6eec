"""Reference governor: its clock waits while the robot is held up, and resumes without a jump.

The paper's reference runs on with time (E12): a robot that was held up, by the filter or by the
operator, is then dragged after a point far ahead, straight through the obstacle. Here the reference
time tau has a rate between 0 and 1, governed by how far behind the robot is, by the curvature and
clearance of the path ahead, and by whether the operator leads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit, jit_no_refcount
from cohelm.core.scalars import is_finite, wrap
from cohelm.core.types import Desired, Floats, Pose, Twist
from cohelm.law.reference import Reference, evaluate
from cohelm.robot.limits import Limits, ramps, speeds

_SHARE = 0.75  # of what the robot can do at most; the rest is left to the tracking law's feedback
_SAMPLES = 48  # samples per round of the search for the nearest point, three rounds


class PaceParams(NamedTuple):
    """Parameters of the reference governor."""

    lateral: float = 1.5
    """Largest lateral acceleration v^2 kappa [m/s^2]."""
    yaw_rate: float = 2.0
    """Largest yaw rate v kappa [rad/s]."""
    deceleration: float = 1.5
    """Slowing down ahead of a slow place, and of the end [m/s^2]."""
    tight: float = 0.02
    """Clearance up to which the reference creeps [m]."""
    open: float = 0.3
    """Clearance from which it no longer slows, linear in between [m]."""
    creep: float = 0.3
    """Speed where it is tight [m/s]."""
    slack: float = 0.1
    """How far the robot may be behind before the reference slows [m]."""
    lag: float = 0.5
    """How far behind it waits [m]."""
    turn: float = 1.0
    """Heading error at which it waits, at most a quarter turn [rad]."""
    guide: float = 0.5
    """Lookahead distance for steering back onto the path [m]."""
    search: float = 2.0
    """How far ahead the nearest point is searched while the operator leads [m]."""
    rise: float = 1.0
    """Fastest growth of the rate [1/s]."""
    fall: float = 4.0
    """Fastest fall of the rate [1/s]."""


def attainable(pace: PaceParams, limits: Limits, speed: float) -> PaceParams:
    """The parameters for a robot with these limits: a reference that turns, brakes or sets off
    faster than the robot can leaves it beside its path.

    speed: of the reference [m/s].
    """
    acceleration, yaw_rate = _SHARE * ramps(limits)[0], _SHARE * speeds(limits)[1]
    return pace._replace(
        yaw_rate=min(pace.yaw_rate, yaw_rate),
        deceleration=min(pace.deceleration, acceleration),
        rise=min(pace.rise, acceleration / speed),
    )


class CourseClock(NamedTuple):
    """The reference time tau [s] and its rate d tau / d t in [0, 1].

    waited: how long it has stood still, other than at its end and while the operator leads [s];
    the caller decides when to replan.
    """

    tau: float = 0.0
    rate: float = 0.0
    waited: float = 0.0


class Profile(NamedTuple):
    """The rate that a path allows, at `len(rate)` times evenly over it, both ends included.

    duration: of the reference, T_m [s].
    """

    rate: Floats
    duration: float


@jit
def profile(reference: Reference, clearance: Floats, pace: PaceParams) -> Profile:
    """The largest rate at each sample: by speed, curvature, clearance, and what comes after.

    It is 0 at the end: the reference comes to rest there.

    clearance: (n,), n >= 2, of the footprint at times evenly over the reference, both ends
    included; inf where nothing is near, -inf where the reference stops [m]. NaN counts as tight.
    """
    n = len(clearance)
    duration = reference.knots[-1]
    rate = np.empty(n)
    after, x, y = 0.0, 0.0, 0.0
    for back in range(n):
        i = n - 1 - back
        m = evaluate(reference.knots, reference.coeffs, duration * i / (n - 1))
        spline = math.sqrt(m.vx * m.vx + m.vy * m.vy)
        curvature = abs(m.vx * m.ay - m.vy * m.ax) / max(spline * spline * spline, 1e-12)
        v = min(reference.speed, math.sqrt(pace.lateral / max(curvature, 1e-12)))
        v = min(v, pace.yaw_rate / max(curvature, 1e-12))
        room = (clearance[i] - pace.tight) / (pace.open - pace.tight)
        room = min(max(room, 0.0), 1.0) if room == room else 0.0
        v = min(v, pace.creep + room * max(reference.speed - pace.creep, 0.0))
        distance = math.hypot(m.x - x, m.y - y) if back > 0 else 0.0
        v = min(v, math.sqrt(after * after + 2.0 * pace.deceleration * distance), spline)
        v = 0.0 if clearance[i] == -math.inf else v
        after, x, y = v, m.x, m.y
        rate[i] = v / spline if spline > v else 1.0
    return Profile(rate, duration)


@jit_no_refcount
def allowed(profile: Profile, tau: float) -> float:
    """The profile's rate at a time; 0 from the end on.

    Between samples its square is linear, as under constant deceleration, so that the end is
    reached in finite time and at rest.
    """
    if not tau < profile.duration:
        return 0.0
    n = len(profile.rate)
    at = max(tau, 0.0) / profile.duration * (n - 1)
    i = min(int(at), n - 2)
    share = at - i
    here, next = profile.rate[i], profile.rate[i + 1]
    return math.sqrt((1.0 - share) * here * here + share * next * next)


@jit_no_refcount
def governed(reference: Reference, clock: CourseClock, pose: Pose, pace: PaceParams) -> Desired:
    """The desired pose, speed and yaw rate at the clock's time and rate, for the tracking law.

    u_d = rate ||S'|| and r_d = rate r_d(tau); at rate 0 the reference rests where it is. The
    heading is turned towards the path by atan(e_y / guide), e_y the cross-track error
    (line-of-sight guidance), so that a robot beside a waiting reference moves. It is at most a
    quarter turn from the robot's: (17) turns with the sine of the difference, which vanishes for a
    robot that faces the other way."""
    m = evaluate(reference.knots, reference.coeffs, clock.tau)
    spline = math.sqrt(m.vx * m.vx + m.vy * m.vy)
    if spline < 1e-9:
        return Desired(m.x, m.y, math.atan2(m.y - pose.y, m.x - pose.x), 0.0, 0.0)
    c, s = m.vx / spline, m.vy / spline
    beside = -s * (m.x - pose.x) + c * (m.y - pose.y)
    psi = math.atan2(m.vy, m.vx) + math.atan(beside / pace.guide)
    off = min(max(wrap(psi - pose.psi), -0.5 * math.pi), 0.5 * math.pi)
    rate = clock.rate if clock.tau < reference.knots[-1] else 0.0
    yaw = (m.vx * m.ay - m.vy * m.ax) / (spline * spline)
    return Desired(m.x, m.y, pose.psi + off, rate * spline, rate * yaw)


@jit_no_refcount
def govern(
    clock: CourseClock, pose: Pose, reference: Reference, profile: Profile, operator_leads: bool,
    pace: PaceParams, dt: float,
) -> CourseClock:  # fmt: skip
    """The clock one step of `dt` later.

    The rate follows the profile, less the robot is behind (from `slack` to `lag`, along the path)
    or turned away (up to `turn`), within `rise` and `fall`. While the operator leads, the
    reference waits at the nearest point ahead, and its rate is that of the robot's own progress, so
    that it continues at this speed on release; it never goes back. A pose that is not finite makes
    it wait."""
    sound = is_finite(pose.x) and is_finite(pose.y) and is_finite(pose.psi)
    target_rate = 0.0
    tau = clock.tau
    if sound and operator_leads:
        tau = nearest_ahead(reference, pose, tau, pace.search)
        progress = (tau - clock.tau) / dt if dt > 0.0 else clock.rate  # no time has passed
        target_rate = min(progress, allowed(profile, tau))
    elif sound:
        d = governed(reference, clock, pose, pace)
        m = evaluate(reference.knots, reference.coeffs, tau)
        spline = max(math.sqrt(m.vx * m.vx + m.vy * m.vy), 1e-9)
        behind = (m.vx * (m.x - pose.x) + m.vy * (m.y - pose.y)) / spline
        keeps_up = min(max((pace.lag - behind) / (pace.lag - pace.slack), 0.0), 1.0)
        aligned = min(max(2.0 - 2.0 * abs(wrap(d.psi - pose.psi)) / pace.turn, 0.0), 1.0)
        target_rate = allowed(profile, tau) * keeps_up * aligned
    rate = min(max(target_rate, clock.rate - pace.fall * dt), clock.rate + pace.rise * dt)
    rate = min(max(rate, 0.0), 1.0)
    if not operator_leads:
        tau = min(tau + rate * dt, reference.knots[-1])
    stands = rate < 0.02 and not operator_leads and tau < reference.knots[-1]
    return CourseClock(tau, rate, clock.waited + dt if stands else 0.0)


@jit_no_refcount
def nearest_ahead(reference: Reference, pose: Pose, tau: float, distance: float) -> float:
    """The time of the path's point nearest to the robot, from tau to `distance` metres ahead
    [s]."""
    end = reference.knots[-1]
    low, high = min(tau, end), min(tau + distance / reference.speed, end)
    best = low
    for _ in range(3):
        nearest = math.inf
        step = (high - low) / _SAMPLES
        for i in range(_SAMPLES + 1):
            t = low + step * i
            m = evaluate(reference.knots, reference.coeffs, t)
            square = (m.x - pose.x) * (m.x - pose.x) + (m.y - pose.y) * (m.y - pose.y)
            if square < nearest:
                nearest, best = square, t
        low, high = max(best - step, low), min(best + step, high)
    return best


def turned(pose: Pose) -> Pose:
    """The robot seen as driving the other way round; its nominal command is then
    `reversed_twist`."""
    return Pose(pose.x, pose.y, pose.psi + math.pi)


def reversed_twist(twist: Twist) -> Twist:
    """A nominal command made for `turned`, for the robot as it is; and the reverse."""
    return Twist(-twist.v, twist.omega)
