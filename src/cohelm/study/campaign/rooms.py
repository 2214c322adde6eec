"""`random`: rooms with resting and walking discs, from one wall to the other; see `about`."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.types import Floats
from cohelm.law.reference import Reference, through
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.world import Body, world
from cohelm.study.campaign import rectangle
from cohelm.study.campaign.episode import Episode, EpisodeGoal, crossing, reference_speed, sequence

WAY = 1.1
"""Width of the way that every room has [m]; Sally turns on the spot within 0.93 m."""
FASTEST = 1.2
"""Of a walker [m/s]."""
MAX_ACCELERATION = 1.0
"""Largest acceleration of a walker [m/s^2]."""
SPEED = 0.5
"""Of the reference, at most [m/s]."""
NEAR = 0.3
LIMIT = 120.0

_OFF, _CLEAR = 1.2, 0.9  # of start and goal from their walls, and from resting discs [m]


def case(seed: int, number: int, model: RobotModel | None = None) -> Episode:
    """Room `number` of the campaign with this seed. model: drives instead of Sally."""
    rng = sequence(seed, "random", number)
    model = model or robot("sally")
    larger = max(model.reach - robot("sally").reach, 0.0)
    off, way, speed = _OFF + larger, WAY + 2.0 * larger, reference_speed(model, SPEED)
    while True:
        length, width = rng.uniform(10.0, 13.0), rng.uniform(6.0, 8.0)
        start = np.array([off, rng.uniform(off, width - off)])
        goal = np.array([length - off, rng.uniform(off, width - off)])
        resting = _resting(rng, length, width, start, goal, _CLEAR + larger)
        if has_way(resting, length, width, start, goal, 0.5 * way):
            break
    reach, limit = model.reach, LIMIT * SPEED / speed
    discs = [Body((x, y, 0.0, 0.0, r, r + reach)) for x, y, r in resting.tolist()]
    walkers = [_walker(rng, length, width, start, reach, limit) for _ in range(rng.integers(2, 6))]
    setup = crossing(
        model, start, goal, rectangle.straight(start, goal, speed),
        world(([*discs, *walkers], rectangle.walls(length, width))),
        (*(f"disc_{i}" for i in range(len(discs))),
         *(f"walker_{i}" for i in range(len(walkers)))), limit, number,
    )  # fmt: skip
    kind = f"{len(walkers)} walkers"
    there = EpisodeGoal(float(goal[0]), float(goal[1]), NEAR)
    return Episode("random", number, kind, setup, there, robot=model)


def _resting(
    rng: np.random.Generator, length: float, width: float, start: Floats, goal: Floats, clear: float
) -> Floats:
    """Resting discs as rows of x, y, radius, none nearer to start or goal than `clear` [m]."""
    found: list[tuple[float, float, float]] = []
    wanted = int(rng.integers(6, 15))
    while len(found) < wanted:
        x, y, r = rng.uniform(0.0, length), rng.uniform(0.0, width), rng.uniform(0.1, 0.5)
        if min(math.dist((x, y), start), math.dist((x, y), goal)) > r + clear:
            found.append((x, y, r))
    return np.array(found)


def has_way(
    discs: Floats, length: float, width: float, start: Floats, goal: Floats, radius: float
) -> bool:
    """Whether a circle can be rolled from start to goal between discs (x, y, r) and the walls."""
    x, y, clear = rectangle.places(length, width)
    for cx, cy, r in discs:
        clear = np.minimum(clear, np.sqrt((x - cx) ** 2 + (y - cy) ** 2) - r)
    return rectangle.leads(clear, start, goal, radius)


def _walker(
    rng: np.random.Generator, length: float, width: float, start: Floats, reach: float, limit: float
) -> Body:
    """A walker whose spline is within its bounds, and lasts longer than the episode."""
    radius, speed = rng.uniform(0.2, 0.3), rng.uniform(0.2, 0.8)
    low, high = np.full(2, radius), np.array([length, width]) - radius
    while True:
        points = rng.uniform(low, high, (1, 2))
        if math.dist(points[0], start) > 2.0:
            break
    path = None
    while path is None or path.duration < limit + 1.0:
        more = np.vstack((points, rng.uniform(low, high, (20, 2))))
        hops = np.hypot(*np.diff(more, axis=0).T)
        points = more[np.concatenate(([True], hops > 1.5))]
        path = fitted(points, speed, FASTEST, MAX_ACCELERATION)
    row = (float(points[0, 0]), float(points[0, 1]), 0.0, 0.0, radius, radius + reach)
    return Body(row, path)


def fitted(points: Floats, speed: float, fastest: float, max_acceleration: float) -> Reference:
    """The spline through points at a speed, slowed so that it fits the bounds everywhere."""
    path = through(points, speed)
    top, push = extremes(path)
    slower = max(top / fastest, math.sqrt(push / max_acceleration), 1.0)
    return path if slower == 1.0 else through(points, speed / slower)


def extremes(path: Reference) -> tuple[float, float]:
    """Largest speed and acceleration of a path of cubics [m/s, m/s^2].

    Acceleration is linear within a piece, so its largest is at a knot; speed is looked at 16
    times within each.
    """
    c, length = path.coeffs, np.diff(path.knots)
    ends = [
        np.hypot(6.0 * c[:, 0] * s + 2.0 * c[:, 1], 6.0 * c[:, 4] * s + 2.0 * c[:, 5])
        for s in (np.zeros(len(c)), length)
    ]
    s = np.linspace(0.0, 1.0, 17)[:, None] * length
    vx = (3.0 * c[:, 0] * s + 2.0 * c[:, 1]) * s + c[:, 2]
    vy = (3.0 * c[:, 4] * s + 2.0 * c[:, 5]) * s + c[:, 6]
    return float(np.hypot(vx, vy).max()), float(np.max(ends))
