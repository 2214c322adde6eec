"""`adversary`: an operator tries to bring about a contact, alone with the filter; see `about`."""

from __future__ import annotations

import importlib
import math
import warnings
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.types import Floats, Pose, StickRecording, disc
from cohelm.law.reference import through
from cohelm.robot.clearance import disc_clearance, segment_clearance
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.sim.adversarial import BANG, RAM, SCRIPT, SPIN, AdversarialScene, Attack
from cohelm.sim.setup import Setup
from cohelm.sim.world import Body, world
from cohelm.study.campaign.episode import (
    DT,
    PAPER,
    AdversarialRollout,
    Episode,
    least_clearance,
    sequence,
)

SEARCH_EVERY = 500
"""One episode in so many is a search."""
EVALUATIONS = 2000
"""Sequences driven in one search."""

_LIMIT = 10.0  # [s]
_FIELD = 3.0  # half its side [m]
_CLEAR = 0.05  # round the robot at the start [m]
_HOLD = 0.5  # for which a searched deflection is held [s]
_MAX_ACCELERATION, _WALK = 1.0, 1.3
_HERE = Pose(0.0, 0.0, 0.0)
_KINDS = ("ram", "bang", "spin", "human")


def case(
    seed: int,
    number: int,
    recordings: tuple[StickRecording, ...] = (),
    search_every: int = SEARCH_EVERY,
    model: RobotModel | None = None,
) -> Episode:
    """Attack `number` of the campaign with this seed. recordings: of sticks, for *human*. model:
    is driven instead of Sally and Jackal."""
    rng = sequence(seed, "adversary", number)
    model = model or robot(("sally", "jackal")[number % 2])
    kind = _KINDS[number // 2 % (4 if recordings else 3)]
    if number % search_every == search_every - 1:
        kind = "search"
    scene = _scene(
        rng, model.outline, model.reach, walkers=number % 4 >= 2, wall_alongside=kind == "spin"
    )
    code = {"ram": RAM, "bang": BANG, "spin": SPIN}.get(kind, SCRIPT)
    script, hold = np.zeros((1, 2)), _LIMIT
    if kind == "human":
        script, hold = _flipped(rng, recordings[int(rng.integers(len(recordings)))]), DT
    drawn = [Body(tuple(row)) for row in scene.discs.tolist()]
    setup = Setup(
        start=_HERE,
        reference=through([[0.0, 0.0], [1.0, 0.0]], 1.0),
        outline=model.outline,
        limits=model.bounds(),
        gains=PAPER,
        obstacles=world((drawn, scene.walls)),
        dt=DT,
        duration=_LIMIT,
        seed=number,
    )
    attack = Attack(code, int(rng.integers(2**31)), script, hold)
    return Episode(
        "adversary", number, f"{kind}, {model.name}", setup, None,
        AdversarialRollout(scene, attack), robot=model,
    )  # fmt: skip


class WorstAttack(NamedTuple):
    """The worst that a search has found."""

    case: Episode
    """With the sequence found as its attack."""
    clearance: float
    """Smallest clearance while the robot moved [m]."""
    evaluations: int


def searched(case: Episode, law: str, evaluations: int = EVALUATIONS) -> WorstAttack:
    """CMA-ES (Hansen 2016) for the sequence of deflections with the smallest clearance.

    The same case and law give the same sequence. case: one with an adversarial rollout.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of optional parts of cma that are not there
        cma: Any = importlib.import_module("cma")
    rollout = case.rollout
    assert rollout is not None
    knots = round(_LIMIT / _HOLD)

    def attacked(x: Floats) -> Episode:
        script = np.clip(np.asarray(x, dtype=np.float64).reshape(knots, 2), -1.0, 1.0)
        return replace(case, rollout=rollout.scripted(script, _HOLD))

    options = {
        "seed": rollout.attack.seed % 2**30 + 1,
        "maxfevals": evaluations,
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 0.0,
        "tolfunhist": 0.0,
        "tolx": 0.0,
        "tolflatfitness": evaluations,
    }
    search = cma.CMAEvolutionStrategy(np.zeros(2 * knots), 0.7, options)
    worst: Floats = np.zeros(2 * knots)
    least, count = math.inf, 0
    while count < evaluations:
        tried: list[Floats] = search.ask()[: evaluations - count]
        clearances = [least_clearance(made, law) for made in map(attacked, tried)]
        count += len(tried)
        for x, clearance in zip(tried, clearances, strict=True):
            if clearance < least:
                worst, least = x, clearance
        if len(tried) < search.popsize:
            break
        search.tell(tried, clearances)
    return WorstAttack(attacked(worst), least, count)


def scripted(case: Episode, stick: list[float]) -> Episode:
    """The case with a sequence that a search found, as its row keeps it."""
    assert case.rollout is not None
    return replace(case, rollout=case.rollout.scripted(np.array(stick).reshape(-1, 2), _HOLD))


def _scene(
    rng: np.random.Generator, outline: Floats, reach: float, walkers: bool, wall_alongside: bool
) -> AdversarialScene:
    """Obstacles at random, but _CLEAR of the robot; `wall_alongside`: one wall runs along it."""
    discs: list[tuple[float, float, float, float, float, float]] = []
    walls: list[list[float]] = []
    points: list[list[float]] = []

    def place() -> tuple[float, float]:
        x, y = rng.uniform(-_FIELD, _FIELD, 2)
        return float(x), float(y)

    resting = int(rng.integers(4, 10))
    while len(discs) < resting:
        x, y, r = *place(), float(rng.uniform(0.03, 0.4))
        if disc_clearance(_HERE, outline, x, y, r) > _CLEAR:
            discs.append(disc(x, y, r, r + reach))
    if wall_alongside:
        y = float(outline[:, 1].max() + rng.uniform(0.02, 0.1)) * float(rng.choice([-1.0, 1.0]))
        walls.append([-2.0, y, 2.0, y])
    wanted = int(rng.integers(2, 5))
    while len(walls) < wanted:
        x, y = place()
        turn, length = rng.uniform(-math.pi, math.pi), rng.uniform(1.0, 4.0)
        wall = [x, y, x + length * math.cos(turn), y + length * math.sin(turn)]
        if segment_clearance(_HERE, outline, *wall) > _CLEAR:
            walls.append(wall)
    while len(points) < 10:
        x, y = place()
        if disc_clearance(_HERE, outline, x, y, 0.0) > _CLEAR:
            points.append([x, y])
    count = int(rng.integers(1, 4)) if walkers else 0
    for _ in range(count):
        bearing, far = rng.uniform(-math.pi, math.pi), rng.uniform(2.0, 5.0)
        at = (far * math.cos(bearing), far * math.sin(bearing))
        course, speed = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, _WALK)
        discs.append(disc(*at, 0.25, 0.25 + reach, speed * math.cos(course),
                          speed * math.sin(course)))  # fmt: skip
    max_acceleration = np.array([0.0] * resting + [_MAX_ACCELERATION] * count)
    return AdversarialScene(
        np.array(discs), max_acceleration, _WALK, np.array(walls), np.array(points)
    )


def _flipped(rng: np.random.Generator, recording: StickRecording) -> Floats:
    """Ten seconds of a recorded stick from anywhere in it, one axis or both with the sign
    flipped."""
    first, last = float(recording.times[0]), float(recording.times[-1])
    at = rng.uniform(first, max(last - _LIMIT, first)) + np.arange(0.0, _LIMIT, DT)
    signs = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))[int(rng.integers(3))]
    newest = np.clip(
        np.searchsorted(recording.times, at, side="right") - 1, 0, len(recording.times) - 1
    )
    return np.column_stack((signs[0] * recording.x[newest], signs[1] * recording.psi[newest]))
