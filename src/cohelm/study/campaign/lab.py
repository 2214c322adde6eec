"""`lab`: the paper's lab with the robot's real outline and wheels; `about` describes it."""

from __future__ import annotations

from dataclasses import replace

from cohelm.scenario import build, load
from cohelm.scenario.model import Scenario
from cohelm.sim.setup import REACHED, Setup
from cohelm.study.campaign.episode import DT, Episode, EpisodeGoal, sequence


def scenario(name: str = "lab-guard") -> Scenario:
    """A shipped scenario at the campaign's control step."""
    return load.scenario(name, [f"simulation.step_s={DT}"])


def case(base: Scenario, seed: int, number: int) -> Episode:
    """Course `number` of the campaign with this seed. base: from `scenario`."""
    setup = build.setup(base if number == 0 else _varied(base, seed, number))
    kind = "as shipped" if number == 0 else "varied"
    return Episode("lab", number, kind, limited(setup, 2.0), goal(setup))


def limited(setup: Setup, times: float) -> Setup:
    """With so many times the reference's duration to drive it, and no text of a scenario."""
    return replace(setup, duration=times * setup.reference.duration, scenario="")


def goal(setup: Setup) -> EpisodeGoal:
    """The end of the reference."""
    return EpisodeGoal(*setup.goal, REACHED)


def _varied(base: Scenario, seed: int, number: int) -> Scenario:
    rng = sequence(seed, "lab", number)
    assert base.start is not None
    dx, dy = rng.uniform(-0.1, 0.1, 2)
    start = base.start.model_copy(
        update={
            "x_m": base.start.x_m + float(dx),
            "y_m": base.start.y_m + float(dy),
            "heading_rad": base.start.heading_rad + float(rng.uniform(-0.2, 0.2)),
        }
    )
    off, speed = float(rng.uniform(0.0, 40.0)), float(rng.uniform(0.1, 0.4))
    obstacles = [
        o.model_copy(
            update={"path": o.path.model_copy(update={"start_s": off, "speed_mps": speed})}
        )
        if o.path
        else o
        for o in base.obstacles
    ]
    return base.model_copy(update={"start": start, "obstacles": obstacles})
