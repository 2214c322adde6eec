"""One episode, ready to be driven under any law: world, goal and operator."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from cohelm.core.row import blank
from cohelm.core.trace import Trace
from cohelm.core.types import Floats, Pose
from cohelm.law.gains import Gains
from cohelm.law.guard.rules import Rules
from cohelm.law.reference import Reference
from cohelm.robot.limits import speeds
from cohelm.robot.model import RobotModel
from cohelm.scenario import load
from cohelm.sim import adversarial
from cohelm.sim.adversarial import SCRIPT, AdversarialScene, Attack, rollout
from cohelm.sim.heights import Heights
from cohelm.sim.run import pieces
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import World

LAWS: tuple[str, ...] = ("guard", "paper", "none", "rvo", "vo")
"""Under which an episode may be driven: the guard, the paper's barrier, no filter at all, and
two controllers of a peer, ir-sim: reciprocal velocity obstacles, and plain ones."""

PLANTS: tuple[str, ...] = ("kinematic", "twin", "twin-rear", "twin-all-round")
"""The plant: exact arcs and true obstacles; or the physics twin with its own sensors alone: the
robot's LiDAR as it is, a second one at the back, or one all round."""

DT = 0.02
"""Control step of every campaign [s]."""

_PIECE = 100
"""Steps after which a drive looks up whether it has arrived: 2 s."""


@dataclass(frozen=True)
class EpisodeGoal:
    """Where an episode ends well."""

    x: float
    y: float
    near: float
    """[m]"""
    optimal: float = math.nan
    """The BARN challenge's OT [s], where there is one."""


@dataclass(frozen=True)
class AdversarialRollout:
    """An attacker alone with the filter, at its usual care; see `sim.adversarial`."""

    scene: AdversarialScene
    attack: Attack

    def scripted(self, script: Floats, hold: float) -> AdversarialRollout:
        """The same with deflections (k, 2) from a table, each held for `hold` [s]."""
        return replace(self, attack=Attack(SCRIPT, self.attack.seed, script, hold))


class Load(NamedTuple):
    """What the robot really does from a moment on, by what it carries."""

    since: float
    """[s]"""
    brakes: float
    """Largest acceleration of a wheel [m/s^2]; the robot's file states the least there is."""
    delay: float
    """From a command to the wheels [s]; it states the largest."""


@dataclass(frozen=True)
class Uneven:
    """A world with heights, and the operator in it."""

    heights: Heights
    wheels: Floats
    """(k, 2), where the robot stands on the floor, in the body [m]: it falls where one of these
    has none."""
    loads: tuple[Load, ...]
    operator: str = ""
    """The operator, see `campaign.heights`; empty: none."""
    edges: Floats = field(default_factory=lambda: np.empty((0, 4)))
    """What the operator pushes at: sides of boxes and drops, (s, 4) [m]."""


@dataclass(frozen=True)
class Episode:
    """One episode of a suite.

    setup: world, robot, limits, reference, stick; its law is set by `under`. goal: None without
    one. rollout: None if a controller drives.
    """

    suite: str
    number: int
    kind: str
    """The kind of episode, in a few words; the report counts by it."""
    setup: Setup
    goal: EpisodeGoal | None
    rollout: AdversarialRollout | None = None
    plant: str = "kinematic"
    robot: RobotModel = field(default_factory=lambda: load.robot("sally"))
    """The robot that drives."""
    uneven: Uneven | None = None
    """Of the suite heights: its world and operator."""


def under(setup: Setup, law: str) -> Setup:
    """The setup with another law's filter, and nothing else changed.

    With the guard drives the pilot, as the suite has set it up, or else at its usual care.
    """
    if law == "guard":
        return setup if setup.pilot is not None else with_pilot(setup, gains=lively(setup.gains))
    return replace(setup, pilot=None, gains=setup.gains._replace(barrier=law == "paper"))


def lively(gains: Gains) -> Gains:
    """The gains of a suite that has no pilot of its own."""
    return gains._replace(k_psi=max(gains.k_psi, 2.0))


def traced(case: Episode, law: str, acted: Interventions) -> Iterator[Trace]:
    """The drive of a case, piece by piece, to its time limit.

    acted: where what gate and monitors did is counted, where there are any.
    """
    if case.rollout is not None and case.setup.twin is None:
        return iter((attacked(case, law),))
    setup = case.setup
    if case.rollout is None and case.uneven is None:
        setup = under(setup, law)
        if case.goal is not None:
            setup = replace(setup, near=case.goal.near)
        if setup.twin is None or setup.twin.known is None or setup.pilot is None:
            return pieces(setup, _PIECE)
    from cohelm.study.campaign import loop_run  # needs MuJoCo, which is an extra

    if case.uneven is not None:
        from cohelm.study.campaign.heights_run import UnevenRun

        run = UnevenRun(case, acted)
    elif case.rollout is not None:
        run = loop_run.Attacked(setup, acted, case.rollout.scene, case.rollout.attack)
    else:
        run = loop_run.Looped(setup, acted)
    return loop_run.stepped(run, _PIECE)


def attacked(case: Episode, law: str) -> Trace:
    """The trace of an adversarial rollout on exact arcs."""
    return _rollout(case, law, case.setup.steps)[0]


def least_clearance(case: Episode, law: str) -> float:
    """The smallest clearance while the robot moved [m], of a rollout without a trace."""
    return _rollout(case, law, 0)[1]


def _rollout(case: Episode, law: str, n: int) -> tuple[Trace, float]:
    """Trace and smallest clearance while the robot moved [m]. n: rows of the trace, all or none."""
    setup, chosen = case.setup, case.rollout
    assert chosen is not None
    m = len(chosen.scene.discs) + len(chosen.scene.points)
    made = Trace(
        blank(n), np.empty((n, m)), np.empty((n, m, 6)), tuple(f"thing_{i}" for i in range(m)), DT
    )
    code = {"guard": adversarial.GUARD, "paper": adversarial.PAPER}.get(law, adversarial.NO_LAW)
    least = rollout(
        setup.start, chosen.scene, chosen.attack, code, setup.gains, setup.outline, setup.limits,
        Rules(dt=DT), setup.steps, made.rows, made.h, made.discs,
    )  # fmt: skip
    return made, least


def reference_speed(robot: RobotModel, speed: float) -> float:
    """Speed of the reference for a robot, `speed` if it can [m/s]: a slower one is left a fifth of
    its own to catch up with."""
    return min(speed, 0.8 * speeds(robot.bounds())[0])


def sequence(seed: int, suite: str, number: int) -> np.random.Generator:
    """The random numbers of one episode: by the campaign's seed, the suite and its number only."""
    return np.random.default_rng([seed, number, *suite.encode()])


PAPER = Gains()


def crossing(
    robot: RobotModel, start: Sequence[float] | Floats, goal: Sequence[float] | Floats,
    reference: Reference, obstacles: World, names: tuple[str, ...], limit: float, number: int,
) -> Setup:  # fmt: skip
    """A robot looks from its start at the goal, both (2,) [m], and has until `limit` [s] to follow
    a reference there. names: of the discs. number: of the episode, its seed."""
    heading = math.atan2(goal[1] - start[1], goal[0] - start[0])
    return Setup(
        start=Pose(float(start[0]), float(start[1]), heading), reference=reference,
        outline=robot.outline, limits=robot.bounds(), gains=PAPER._replace(u_d=reference.speed),
        obstacles=obstacles, names=names, dt=DT, duration=limit, seed=number,
    )  # fmt: skip


@dataclass
class Interventions:
    """How often the second layer acted in a drive."""

    periods: int = 0
    gate: int = 0
    """Periods in which the gate passed another twist than it was given."""
    monitors: int = 0
    """... in which a monitor had slowed or stopped it before."""
    stops: int = 0
    """Stops and faults that the robot latched by itself; each had to be reset."""
    why: str = ""
    """The first of them."""

    def share(self, periods: int) -> float:
        """So many of all periods; NaN where there was neither gate nor monitor."""
        return periods / self.periods if self.periods else math.nan
