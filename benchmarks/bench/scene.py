"""The scenes that everyone is timed on: plain numbers, so that a peer can be given the same."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from cohelm.core.types import Desired, Floats, Pose, Stick, disc, discs
from cohelm.law.reference import through
from cohelm.law.step import step
from cohelm.robot.limits import unlimited
from cohelm.robot.model import RobotModel, shipped_path
from cohelm.sim.setup import Setup
from cohelm.sim.world import Body, world
from cohelm.study.campaign.episode import Episode
from cohelm.study.campaign.suites import suite

POSES = 64
"""Poses a step is timed at, in turn."""

RADIUS_M = 0.1
SAFE_M = 0.2  # Table II

_WAYPOINTS = [
    [0.0, -1.75], [0.0, -0.75], [0.0, 0.25], [0.0, 1.25], [0.0, 2.25], [0.0, 3.25],
    [0.75, 4.0], [2.0, 4.0], [4.0, 4.0], [6.0, 4.0], [8.0, 4.0], [10.0, 4.0],
]  # fmt: skip
_ON_THE_WAY = [(0.0, 0.0), (0.0, 1.0), (4.0, 4.0), (8.0, 4.0)]
_SPEED = 0.5  # [m/s]


@dataclass(frozen=True)
class Field:
    """A robot among n resting discs, at POSES places near one of them.

    wishes: (POSES, 2), what the filter is asked to pass, tau of (34) [m/s, rad/s]. shaped: share
    of the poses at which our filter acts.
    """

    discs: Floats
    poses: tuple[Pose, ...]
    desired: tuple[Desired, ...]
    wishes: Floats
    shaped: float

    @property
    def stick(self) -> Stick:
        """Nobody at the stick."""
        return Stick(0.0, 0.0)


def field(n: int, seed: int = 1) -> Field:
    """n discs at constant density (one per 4 m^2), the robot 0.35 to 0.9 m from one of them.

    The reference is 0.1 m ahead at 0.5 m/s, so that the wish is to drive on.
    """
    rng = np.random.default_rng(seed)
    side = math.ceil(math.sqrt(n))
    cells = rng.permutation(side * side)[:n]
    centres = 2.0 * np.column_stack((cells % side, cells // side)) + rng.uniform(-0.4, 0.4, (n, 2))
    rows = discs(*[disc(x, y, RADIUS_M, SAFE_M) for x, y in centres.tolist()])
    poses: list[Pose] = []
    for _ in range(POSES):
        x, y = centres[rng.integers(n)]
        away, bearing = rng.uniform(0.35, 0.9), rng.uniform(-math.pi, math.pi)
        psi = rng.uniform(-math.pi, math.pi)
        poses.append(
            Pose(float(x + away * math.cos(bearing)), float(y + away * math.sin(bearing)), psi)
        )
    desired = [
        Desired(p.x + 0.1 * math.cos(p.psi), p.y + 0.1 * math.sin(p.psi), p.psi, _SPEED, 0.0)
        for p in poses
    ]
    done = [step(p, d, Stick(0.0, 0.0), rows) for p, d in zip(poses, desired, strict=True)]
    return Field(
        discs=rows,
        poses=tuple(poses),
        desired=tuple(desired),
        wishes=np.array([[s.nominal_v, s.nominal_omega] for s in done]),
        shaped=float(np.mean([s.I > s.J for s in done])),
    )


def course(duration: float | None = None) -> Setup:
    """The start of the paper's path, by the robot of the paper, over four discs at rest on it."""
    bodies = [Body(disc(x, y, RADIUS_M, SAFE_M)) for x, y in _ON_THE_WAY]
    return Setup(
        start=Pose(0.0, -1.75, math.pi / 2),
        reference=through(_WAYPOINTS, _SPEED),
        outline=_sally().outline,
        limits=unlimited(_sally().track_m),
        obstacles=world((bodies, np.empty((0, 4)))),
        names=tuple(f"disc_{i + 1}" for i in range(len(bodies))),
        duration=duration,
    )


def guarded(few: bool) -> tuple[Episode, ...]:
    """Episodes of the suites lab and random, one each or three."""
    numbers = (1,) if few else (1, 2, 3)
    suites = [suite(name, 1, None) for name in ("lab", "random")]
    return tuple(each.case(number) for number in numbers for each in suites)


def _sally() -> RobotModel:
    text = Path(shipped_path("sally")).read_text(encoding="utf-8")
    return RobotModel.model_validate(yaml.safe_load(text))
