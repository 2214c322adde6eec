"""The scenario file's model: every key with its unit, its range, and the paper's value.

A number's unit is the end of its key (`_m`, `_s`, `_mps`, `_rad`, ...); gains keep the paper's
names, and their units are in their descriptions. Editors show the field descriptions below (`cohelm
schema`).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from cohelm.core.errors import CohelmError
from cohelm.core.schema import Coordinate, Schema, refuse
from cohelm.core.types import Floats, Pose
from cohelm.law.gains import Gains
from cohelm.law.reference import Reference, desired, through
from cohelm.link.bulk_messages import MOST_DOCKS
from cohelm.robot.model import RobotModel
from cohelm.scenario.docks import DockModel
from cohelm.scenario.law import Law
from cohelm.scenario.stick import Stick, StickNone, StickOperator
from cohelm.scenario.world import Read, WorldFile, has_route, read
from cohelm.scenario.zones import ZonesModel
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.world import Body, World, world

Point = tuple[Coordinate, Coordinate]
Segment = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Speed = Annotated[float, Field(gt=0.0, le=100.0)]
Component = Annotated[float, Field(ge=-100.0, le=100.0)]
Name = Annotated[str, Field(min_length=1, max_length=80)]
Seconds = Annotated[float, Field(ge=0.0, le=1e6)]

_PAPER = Gains()


def _path(waypoints: list[Point], speed: float) -> Reference:
    try:
        return through(np.array(waypoints), speed)
    except CohelmError as error:
        refuse(("waypoints_m", str(error)))


class Start(Schema):
    """Where the robot stands at the beginning."""

    x_m: Coordinate
    """World x of the robot's centre."""
    y_m: Coordinate
    """World y of the robot's centre."""
    heading_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]
    """Heading, counter-clockwise from x."""


class ReferenceModel(Schema):
    """The trajectory to follow: natural cubic splines through waypoints (7)-(13)."""

    speed_mps: Speed = _PAPER.u_d
    """Desired surge speed u_d; full fore-aft deflection of the stick is scaled by it too (45)."""
    waypoints_m: list[Point] = Field(default=[], min_length=2, max_length=100_000)
    """Waypoints [x, y], at least two, no two equal ones in a row; needed unless the world comes
    with its own."""
    arrive_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Nearer to the last waypoint than this, the robot has arrived; by default 0.1 m, or what
    the world comes with."""
    feed_forward: Literal["constant", "spline"] = "constant"
    """Speed in the tracking law (E10): the constant u_d as printed, or the spline's own speed; the
    guard's reference has its own."""

    @model_validator(mode="after")
    def _passable(self) -> Self:
        if self.waypoints_m:
            _path(self.waypoints_m, self.speed_mps)
        return self

    def spline(self) -> Reference:
        """The trajectory itself; CohelmError without waypoints."""
        return _path(self.waypoints_m, self.speed_mps)


class ObstaclePath(Schema):
    """A spline that an obstacle follows once; it rests before and after."""

    start_s: Seconds = 0.0
    """When it sets off."""
    speed_mps: Speed
    """How fast it goes."""
    waypoints_m: Annotated[list[Point], Field(min_length=2, max_length=100_000)]
    """Waypoints [x, y], at least two, no two equal ones in a row."""

    @model_validator(mode="after")
    def _passable(self) -> Self:
        _path(self.waypoints_m, self.speed_mps)
        return self

    def spline(self) -> Reference:
        """The path in its own time."""
        return _path(self.waypoints_m, self.speed_mps)


class Obstacle(Schema):
    """A disc that rests, drifts with a constant velocity, or follows a path."""

    name: Name
    """What to call it in tables and figures."""
    center_m: Point | None = None
    """Centre [x, y] at the start; leave it out when there is a path."""
    radius_m: Annotated[float, Field(ge=0.0, le=1000.0)]
    """Radius of the body itself."""
    safe_distance_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.2
    """r_i (19): from the robot's centre to the obstacle's, h_i = distance^2 - r_i^2 (Table II)."""
    velocity_mps: tuple[Component, Component] | None = None
    """Velocity [x, y] in the world frame; none for an obstacle that rests."""
    path: ObstaclePath | None = None
    """The path it follows, instead of `center_m` and `velocity_mps`."""

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.path is None and self.center_m is None:
            refuse(("", "needs either center_m: [x, y] or a path"))
        if self.path is not None and self.center_m is not None:
            refuse(("center_m", "is the path's first waypoint already; remove center_m or path"))
        if self.path is not None and self.velocity_mps is not None:
            refuse(("velocity_mps", "the path says how fast it moves; remove velocity_mps or path"))
        return self

    @property
    def start(self) -> Point:
        """Where its centre is at t = 0 [m]."""
        return self.path.waypoints_m[0] if self.path else (self.center_m or (0.0, 0.0))

    def body(self, noticed: bool) -> Body:
        """The disc as the simulator takes it."""
        path = None if self.path is None else self.path.spline()
        x, y = self.start
        vx, vy = self.velocity_mps or (0.0, 0.0)
        row = (x, y, vx, vy, self.radius_m, self.safe_distance_m)
        return Body(row, path, self.path.start_s if self.path else 0.0, noticed)


class Simulation(Schema):
    """How the run is simulated."""

    step_s: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Control and simulation step; the command is held over it."""
    duration_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """Length of the run; by default that of the reference, or with the guard, where the run ends
    on arrival, twice that and half a minute."""
    wheel_limits: bool = True
    """Whether the robot's speed and acceleration limits hold, or it is the ideal unicycle (E11)."""
    delay_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    """From command to wheels, rounded to whole steps."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Of everything random; the same seed gives the same run."""
    plant: Literal["kinematic", "twin"] = "kinematic"
    """What plays the robot: exact arcs, or its physics twin, with its delay and wheel limits."""
    twin: TwinModel = TwinModel()
    """The twin's ground, drives and sensors."""


def _named_or_described(robot: object) -> str:
    return "name" if isinstance(robot, str) else "description"


class Scenario(Schema):
    """One run: a robot, what it follows, what is in its way, and whose hand is on the stick.

        >>> import cohelm
        >>> ahead = {"speed_mps": 0.5, "waypoints_m": [[0, 0], [2, 0]]}
        >>> cohelm.Scenario(name="ahead", robot="sally", reference=ahead).simulation.step_s
        0.01

    Keys are those of the YAML, in metres, seconds and radians; see docs/scenarios.md.
    """

    name: Name
    """What to call it."""
    robot: Annotated[
        Annotated[str, Tag("name")] | Annotated[RobotModel, Tag("description")],
        Discriminator(_named_or_described),
    ] = "sally"
    """A robot that comes with the package (sally, turtlebot4 and others), the path of a YAML file
    relative to this one, or the robot's description itself."""
    start: Start | None = None
    """Where the robot starts; by default on the reference's first pose, and a real robot at
    (0, 0, 0) of a `--map` that `cohelm map` made."""
    reference: ReferenceModel
    """What to follow."""
    law: Law = Law()
    """The control law; by default the guard, with the paper's tracking and sharing."""
    senses: Literal["truth", "lidar"] = "truth"
    """What the robot knows of its surroundings, with the guard: all obstacles and walls as they
    are, or what its LiDAR sees."""
    world: WorldFile | None = None
    """A world file, in addition to the obstacles and walls below."""
    obstacles: list[Obstacle] = Field(default=[], max_length=10_000)
    """Discs, any number."""
    walls_m: list[Segment] = Field(default=[], max_length=100_000)
    """Wall segments [x1, y1, x2, y2]; the paper's law ignores them."""
    zones: ZonesModel | None = None
    """Where the robot keeps out, and where it goes slowly, with the guard."""
    docks: list[DockModel] = Field(default=[], max_length=MOST_DOCKS)
    """Places to dock at, with the guard; see docs/docking.md."""
    stick: Stick = StickNone()
    """The operator's stick."""
    simulation: Simulation = Simulation()
    """Step, length, limits, delay, seed."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        problems: list[tuple[str, str]] = []
        for what, named in (("obstacle", self.obstacles), ("dock", self.docks)):
            seen: dict[str, int] = {}
            for i, one in enumerate(named):
                first = seen.setdefault(one.name, i)
                if first != i:
                    problem = f"{what} {first + 1} is called {one.name!r} too; names must differ"
                    problems.append((f"{what}s.{i}.name", problem))
        if isinstance(self.stick, StickOperator):
            there = [obstacle.name for obstacle in self.obstacles]
            for i, name in enumerate(self.stick.minds or []):
                if name not in there:
                    known = ", ".join(dict.fromkeys(there)) or "none"
                    problem = f"no obstacle is called {name!r}; there are: {known}"
                    problems.append((f"stick.minds.{i}", problem))
        for i, (x1, y1, x2, y2) in enumerate(self.walls_m):
            if x1 == x2 and y1 == y2:
                problems.append((f"walls_m.{i}", "both ends are the same point; remove the wall"))
        if not self.reference.waypoints_m and not has_route(self.world):
            problem = "is missing: waypoints [x, y], at least two"
            problems.append(("reference.waypoints_m", problem))
        for key, given, knows, instead in (
            ("senses", self.senses == "lidar", "LiDAR", "senses to truth"),
            ("docks", bool(self.docks), "docks", "remove them"),
            ("zones", self.zones is not None, "zones", "remove them"),
        ):
            if given and self.law.filter != "guard":
                problem = f"the paper's law knows no {knows}; set law.filter to guard, or {instead}"
                problems.append((key, problem))
        if problems:
            refuse(*problems)
        return self

    def described(self) -> RobotModel:
        """The robot of a scenario that stands alone, see `load.standing_alone`."""
        if isinstance(self.robot, str):
            raise TypeError("the robot is still a name")
        return self.robot

    def first_pose(self, reference: Reference | None = None) -> Pose:
        """Where the robot starts: `start`, or on the first pose of the reference. reference: its
        spline, where that is made already."""
        if self.start is not None:
            return Pose(self.start.x_m, self.start.y_m, self.start.heading_rad)
        first = desired(reference or self.reference.spline(), 0.0, False)
        return Pose(first.x, first.y, first.psi)

    def scenery(self) -> Read:
        """What the world's file holds; nothing without one. CohelmError where it can not be used.

        The file's path is taken as it stands, see `load.standing_alone`.
        """
        if self.world is None:
            return Read()
        duration = self.simulation.duration_s or 2.0 * self.reference.spline().duration + 30.0
        reach = self.robot.reach if isinstance(self.robot, RobotModel) else 0.0
        return read(self.world, reach, duration)

    def walls(self, scenery: Read | None = None) -> Floats:
        """The walls as an array, those of the world last, (s, 4) [m]."""
        own = np.array(self.walls_m, dtype=np.float64).reshape(-1, 4)
        return np.concatenate((own, (scenery or self.scenery()).walls))

    def build_world(self, scenery: Read | None = None) -> World:
        """Obstacles and walls as the simulator takes them, those of the world last."""
        known = scenery or self.scenery()
        minds = self.stick.minds if isinstance(self.stick, StickOperator) else None
        own = [o.body(minds is None or o.name in minds) for o in self.obstacles]
        return world(([*own, *known.bodies], self.walls(known)))
