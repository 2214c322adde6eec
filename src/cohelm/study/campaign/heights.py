"""`heights`: stairs, pits, table tops and low things, by a planar LiDAR and a depth camera.

`about` describes the suite. Its kinds, in every fourth episode one of them only:
- *stair*: 3 to 6 steps down, 0.15 to 0.19 m each and 0.28 m long, 1 to 2.5 m wide; *pit*: 0.4 to
  1.5 m long and wide, 0.3 to 1.5 m deep, every third without a bottom; *kerb*: ground 0.1 to 0.2 m
  lower, 1 to 2.5 m by 0.5 to 1.5 m; *dock*: along all of the north or the south wall, 0.5 to 1.2 m
  wide and 0.6 to 1.2 m deep;
- *table*: a top of 0.8 to 1.6 m by 0.6 to 0.9 m, 3 cm thick, 0.3 to 0.53 m high or, every third
  one, above the robot, and legs of 3 to 5 cm; *shelf*: hangs from nothing that is seen, 0.5 to 2 m
  by 0.2 to 0.5 m, 4 to 12 cm thick, from 0.24 to 0.5 m up; *low*: 0.1 to 1 m long and wide, 0.08 to
  0.17 m high, below the LiDAR's plane.
Brakes and delay lie between what the robot's file states, which is the worst, and twice the brakes
and a third of the delay.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from cohelm.core.types import Floats
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.heights import Heights, between, box, drop, edges
from cohelm.sim.setup import Twinned, with_pilot
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.world import world
from cohelm.study.campaign import rectangle
from cohelm.study.campaign.episode import (
    PAPER,
    Episode,
    EpisodeGoal,
    Load,
    Uneven,
    crossing,
    lively,
    sequence,
)
from cohelm.study.campaign.heights_run import with_depth_camera

ROBOT = "sally-depth"
WAY, CLEAR = 1.6, 1.3
"""Width of the way from start to goal, and clearance of both [m]."""
WHEELS: Floats = np.array(
    [[0.0, 0.25], [0.0, -0.25], [0.3, 0.22], [0.3, -0.22], [-0.3, 0.22], [-0.3, -0.22]]
)
"""Where it stands on the floor, in the body [m]."""
HANDS = ("", "shared", "", "back", "ram", "", "spin", "shared", "back", "bang")
"""The operator, in turns; `shared` is one that pushes while the controller drives."""

_DROPS, _BOXES = ("stair", "pit", "kerb", "dock"), ("table", "shelf", "low")
_SPEED, _LIMIT, _ATTACK, _NEAR, _OFF = 0.6, 60.0, 15.0, 0.4, 1.3
_LIDAR = 0.20  # height of its plane [m]


def case(seed: int, number: int) -> Episode:
    """World `number` of the campaign with this seed."""
    rng = sequence(seed, "heights", number)
    base, operator = _robot(), HANDS[number % len(HANDS)]
    model, carries = _loaded(base, rng, number)
    wide = WAY + 2.0 * (model.reach - base.reach)
    kinds = (*_DROPS, *_BOXES)
    while True:
        length, width = rng.uniform(8.0, 10.0), rng.uniform(6.0, 7.0)
        start = np.array([_OFF, rng.uniform(_OFF, width - _OFF)])
        goal = np.array([length - _OFF, rng.uniform(_OFF, width - _OFF)])
        one = kinds[int(rng.integers(len(kinds)))] if number % 4 == 3 else ""
        heights = _obstacles_and_drops(rng, one, length, width)
        if _way(heights, length, width, start, goal, 0.5 * wide):
            break
    walls = rectangle.walls(length, width)
    body = between(heights.boxes, 0.0, model.height_m)
    plane = between(heights.boxes, _LIDAR, _LIDAR)
    manual = operator not in ("", "shared")
    setup = crossing(
        model, start, goal, rectangle.straight(start, goal, _SPEED),
        world(([], np.vstack((walls, edges(body))))), (), _ATTACK if manual else _LIMIT, number,
    )  # fmt: skip
    barred, near = np.vstack((walls, edges(plane))), 0.0 if manual else _NEAR
    setup = replace(setup, barred=barred, near=near)
    if manual:
        anywhere = setup.start._replace(psi=float(rng.uniform(-math.pi, math.pi)))
        setup = replace(setup, start=anywhere)
    gains = PAPER._replace(u_d=setup.limits.speed) if manual else lively(setup.gains)
    setup = with_pilot(setup, lidars=model.lidars, gains=gains)
    setup = replace(setup, twin=Twinned(model, TwinModel(odometry_distance_error=0.015)))
    uneven = Uneven(
        heights, WHEELS, _loads(rng, model, number), "ram" if operator == "shared" else operator,
        np.vstack((edges(body), edges(heights.drops))),
    )  # fmt: skip
    return Episode(
        "heights", number, f"{operator or 'controller'}, {one or 'mixed'}, {carries}",
        setup,
        None if manual else EpisodeGoal(float(goal[0]), float(goal[1]), _NEAR),
        plant="twin", robot=base, uneven=uneven,
    )  # fmt: skip


@cache
def _robot() -> RobotModel:
    return with_depth_camera(robot(ROBOT))


def _loaded(base: RobotModel, rng: np.random.Generator, number: int) -> tuple[RobotModel, str]:
    """The robot as its file states it with a load, and what that is."""
    front, half = 0.36, 0.29
    if number % 3 < 2:
        return base, "load within"
    side, tail = rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.25)
    y, x = half + side, front + tail
    outline = [[front, y], [-x, y], [-x, -y], [front, -y]]
    return base.model_copy(update={"footprint_m": outline}), "load beyond"


def _loads(rng: np.random.Generator, model: RobotModel, number: int) -> tuple[Load, ...]:
    worst = model.limits.wheel_acceleration_mps2 or 1.0

    def drawn(since: float) -> Load:
        share = float(rng.uniform(0.0, 1.0))  # of the heaviest
        return Load(since, worst * (2.0 - share), model.delay_s * (1.0 + 2.0 * share) / 3.0)

    loads = [drawn(0.0)]
    if number % 2:
        loads.append(drawn(float(rng.uniform(3.0, 12.0))))
    return tuple(loads)


def _obstacles_and_drops(
    rng: np.random.Generator, only: str, length: float, width: float
) -> Heights:  # fmt: skip
    """What stands, hangs and falls away; only: things of this kind."""
    boxes: list[list[float]] = []
    drops: list[list[float]] = []
    kinds = (*_DROPS, *_BOXES)
    for _ in range(int(rng.integers(2, 6))):
        kind = only or kinds[int(rng.integers(len(kinds)))]
        x, y = rng.uniform(1.0, length - 1.0), rng.uniform(0.0, width)
        yaw = float(rng.uniform(-math.pi, math.pi))
        if kind in _DROPS:
            drops += _drop(rng, kind, x, y, yaw, length, width)
        else:
            boxes += _box(rng, kind, x, y, yaw)
    return Heights(np.array(boxes).reshape(-1, 8), np.array(drops).reshape(-1, 7))


def _drop(
    rng: np.random.Generator, kind: str, x: float, y: float, yaw: float, length: float,
    width: float,
) -> list[list[float]]:  # fmt: skip
    if kind == "pit":
        a, b = rng.uniform(0.4, 1.5, 2)
        depth = 50.0 if rng.random() < 1.0 / 3.0 else float(rng.uniform(0.3, 1.5))
        return [drop(x, y, yaw, a, b, depth)]
    if kind == "kerb":
        return [
            drop(x, y, yaw, rng.uniform(1.0, 2.5), rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.2))
        ]
    if kind == "dock":
        deep, wide = float(rng.uniform(0.6, 1.2)), float(rng.uniform(0.5, 1.2))
        at = 0.5 * wide if rng.random() < 0.5 else width - 0.5 * wide
        return [drop(0.5 * length, at, 0.0, length, wide, deep)]
    rise, wide, run = float(rng.uniform(0.15, 0.19)), float(rng.uniform(1.0, 2.5)), 0.28
    return [
        drop(x + run * k * math.cos(yaw), y + run * k * math.sin(yaw), yaw, run, wide,
             rise * (k + 1))
        for k in range(int(rng.integers(3, 7)))
    ]  # fmt: skip


def _box(
    rng: np.random.Generator, kind: str, x: float, y: float, yaw: float
) -> list[list[float]]:  # fmt: skip
    if kind == "low":
        a, b = rng.uniform(0.1, 1.0, 2)
        return [box(x, y, yaw, a, b, 0.0, rng.uniform(0.08, 0.17))]
    if kind == "shelf":
        low, thick = float(rng.uniform(0.24, 0.5)), float(rng.uniform(0.04, 0.12))
        return [box(x, y, yaw, rng.uniform(0.5, 2.0), rng.uniform(0.2, 0.5), low, low + thick)]
    a, b = float(rng.uniform(0.8, 1.6)), float(rng.uniform(0.6, 0.9))
    top = float(rng.uniform(0.66, 0.8) if rng.random() < 1.0 / 3.0 else rng.uniform(0.3, 0.53))
    leg, c, s = float(rng.uniform(0.03, 0.05)), math.cos(yaw), math.sin(yaw)
    made = [box(x, y, yaw, a, b, top - 0.03, top)]
    for i in (-1.0, 1.0):
        for j in (-1.0, 1.0):
            u, v = i * (0.5 * a - leg), j * (0.5 * b - leg)
            made.append(box(x + c * u - s * v, y + s * u + c * v, yaw, leg, leg, 0.0, top))
    return made


def clearances(heights: Heights, x: Floats, y: Floats, high: float) -> Floats:
    """From points (any shape) to the nearest box below `high`, or drop; 0 within [m]."""
    found: Floats = np.full(np.shape(x), math.inf)
    for row in (*between(heights.boxes, 0.0, high), *heights.drops):
        wx, wy, c, s = x - row[0], y - row[1], row[2], row[3]
        along = np.maximum(np.abs(c * wx + s * wy) - row[4], 0.0)
        across = np.maximum(np.abs(-s * wx + c * wy) - row[5], 0.0)
        found = np.minimum(found, np.hypot(along, across))
    return found


def _way(
    heights: Heights, length: float, width: float, start: Floats, goal: Floats, radius: float
) -> bool:
    """Whether a circle can be rolled from start to goal, both of them clear."""
    high = _robot().height_m
    x, y = np.array((start, goal)).T
    if np.min(clearances(heights, x, y, high)) < CLEAR:
        return False
    x, y, clear = rectangle.places(length, width)
    clear = np.minimum(clear, clearances(heights, x, y, high))
    return rectangle.leads(clear, start, goal, radius)
