"""What the guard's tests draw, and the tests' own geometry (shapely) to judge it by."""

import math

import numpy as np
import shapely
from hypothesis import strategies as st

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.step import Guarded, guard
from cohelm.law.guard.surroundings import surroundings
from cohelm.robot.achievable import achievable
from cohelm.robot.limits import Limits

SALLY = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
SALLY_LIMITS = Limits(1.0, math.inf, 2.0, math.inf, 1.2, 2.0, 0.5)
JACKAL_LIMITS = Limits(2.0, 20.0, 4.0, 25.0, math.inf, math.inf, 0.376)
HERE, REST = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)
RULES = Rules()


def guard_step(
    pose: Pose, before: Twist, nominal: Twist, around: Surroundings, outline: np.ndarray,
    limits: Limits, rules: Rules = RULES,
) -> Guarded:  # fmt: skip
    """One step of the guard."""
    return guard(pose, before, nominal, around, outline, limits, rules, False)


sizes = st.floats(0.05, 0.6)
angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-3.0, 3.0).map(lambda x: round(x, 4))  # to a tenth of a millimetre
wishes = st.builds(Twist, st.floats(-2.5, 2.5), st.floats(-5.0, 5.0))


@st.composite
def outlines(draw: st.DrawFn) -> np.ndarray:
    """Convex, 3 to 8 corners on an ellipse; the origin often outside, as on a tractor's hitch."""
    k = draw(st.integers(3, 8))
    steps = np.cumsum([draw(st.floats(0.2, 1.0)) for _ in range(k)])
    turn = draw(angles) + 2.0 * math.pi * steps / steps[-1]
    corners = np.c_[draw(sizes) * np.cos(turn), draw(sizes) * np.sin(turn)]
    return corners + draw(st.sampled_from([(0.0, 0.0), (0.0, 0.0), (0.25, 0.0), (-0.7, 0.1)]))


@st.composite
def limits(draw: st.DrawFn) -> Limits:
    """Braking within 2 s, as a robot's would be; now and then no limit of one kind."""
    speed, yaw = st.floats(0.3, 2.0), st.floats(0.5, 4.0)
    maybe = st.booleans()
    inf = math.inf
    wheels = draw(maybe)
    body = not wheels or draw(maybe)
    return Limits(
        draw(speed),
        draw(st.floats(1.0, 20.0)) if body else inf,
        draw(yaw),
        draw(st.floats(2.0, 25.0)) if body else inf,
        draw(speed) if draw(maybe) else inf,
        draw(st.floats(1.0, 20.0)) if wheels else inf,
        draw(st.floats(0.2, 0.7)),
    )


@st.composite
def twists(draw: st.DrawFn, lim: Limits) -> Twist:
    """A twist within the speed limits."""
    return achievable(draw(wishes), REST, lim, 1e6)


@st.composite
def still_things(draw: st.DrawFn) -> Surroundings:
    discs = [
        disc(draw(lengths), draw(lengths), draw(st.floats(0.0, 0.5)))
        for _ in range(draw(st.integers(0, 4)))
    ]
    walls = [[draw(lengths) for _ in range(4)] for _ in range(draw(st.integers(0, 3)))]
    points = [[draw(lengths) for _ in range(2)] for _ in range(draw(st.integers(0, 6)))]
    return surroundings(np.array(discs).reshape(-1, 6), None, walls, points)


def placed(outline: np.ndarray, pose: Pose) -> shapely.Polygon:
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    return shapely.Polygon(outline @ np.array([[c, s], [-s, c]]) + [pose.x, pose.y])


def things(around: Surroundings) -> tuple[np.ndarray, np.ndarray]:
    """All as shapely points and lines, and their radii."""
    discs = shapely.points(around.discs[:, :2])
    walls = shapely.linestrings(around.segments.reshape(-1, 2, 2))
    points = shapely.points(around.points)
    radii = np.zeros(len(discs) + len(walls) + len(points))
    radii[: len(discs)] = around.discs[:, 4]
    return np.concatenate([discs, walls, points]), radii


def clearances(outline: np.ndarray, pose: Pose, around: Surroundings) -> np.ndarray:
    """Gap to each thing; overlap is 0 here for what has no radius."""
    shapes, radii = things(around)
    return shapely.distance(placed(outline, pose), shapes) - radii


def beyond(outline: np.ndarray, around: Surroundings, clearance: float) -> Surroundings:
    """Only those things that the robot at the origin has further off than `clearance`."""
    keep = clearances(outline, HERE, around) > clearance
    d, w = len(around.discs), len(around.discs) + len(around.segments)
    return Surroundings(
        around.discs[keep[:d]], around.max_acceleration[keep[:d]], around.velocity_error[keep[:d]],
        around.segments[keep[d:w]], around.points[keep[w:]],
    )  # fmt: skip


def moved(pose: Pose, twist: Twist, t: float) -> Pose:
    """Holding a twist, by complex numbers: the chord is the integral of exp(i psi)."""
    turn = twist.omega * t
    if abs(turn) < 1e-6:
        chord = twist.v * t * complex(math.cos(pose.psi + turn / 2), math.sin(pose.psi + turn / 2))
    else:
        chord = (
            twist.v / twist.omega * -1j * (np.exp(1j * (pose.psi + turn)) - np.exp(1j * pose.psi))
        )
    return Pose(pose.x + chord.real, pose.y + chord.imag, pose.psi + turn)


def braking(twist: Twist, lim: Limits, dt: float) -> list[Twist]:
    """The twists of a full stop: each step takes off what the tightest acceleration allows."""
    rim = abs(twist.v) + lim.track / 2 * abs(twist.omega)
    steps = max(
        abs(twist.v) / lim.acceleration, abs(twist.omega) / lim.yaw_acceleration,
        rim / lim.wheel_acceleration,
    ) / dt  # fmt: skip
    shares = [1.0 - k / steps for k in range(1, math.ceil(steps - 1e-9))] if steps > 0 else []
    return [Twist(twist.v * share, twist.omega * share) for share in shares]


def inside_limits(after: Twist, before: Twist, lim: Limits, dt: float) -> bool:
    """Every bound, to the last digit."""
    half = lim.track / 2
    change = lim.wheel_acceleration * dt
    left = (after.v - half * after.omega) - (before.v - half * before.omega)
    right = (after.v + half * after.omega) - (before.v + half * before.omega)
    return (
        abs(after.v) <= lim.speed
        and abs(after.omega) <= lim.yaw_rate
        and abs(after.v) + half * abs(after.omega) <= lim.wheel_speed
        and abs(after.v - before.v) <= lim.acceleration * dt
        and abs(after.omega - before.omega) <= lim.yaw_acceleration * dt
        and abs(left) <= change
        and abs(right) <= change
    )
