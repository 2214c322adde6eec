"""`movers`: fields of big, fast discs on key frames, after DynaBARN; `about` describes them."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.types import Floats
from cohelm.law.reference import Reference, through
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.setup import with_pilot
from cohelm.sim.world import Body, world
from cohelm.study.campaign import rectangle
from cohelm.study.campaign.episode import (
    Episode,
    EpisodeGoal,
    crossing,
    lively,
    reference_speed,
    sequence,
)

LENGTH, WIDTH = 14.0, 11.0
DENSITIES = {"easy": 4, "medium": 8, "hard": 14}
"""Discs in the hall."""
FASTEST = 2.0
"""Of a disc [m/s]."""
MAX_ACCELERATION = 1.0
"""Of a disc that sets off or stops [m/s^2]."""
APRON = 1.6
"""Beside the walls where the robot starts and arrives, kept free of discs [m]."""

_SPEED, _LIMIT, _NEAR = 0.8, 90.0, 0.3
_OFF, _SIDE = 0.8, 1.5  # of start and goal from the walls [m]
_APART = 2.0  # of key frames [m]
_SLOWEST = 0.4  # on a way [m/s]
_SINCE = 20.0  # they have been moving for up to so long when the robot sets off [s]


def case(seed: int, number: int, model: RobotModel | None = None) -> Episode:
    """Field `number` of the campaign with this seed. model: drives instead of Sally."""
    rng = sequence(seed, "movers", number)
    kind = tuple(DENSITIES)[number % len(DENSITIES)]
    model = model or robot("sally")
    off = _OFF + max(model.reach - robot("sally").reach, 0.0)
    speed = reference_speed(model, _SPEED)
    limit = _LIMIT * _SPEED / speed
    start = np.array([off, rng.uniform(_SIDE, WIDTH - _SIDE)])
    goal = np.array([LENGTH - off, rng.uniform(_SIDE, WIDTH - _SIDE)])
    discs = [_disc(rng, model.reach, limit) for _ in range(DENSITIES[kind])]
    setup = crossing(
        model, start, goal, through(np.linspace(start, goal, 13), speed),
        world((discs, rectangle.walls(LENGTH, WIDTH))),
        tuple(f"mover_{i}" for i in range(len(discs))), limit, number,
    )  # fmt: skip
    setup = with_pilot(setup, max_acceleration=MAX_ACCELERATION, gains=lively(setup.gains))
    there = EpisodeGoal(float(goal[0]), float(goal[1]), _NEAR)
    return Episode("movers", number, kind, setup, there, robot=model)


def _disc(rng: np.random.Generator, reach: float, limit: float) -> Body:
    """A disc whose path from key frame to key frame lasts longer than `limit` [s]."""
    radius = rng.uniform(0.25, 0.5)
    low = np.array([APRON, 0.1]) + radius
    high = np.array([LENGTH, WIDTH]) - low
    here = rng.uniform(low, high)
    row = (float(here[0]), float(here[1]), 0.0, 0.0, radius, radius + reach)
    since = rng.uniform(0.0, _SINCE)
    knots, coeffs = [0.0], np.empty((0, 8))
    while knots[-1] < limit + since + 1.0:
        there = rng.uniform(low, high)
        if math.dist(here, there) > _APART:
            times, pieces = leg(here, there, rng.uniform(_SLOWEST, FASTEST))
            knots += [knots[-1] + t for t in times]
            coeffs = np.vstack((coeffs, pieces))
            here = there
    return Body(row, Reference(np.array(knots), coeffs, 1.0), -since)


def leg(a: Floats, b: Floats, speed: float) -> tuple[list[float], Floats]:
    """From rest at a to rest at b: when it is as fast as it gets, when it brakes, when it is there
    [s], and the three pieces, (3, 8)."""
    length = math.dist(a, b)
    ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    v = min(speed, math.sqrt(MAX_ACCELERATION * length))
    ramp, cruise = v / MAX_ACCELERATION, length / v - v / MAX_ACCELERATION
    pieces = np.zeros((3, 8))
    for k, (s, u, push) in enumerate(
        (
            (0.0, 0.0, MAX_ACCELERATION),
            (0.5 * v * ramp, v, 0.0),
            (0.5 * v * ramp + v * cruise, v, -MAX_ACCELERATION),
        )
    ):
        pieces[k] = (
            0.0, 0.5 * push * ux, u * ux, a[0] + s * ux,
            0.0, 0.5 * push * uy, u * uy, a[1] + s * uy,
        )  # fmt: skip
    return [ramp, ramp + cruise, 2.0 * ramp + cruise], pieces
