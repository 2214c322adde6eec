"""Factories of the robot that a session drives, with the site where it drives."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cohelm.core.errors import CohelmError
from cohelm.core.plugins import plugin
from cohelm.core.types import Pose
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.base import Robot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import RobotPort
from cohelm.scenario import load
from cohelm.scenario.model import Scenario

GROUP = "cohelm.robots"
"""Entry points of robots in other packages."""

Make = Callable[[RobotModel], Robot] | Robot
"""A class or function that makes a robot of its model; or a robot that can be pickled."""


class RobotFactory(Protocol):
    """Makes a robot in the process that calls it, and has its site. Can be pickled."""

    @property
    def scenario(self) -> Scenario:
        """The site: map, route, law and stick; self-contained, with the robot's description."""
        ...

    @property
    def kind(self) -> str:
        """kinematic, twin, or own."""
        ...

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself."""
        ...

    @property
    def model(self) -> RobotModel:
        """The robot."""
        ...

    @property
    def start(self) -> Pose:
        """Its first pose."""
        ...

    def delay(self, period: float) -> float:
        """From a command to its effect, as the guard must predict it [s]."""
        ...

    def __call__(self) -> RobotPort:
        """Make a robot."""
        ...


@dataclass(frozen=True)
class OwnRobot:
    """A user's robot, at a site whose obstacles are real and not simulated."""

    scenario: Scenario
    make: Make
    real_time: bool = True
    kind: str = "own"

    @property
    def model(self) -> RobotModel:
        """As its YAML file describes it."""
        return self.scenario.described()

    @property
    def start(self) -> Pose:
        """Its first pose."""
        return self.scenario.first_pose()

    def delay(self, period: float) -> float:
        """As measured, with lag; see docs/loop.md."""
        return self.model.delay_s

    def __call__(self) -> RobotPort:
        """Make the robot here. Raises CohelmError if that fails, or if its model differs."""
        try:
            robot = self.make if isinstance(self.make, Robot) else _made(self.make, self.model)
        except CohelmError:
            raise
        except Exception as error:
            raise CohelmError(
                f"the robot can not be made: {type(error).__name__}: {error}"
            ) from error
        adapted = RobotAdapter(robot)
        if adapted.model != self.model:
            raise CohelmError(
                f"the robot's model is not the model of {self.model.name} that it was given: let "
                "it keep that one, def __init__(self, model): super().__init__(model)"
            )
        return adapted


def own_robot(
    robot: Make | str, site: str | Path | Scenario, model: RobotModel | str | Path | None = None,
    changes: list[str] | None = None,
) -> OwnRobot:  # fmt: skip
    """A user's robot at a site.

    robot: its class, `package:Class`, an entry point of `cohelm.robots`, or a robot that can be
    pickled. site: a scenario; its map, route, law and stick are used. model: the robot, a shipped
    name or its YAML file; by default the robot's own, or the site's.

    Raises CohelmError for a robot or a site that can not be used.
    """
    make: Make = plugin(GROUP, robot) if isinstance(robot, str) else robot
    if isinstance(make, type) and not issubclass(make, Robot):  # pyright: ignore
        raise CohelmError(f"{make.__name__} is no subclass of cohelm.Robot")
    if not callable(make) and not isinstance(make, Robot):  # pyright: ignore
        raise CohelmError(
            f"a robot must be a subclass of cohelm.Robot or make one, got {type(make).__name__}"
        )
    if isinstance(model, str | Path):
        model = load.load_robot(model)
    if model is None and isinstance(make, Robot):
        model = RobotAdapter(make).model
    made = site if isinstance(site, Scenario) else load.scenario(site, changes or [])
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
    return OwnRobot(load.standing_alone(made, Path()), make, real_time)


def _made(make: Callable[..., Any], model: RobotModel) -> Robot:
    """Call `make`, with the model if it takes one."""
    try:
        takes = bool(inspect.signature(make).parameters)
    except (TypeError, ValueError):
        takes = True
    return make(model) if takes else make()
