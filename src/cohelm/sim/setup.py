"""All that one run needs: robot, world, person, and how it is simulated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from cohelm.core.row import blank
from cohelm.core.trace import Trace
from cohelm.core.types import Floats, Pose, StickRecording
from cohelm.law.gains import Gains
from cohelm.law.govern import PaceParams, attainable
from cohelm.law.guard.rules import Rules
from cohelm.law.reference import Reference, evaluate
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.track.params import TrackerParams
from cohelm.pilot.replanning import ReplanParams
from cohelm.pilot.step import Settings
from cohelm.plan.evasion.params import HURRY, EvasionParams, adapted
from cohelm.plan.path_planner import PathParams
from cohelm.plan.zones import UNZONED, Zones
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.limits import Limits
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID, Grid
from cohelm.sim.operator_model import OperatorModel, replay
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.world import World, ever_moving, world

REACHED = 0.1
"""Distance to the end of a reference that counts as having reached it, by default [m]."""


@dataclass(frozen=True)
class Piloted:
    """What a run with the pilot needs beyond the rest of a setup."""

    settings: Settings
    max_acceleration: Floats
    """(m,), the largest acceleration each disc is assumed to be capable of [m/s^2]."""
    lidars: tuple[LidarModel, ...] = ()
    """What the robot sees with; none: it knows all discs and walls, as they are."""
    tracker_params: TrackerParams = field(default_factory=TrackerParams)
    """Parameters of the tracker."""
    path_params: PathParams = field(default_factory=PathParams)
    replan_params: ReplanParams = field(default_factory=ReplanParams)
    period: float = 0.2
    """From the beginning of one plan to the next [s]."""
    thinking: float = 0.04
    """From the snapshot to the plan that is made of it [s]: planning takes that long."""
    zones: Zones = UNZONED
    """Where the robot keeps out, and where it goes slowly."""

    @property
    def scan_age(self) -> float:
        """Age of the scans of its slowest LiDAR when its next one is there [s]."""
        return max((1.0 / one.rate_hz for one in self.lidars), default=0.0)


@dataclass(frozen=True)
class Twinned:
    """What a run on the twin needs beyond the rest of a setup."""

    robot: RobotModel
    physics: TwinModel
    known: LocalizationMap | None = None
    """With a LiDAR, the map on which the robot localizes; None: it is given its true pose."""


@dataclass(frozen=True)
class Setup:
    """All that one run needs."""

    start: Pose
    reference: Reference
    outline: Floats
    limits: Limits
    gains: Gains = field(default_factory=Gains)
    spline_speed: bool = False
    obstacles: World = field(default_factory=lambda: world(([], np.empty((0, 4)))))
    names: tuple[str, ...] = ()
    recorded_stick: StickRecording = field(default_factory=replay)
    operator: OperatorModel = field(default_factory=OperatorModel)
    dt: float = 0.01
    duration: float | None = None
    """[s]; by default that of the reference, or with the pilot twice that and half a minute."""
    delay: float = 0.0
    """From command to wheels, rounded to whole steps [s]."""
    seed: int = 0
    grid: Grid = NO_GRID
    """An occupancy map, seen by a LiDAR; its borders are walls of `around` too."""
    barred: Floats | None = None
    """(s, 4), the walls that a LiDAR sees besides the map's; None: all of `obstacles`."""
    near: float = REACHED
    """Nearer to the end of the reference than this, the robot has arrived [m]."""
    pilot: Piloted | None = None
    """With the pilot; None for the paper's law, whose reference runs on with time."""
    twin: Twinned | None = None
    """With the physics twin as the plant; None for exact arcs."""
    scenario: str = ""
    """The YAML text this was made from, kept with the trace."""

    @property
    def steps(self) -> int:
        """Control steps of the run, the last one at its end or just before. With the pilot, at
        most: it ends on arrival."""
        duration = self.duration
        if duration is None:
            duration = self.reference.duration
            duration = duration if self.pilot is None else 2.0 * duration + 30.0
        return math.floor(duration / self.dt + 1e-9) + 1

    @property
    def goal(self) -> tuple[float, float]:
        """The end of the reference [m]."""
        path = self.reference
        end = evaluate(path.knots, path.coeffs, path.duration)
        return float(end.x), float(end.y)

    @property
    def reach(self) -> float:
        """Distance from the body's origin to the outline's farthest corner [m]."""
        return farthest_corner(self.outline)

    def blank(self, n: int) -> Trace:
        """A trace of n steps, to be written into."""
        m = len(self.obstacles.discs)
        h, discs = np.empty((n, m)), np.empty((n, m, 6))
        return Trace(blank(n), h, discs, self.names, self.dt, self.scenario)

    @property
    def delay_steps(self) -> int:
        """The delay in control steps."""
        return round(self.delay / self.dt)


def with_pilot(
    setup: Setup, pace: PaceParams | None = None, lidars: tuple[LidarModel, ...] = (),
    max_acceleration: float = 1.0, gains: Gains | None = None,
) -> Setup:  # fmt: skip
    """The same run with the pilot, at its default parameters; without `gains` with those of the
    setup.

    lidars: what the robot sees with; none: it is given the true obstacles. max_acceleration:
    assumed of the discs that drift or follow a path [m/s^2].
    """
    gains = gains or setup.gains
    evasion = adapted(EvasionParams(speed=HURRY * gains.u_d), setup.outline, setup.limits)
    settings = Settings(
        setup.outline, setup.limits, gains, Rules(dt=setup.dt),
        attainable(pace or PaceParams(), setup.limits, gains.u_d), evasion=evasion,
    )  # fmt: skip
    pilot = Piloted(
        settings, np.where(ever_moving(setup.obstacles), max_acceleration, 0.0), lidars,
        TrackerParams(max_acceleration=max_acceleration),
    )  # fmt: skip
    return replace(setup, pilot=pilot)
