"""Factories of the robot that a session drives, with the site where it drives."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError, naming
from cohelm.core.files import as_path
from cohelm.core.plugins import plugin
from cohelm.core.types import Pose
from cohelm.law.reference import Reference
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.robot.adapter import AdaptedMaker, Make, RobotAdapter
from cohelm.robot.base import Robot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import RobotPort
from cohelm.scenario import load
from cohelm.scenario.model import Scenario, Start
from cohelm.scenario.worlds.maps import is_from_start, read_map
from cohelm.sim.grid import NO_GRID
from cohelm.sim.maker import Kind, SimulatedMaker
from cohelm.sim.twin.settings import TwinModel, lag

GROUP = "cohelm.robots"
"""Entry points of robots in other packages."""
SITE = "lab-guard"
"""Where a simulated robot is driven if no site is named..."""
OWN_SITE = "open"
"""... and a real one: without map, as that of a shipped scenario would be wrong."""
_ROUTE = "reference.waypoints_m"


def site_of(name: str | Path | None, unnamed: str, changes: list[str] | None) -> Scenario:
    """The scenario where a robot is driven. unnamed: the one where no name is given."""
    named = unnamed if name is None else as_path(name, "a site, or its YAML file")
    return load.scenario(named, changes or [])


@dataclass(frozen=True)
class _AtSite:
    """Makes a robot in the process that calls it, and has its site. Can be pickled."""

    scenario: Scenario
    """The site: map, route, law and stick; self-contained, with the robot's description."""

    @property
    def model(self) -> RobotModel:
        """The robot, as its YAML file describes it."""
        return self.scenario.described()

    @property
    def start(self) -> Pose:
        """Its first pose."""
        return self.scenario.first_pose()

    @property
    def route(self) -> Reference | None:
        """The site's route; None: it has none."""
        return self.scenario.reference.spline()

    def delay(self, period: float) -> float:
        """From a command to its effect, as the guard must predict it [s]; see docs/loop.md."""
        return self.model.delay_s


@dataclass(frozen=True)
class OwnRobot(_AtSite):
    """A user's robot, at a site whose obstacles are real and not simulated."""

    make: Make
    site_named: bool = True
    """Whether the user chose that site. Else the robot has no route until one is drawn or sent:
    the site's own leads anywhere in the real world."""
    real_time: bool = True
    """Whether time passes by itself."""
    kind: str = "own"

    @property
    def route(self) -> Reference | None:
        """The route of a site that was named."""
        return super().route if self.site_named else None

    def on(self, chart: Path) -> OwnRobot:
        """The same on a map. On one that `cohelm map` made of a drive it starts where that drive
        did, in that frame, unless the site has a `start`: nothing is simulated that would stand on
        the route's first pose. Raises CohelmError for a map that can not be read."""
        if self.scenario.start is not None or not is_from_start(chart):
            return self
        here = self.scenario.model_copy(update={"start": Start(x_m=0.0, y_m=0.0, heading_rad=0.0)})
        return replace(self, scenario=here)

    def maker(self) -> AdaptedMaker:
        """Makes the robot, in another process too."""
        return AdaptedMaker(self.make, self.model)

    def __call__(self) -> RobotPort:
        """Make the robot here. Raises CohelmError if that fails, or if its model differs."""
        return self.maker()()


def own_robot(
    robot: Make | str, site: str | Path | Scenario | None = None,
    model: RobotModel | str | Path | None = None, changes: list[str] | None = None,
) -> OwnRobot:  # fmt: skip
    """A user's robot at a site.

    robot: its class, `package:Class`, an entry point of `cohelm.robots`, or a robot that can be
    pickled. site: a scenario; its map, route, law and stick are used; by default `OWN_SITE`,
    without a route. model: the robot, a shipped name or its YAML file; by
    default the robot's own, or the site's.

    Raises CohelmError for a robot or a site that can not be used.
    """
    if site is None and any(one.strip().startswith(_ROUTE) for one in changes or ()):
        raise CohelmError(f"--set {_ROUTE} changes the route of a site: name it with --scenario")
    make: Make = plugin(GROUP, robot) if isinstance(robot, str) else robot
    if isinstance(make, type) and not issubclass(make, Robot):  # pyright: ignore
        raise CohelmError(f"{make.__name__} is no subclass of cohelm.Robot")
    if not callable(make) and not isinstance(make, Robot):  # pyright: ignore
        raise CohelmError(
            f"a robot must be a subclass of cohelm.Robot or make one, got {type(make).__name__}"
        )
    if model is not None and not isinstance(model, RobotModel):
        model = load.load_robot(model)
    if model is None and isinstance(make, Robot):
        model = RobotAdapter(make).model
    made = site if isinstance(site, Scenario) else site_of(site, OWN_SITE, changes)
    if model is not None:
        made = made.model_copy(update={"robot": model})
    try:
        pickle.dumps(make)
    except Exception as error:
        raise CohelmError(
            f"the robot can not be sent to the process that drives it ({error}): give its class "
            "instead of an instance, from a module and not from inside a function"
        ) from error
    real_time = bool(getattr(make, "real_time", True))
    return OwnRobot(load.standing_alone(made, Path()), make, site is not None, real_time)


@dataclass(frozen=True)
class Simulated(_AtSite):
    """The simulated robot of a scenario."""

    kind: Kind = "kinematic"
    real_time: bool = True
    seed: int = 0

    def delay(self, period: float) -> float:
        """With the lag of the twin's drives."""
        if self.kind == "kinematic":
            return self.model.delay_s
        return lag(self.model, TwinModel(), period)

    def maker(self) -> SimulatedMaker:
        """Makes the robot at the start, in another process too, which need not know scenarios."""
        scenery = self.scenario.scenery()
        if scenery.grid is not NO_GRID:  # its borders come with the map, and a LiDAR sees its cells
            scenery = scenery._replace(walls=np.empty((0, 4)))
        world = self.scenario.build_world(scenery)
        return SimulatedMaker(
            self.model, self.start, world, scenery.grid, self.kind, self.seed, self.real_time
        )

    def __call__(self) -> RobotPort:
        """Make a robot that stands at the start."""
        return self.maker()()


RobotFactory = OwnRobot | Simulated
"""Makes the robot of a session."""


def simulated(
    name: str | Path | None, kind: Kind = "kinematic", *, real_time: bool = True,
    seed: int | None = None, changes: list[str] | None = None,
) -> Simulated:  # fmt: skip
    """A factory by a scenario's file or name; None: `SITE`. Raises CohelmError if that can not be
    used."""
    made = site_of(name, SITE, changes)
    alone = load.standing_alone(made, Path())
    return Simulated(alone, kind, real_time, alone.simulation.seed if seed is None else seed)


def mapped(path: Path, start: Pose) -> LocalizationMap:
    """A map to localise on, in the world's frame.

    A published map is in that frame already; a map of `cohelm map` is in the frame of the robot's
    first pose, here `start`. Raises CohelmError if the file can not be used.
    """
    occupancy = read_map(path).placed(start)
    with naming(path):
        return occupancy.known()
