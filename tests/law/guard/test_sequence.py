"""The promise itself, over whole drives: whoever holds the stick, nothing is touched."""

import math

import numpy as np
import pytest

from cohelm.core.obstacles import Surroundings
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard.step import guard
from cohelm.law.guard.surroundings import surroundings
from tests.few import first
from tests.law.guard.scenes import (
    HERE,
    JACKAL_LIMITS,
    REST,
    RULES,
    SALLY,
    SALLY_LIMITS,
    clearances,
    guard_step,
    inside_limits,
    moved,
)

JACKAL = np.array([[0.21, 0.165], [-0.21, 0.165], [-0.21, -0.165], [0.21, -0.165]])
ROBOTS = {"sally": (SALLY, SALLY_LIMITS), "jackal": (JACKAL, JACKAL_LIMITS)}
MAX_ACCELERATION, WALK = 1.0, 1.3
FINE = 4
"""Looks in one control step."""


def scene(rng: np.random.Generator, outline: np.ndarray, walkers: int) -> Surroundings:
    """Discs, walls and points all round a robot at the origin, walkers further off."""

    def draw(make):
        while True:
            one = make()
            if clearances(outline, HERE, one).min() > 0.05:
                return one

    xy = lambda far: rng.uniform(-far, far, 2)  # noqa: E731
    still = [draw(lambda: surroundings([disc(*xy(3), rng.uniform(0.03, 0.4))])) for _ in range(10)]
    walls = [draw(lambda: surroundings(segments=[rng.uniform(-3, 3, 4)])) for _ in range(3)]
    points = [draw(lambda: surroundings(points=[xy(3)])) for _ in range(20)]
    rows = [s.discs[0] for s in still]
    for _ in range(walkers):
        course, far = rng.uniform(-math.pi, math.pi), rng.uniform(2.0, 6.0)
        vx, vy = WALK * np.array([math.cos(course), math.sin(course)])
        rows.append(
            np.array([far * math.cos(course + 3), far * math.sin(course + 3), vx, vy, 0.25, 0])
        )
    return surroundings(
        np.array(rows), [0.0] * 10 + [MAX_ACCELERATION] * walkers,
        np.concatenate([s.segments for s in walls]), np.concatenate([s.points for s in points]),
    )  # fmt: skip


def attack(kind: str, rng: np.random.Generator, pose: Pose, nominal: Twist, around: Surroundings):
    """What the person asks next: bang-bang, at the nearest thing, or spinning and lunging."""
    if kind == "bang" and rng.random() < 0.05:
        return Twist(rng.choice([-1.5, 0.0, 1.5]), rng.uniform(-3, 3))
    if kind == "ram":
        there = np.concatenate([around.discs[:, :2], around.points])
        away = there - [pose.x, pose.y]
        dx, dy = away[np.argmin(np.hypot(*away.T))]
        turn = math.remainder(math.atan2(dy, dx) - pose.psi, 2 * math.pi)
        return Twist(1.5 * math.cos(turn), 3.0 * math.sin(turn))
    if kind == "spin" and rng.random() < 0.04:
        return Twist(rng.choice([-1.5, 0.1, 1.5]), rng.choice([-3.0, 0.0, 3.0]))
    return nominal


def walk(rng: np.random.Generator, around: Surroundings, pose: Pose, dt: float) -> None:
    """Whoever can, accelerates as hard as assumed: half of the time at the robot."""
    d = around.discs
    for i in np.flatnonzero(around.max_acceleration):
        turn = math.atan2(pose.y - d[i, 1], pose.x - d[i, 0])
        turn = turn if rng.random() < 0.5 else rng.uniform(-math.pi, math.pi)
        push = MAX_ACCELERATION * np.array([math.cos(turn), math.sin(turn)])
        if np.hypot(*(d[i, 2:4] + push * dt)) > WALK:
            push[:] = 0.0
        d[i, :2] += d[i, 2:4] * dt + 0.5 * push * dt * dt
        d[i, 2:4] += push * dt


def drive(
    seed: int, robot: str, kind: str, walkers: int, steps: int, planned: bool = False
) -> tuple[float, float]:
    """Smallest gap to what rests, and to walkers while the robot moves."""
    outline, lim = ROBOTS[robot]
    rng = np.random.default_rng(seed)
    around = scene(rng, outline, walkers)
    pose, before, nominal = HERE, REST, REST
    still, moving = math.inf, math.inf
    who = np.zeros(len(around.discs) + len(around.segments) + len(around.points), dtype=bool)
    who[: len(around.discs)] = around.max_acceleration > 0.0
    for _ in range(steps):
        nominal = attack(kind, rng, pose, nominal, around)
        got = guard(pose, before, nominal, around, outline, lim, RULES, planned)
        after = got.twist
        assert inside_limits(after, before, lim, RULES.dt)
        before = after
        for _ in range(FINE):
            pose = moved(pose, before, RULES.dt / FINE)
            walk(rng, around, pose, RULES.dt / FINE)
            now = clearances(outline, pose, around)
            still = min(still, now[~who].min())
            if before != REST and walkers:
                moving = min(moving, now[who].min())
    return still, moving


@pytest.mark.parametrize(
    ("robot", "planned"),
    first([("sally", False), ("sally", True), ("jackal", True), ("jackal", False)], 3),
)
@pytest.mark.parametrize("kind", ["bang", "ram", "spin"])
@pytest.mark.parametrize("walkers", [0, 4])
def test_no_stick_motion_reaches_an_obstacle(robot, kind, walkers, planned):
    still, moving = drive(walkers, robot, kind, walkers, 400, planned)
    assert still >= RULES.hard_margin / 2
    assert moving >= RULES.hard_margin / 2


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", ["bang", "ram", "spin"])
@pytest.mark.parametrize("walkers", [0, 4])
@pytest.mark.parametrize("planned", [False, True])
def test_no_stick_motion_reaches_an_obstacle_in_many_drives(robot, kind, walkers, planned):
    for seed in range(40):
        still, moving = drive(seed, robot, kind, walkers, 1000, planned)
        assert still >= RULES.hard_margin / 2, seed
        assert moving >= RULES.hard_margin / 2, seed


@pytest.mark.parametrize("start", [0.02, 0.012, 0.009])
def test_no_patience_creeps_up_on_a_wall(start):
    """The attacker tries every way and takes what leaves the smallest gap, 300 times over."""
    x = 0.36 + start
    wall = surroundings(segments=[[x, -3.0, x, 3.0]])
    pose, before, least = HERE, REST, math.inf
    tries = [Twist(v, o) for v in (-0.1, 0.003, 0.1) for o in (-0.5, -0.2, 0.0, 0.2, 0.5)]
    for _ in range(300):
        ways = [guard_step(pose, before, nominal, wall, SALLY, SALLY_LIMITS) for nominal in tries]
        commands = [way.twist for way in ways]
        before = min(commands, key=lambda c: x - bow(moved(pose, c, RULES.dt)))
        pose = moved(pose, before, RULES.dt)
        least = min(least, x - bow(pose))
    assert least >= RULES.hard_margin / 2


def bow(pose: Pose) -> float:
    """How far forward Sally's outline lies at a pose."""
    corners = SALLY @ np.array([math.cos(pose.psi), -math.sin(pose.psi)])
    return pose.x + float(corners.max())
