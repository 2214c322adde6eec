"""One robot, fully recorded, in pieces that can be written down as they come."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.trace import ROW, Trace
from cohelm.core.types import SAFE, VX, VY, Desired, Floats, Pose, X, Y
from cohelm.law.gains import Gains
from cohelm.law.govern import Pace
from cohelm.law.guard.step import Rules
from cohelm.law.reference import Reference, evaluate, tabulate
from cohelm.law.track import pose_error
from cohelm.perceive.movers import Care as Watching
from cohelm.pilot.course import route
from cohelm.pilot.pilot import Planner
from cohelm.pilot.step import Settings
from cohelm.robot.limits import Limits
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID, Grid
from cohelm.sim.hand import IDLE, Operator, Person, Replay, operate, replay, replayed
from cohelm.sim.loop import State, at_rest, turn
from cohelm.sim.piloted import Piloted, Scene, stretches
from cohelm.sim.twin.settings import Twinned
from cohelm.sim.world import NOWHERE, World, clearance, place, world

REACHED = 0.1
"""Distance to the end of a reference that counts as having reached it, by default [m]."""


@dataclass(frozen=True)
class Setup:
    """All that one run needs."""

    start: Pose
    reference: Reference
    outline: Floats
    limits: Limits
    gains: Gains = field(default_factory=Gains)
    spline_speed: bool = False
    around: World = field(default_factory=lambda: world(([], np.empty((0, 4)))))
    names: tuple[str, ...] = ()
    hands: Replay = field(default_factory=replay)
    operator: Operator = field(default_factory=Operator)
    dt: float = 0.01
    duration: float | None = None
    """[s]; by default that of the reference, or with the pilot twice that and half a minute."""
    delay: float = 0.0
    """From command to wheels, rounded to whole steps [s]."""
    seed: int = 0
    grid: Grid = NO_GRID
    """An occupancy map, seen by a LiDAR; its borders are walls of `around` too."""
    barred: Floats | None = None
    """(s, 4), the walls that a LiDAR sees beside the map; None: all of `around`."""
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
    def delay_steps(self) -> int:
        """The delay in control steps."""
        return round(self.delay / self.dt)


def with_pilot(
    setup: Setup, pace: Pace | None = None, lidar: LidarModel | None = None, agility: float = 1.0,
    gains: Gains | None = None,
) -> Setup:  # fmt: skip
    """The same run with the pilot, at its usual care; without `gains` with those of the setup.

    lidar: what the robot sees with; None: it knows everything as it is. agility: of the discs
    that drift or follow a path, the largest acceleration they are taken to be capable of [m/s^2].
    """
    moving = np.hypot(setup.around.discs[:, VX], setup.around.discs[:, VY]) > 0.0
    moving |= np.diff(setup.around.path_first) > 0
    settings = Settings(
        setup.outline, setup.limits, gains or setup.gains, Rules(dt=setup.dt), pace or Pace()
    )
    made = Piloted(
        settings, agility * moving.astype(np.float64), None if lidar is None else lidar.lidar()
    )
    if lidar is not None:
        made = replace(made, rate=lidar.rate_hz, watching=Watching(agility=agility))
    return replace(setup, pilot=made)


def run(setup: Setup) -> Trace:
    """The whole run at once."""
    (trace,) = pieces(setup, setup.steps)
    return trace


def _piloted(setup: Setup, pilot: Piloted, length: int) -> Iterator[Trace]:
    planner = Planner(route(setup.reference), pilot.settings, pilot.manners, pilot.care)
    end = evaluate(setup.reference.knots, setup.reference.coeffs, setup.reference.duration)
    reach = float(np.hypot(*setup.outline.T).max())
    scene = Scene(
        setup.around, setup.grid, pilot.agility, setup.hands, setup.operator, setup.seed, reach,
        np.array([end.x, end.y]), setup.near,
        setup.around.walls if setup.barred is None else setup.barred, pilot.lidar is not None,
    )  # fmt: skip
    for part in stretches(
        setup.start, planner, scene, pilot, setup.dt, setup.delay_steps, setup.steps, length
    ):
        yield Trace(part.rows, part.h, part.discs, setup.names, setup.dt, setup.scenario)


def pieces(setup: Setup, length: int = 200) -> Iterator[Trace]:
    """The run in traces of `length` steps, the last one shorter, in order."""
    if setup.twin is not None:
        from cohelm.sim.twin import drive  # needs MuJoCo, which is an extra

        yield from drive.pieces(setup, length)
        return
    if setup.pilot is not None:
        yield from _piloted(setup, setup.pilot, length)
        return
    desired = tabulate(setup.reference, setup.dt, setup.steps, setup.spline_speed)
    state, person = at_rest(setup.start), IDLE
    queue = np.zeros((setup.delay_steps, 2))
    m = len(setup.around.discs)
    reach = float(np.hypot(*setup.outline.T).max())
    end = evaluate(setup.reference.knots, setup.reference.coeffs, setup.reference.duration)
    goal = (end.x, end.y, setup.near)
    for k in range(0, setup.steps, length):
        n = min(length, setup.steps - k)
        rows = np.zeros(n, dtype=ROW)
        h, discs = np.empty((n, m)), np.empty((n, m, 6))
        state, person = _advance(
            k, setup.dt, state, person, desired, goal, setup.around, setup.hands, setup.operator,
            setup.seed, setup.gains, setup.limits, setup.outline, reach, queue, rows, h, discs,
        )  # fmt: skip
        yield Trace(rows, h, discs, setup.names, setup.dt, setup.scenario)


@jit
def _advance(
    first: int, dt: float, state: State, person: Person, table: Floats,
    goal: tuple[float, float, float], around: World,
    hands: Replay, operator: Operator, seed: int, gains: Gains, limits: Limits,
    outline: Floats, reach: float, queue: Floats, rows: NDArray[np.void], h: Floats, discs: Floats,
) -> tuple[State, Person]:  # fmt: skip
    """Steps first ... first + len(rows) - 1, each written into rows, h and discs."""
    for j in range(len(rows)):
        k = first + j
        now = discs[j]
        place(now, 0, around, k * dt)
        d = table[k]
        desired = Desired(d[0], d[1], d[2], d[3], d[4])
        pose = state.pose
        if operator.active:
            person, stick = operate(person, operator, pose, now, around.noticed, k, dt, seed)
        else:
            stick = replayed(0, hands, k * dt)
        state, s, saturated = turn(k, dt, state, stick, desired, now, gains, limits, queue)
        for i in range(now.shape[0]):
            dx, dy = pose.x - now[i, X], pose.y - now[i, Y]
            h[j, i] = dx * dx + dy * dy - now[i, SAFE] * now[i, SAFE]
        row = rows[j]
        row.t = k * dt
        row.x, row.y, row.psi = pose.x, pose.y, pose.psi
        row.x_d, row.y_d, row.psi_d = desired.x, desired.y, desired.psi
        row.u_d, row.r_d = desired.u, desired.r
        row.e_p = pose_error(pose, desired)
        row.stick_x, row.stick_psi = stick.x, stick.psi
        row.v, row.omega = s.v, s.omega
        row.automatic_v, row.automatic_omega = s.automatic_v, s.automatic_omega
        row.human_v, row.human_omega = s.human_v, s.human_omega
        row.shared_v, row.shared_omega = s.shared_v, s.shared_omega
        row.avoid_v, row.avoid_omega = s.avoid_v, s.avoid_omega
        row.authority_x, row.authority_psi = s.authority_x, s.authority_psi
        row.intent_x, row.intent_psi = s.intent_x, s.intent_psi
        row.I, row.J, row.h = s.I, s.J, s.h
        row.verdict, row.culprit = s.verdict, s.culprit
        row.applied_v, row.applied_omega = state.applied.v, state.applied.omega
        row.saturated = saturated
        row.clearance = clearance(pose, outline, reach, now, around.walls, NOWHERE)
        row.energy = state.energy
        row.gap, row.change = math.inf, 0.0
        row.tau, row.rate = k * dt, 1.0
        row.to_go = math.hypot(pose.x - goal[0], pose.y - goal[1])
        row.arrived = math.hypot(pose.x - desired.x, pose.y - desired.y) < goal[2]
    return state, person
