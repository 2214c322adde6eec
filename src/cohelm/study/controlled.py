"""Runs one scenario with the law it names, or with one of the caller's, and judges both alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.obstacles import Obstacles
from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, VX, VY, Desired, Floats, Pose, Stick, Twist, X, Y
from cohelm.law.human import human, limited
from cohelm.law.reference import desired
from cohelm.law.step import Step
from cohelm.law.track import pose_error
from cohelm.law.verdict import INVALID
from cohelm.pilot.behavior import FOLLOWING
from cohelm.robot.model import RobotModel
from cohelm.scenario import build, load
from cohelm.scenario.model import Scenario
from cohelm.sim.judge import Judged, judge
from cohelm.sim.operator_model import IDLE, operate
from cohelm.sim.run import run as simulated
from cohelm.sim.setup import Setup
from cohelm.sim.wheels import at_rest, moved, note
from cohelm.sim.world import NOWHERE, ever_moving, outline_clearance, place
from cohelm.study.metrics import Metrics, measure

_NOT_SAID = math.nan, math.nan  # by a law by others
_NOT_KNOWN = -1  # what a filter did that may be inside it
_MAX_ACCELERATION = 1.0  # of what moves, as the guard takes it by default [m/s^2]


class Observation(NamedTuple):
    """What a law is given in one control step; world frame, SI units, radians.

    >>> import cohelm
    >>> def law(now: cohelm.Observation) -> cohelm.Twist:
    ...     return cohelm.Twist(0.3 if now.pose.x < now.goal[0] else 0.0, 0.0)
    """

    t: float
    """Since the start [s]."""
    dt: float
    """Until the next step [s]."""
    pose: Pose
    """Where the robot is now."""
    twist: Twist
    """What its wheels do now."""
    obstacles: Obstacles
    """All there are, as of now; what moves may change its velocity by 1 m/s^2."""
    reference: Desired
    """Where the robot should be at t, and how fast (7)(10)."""
    goal: tuple[float, float]
    """The end of the reference [m]."""
    stick: Stick
    """What the person does."""


Controller = Callable[[Observation], Twist]
"""A law of one's own: the command for the next `dt`. What is not finite counts as a stop."""

ControllerFactory = Callable[[RobotModel, float], Controller]
"""Makes one for a robot and a control period [s]; of each run or episode a new one."""


@dataclass(frozen=True, repr=False)
class RunResult:
    """One run, judged: by `metrics`, as `cohelm run` scores it, and by the campaigns' judge.

    >>> import cohelm
    >>> result = cohelm.run("minimal")
    >>> (result.contacts, result.arrived)
    (0, True)
    """

    setup: Setup
    trace: Trace

    @cached_property
    def metrics(self) -> Metrics:
        """Durations, errors, clearances, shares."""
        return measure(self.trace)

    @cached_property
    def judged(self) -> Judged:
        """Contacts of the real outline, between the control steps too."""
        setup, trace = self.setup, self.trace
        return judge(
            Judged(), trace.rows, trace.discs, setup.outline, setup.obstacles.walls, setup.limits,
            trace.dt,
        )  # fmt: skip

    @property
    def arrived(self) -> bool:
        """Whether the run reached the end of its reference."""
        return self.metrics.reached

    @property
    def contacts(self) -> int:
        """In which the robot moved; being walked into while it stands is not its own."""
        return self.judged.moving

    def __repr__(self) -> str:
        """What became of it, not all of its numbers."""
        came = "arrived" if self.arrived else "not arrived"
        return f"RunResult({came}, {self.contacts} contacts, {len(self.trace.rows)} steps)"

    def table(self) -> dict[str, Floats]:
        """Every number of every step, by name, for pandas; `core.row.FIELDS` has units."""
        return {name: self.trace.rows[name] for name in self.trace.rows.dtype.names or ()}


def run(
    scenario: str | Path | Scenario, controller: Controller | None = None, *,
    changes: Sequence[str] = (), stick: str | None = None,
) -> RunResult:  # fmt: skip
    """One scenario from its start to its end, as fast as it can.

        >>> import cohelm
        >>> result = cohelm.run("lab-track", lambda now: cohelm.Twist(0.0, 0.0))
        >>> (result.contacts, result.arrived)
        (0, False)

    scenario: a shipped name, a file, or one that is loaded. controller: a law of one's own instead
    of the scenario's, on exact arcs with the robot's delay and wheel limits; it is given the true
    obstacles. changes: `key.path=value` as in `cohelm run --set`. stick: a stick file to play.

    Raises CohelmError for a scenario that can not be used.
    """
    if isinstance(scenario, Scenario):
        if changes or stick is not None:
            raise CohelmError(
                "changes and stick belong to a scenario's file: use scenario.model_copy instead"
            )
        made = scenario
    elif not isinstance(scenario, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise CohelmError(
            f"a scenario is a name, a file or a cohelm.Scenario(...), got {type(scenario).__name__}"
        )
    elif isinstance(changes, str | Mapping):
        raise CohelmError(f"changes are a list of 'key.path=value', got {changes!r}")
    else:
        made = load.scenario(scenario, changes, stick)
    setup = build.setup(made)
    if controller is not None and not callable(controller):  # pyright: ignore[reportUnnecessaryComparison]
        raise CohelmError(f"a controller is called with what it may know, got {controller!r}")
    return RunResult(setup, simulated(setup) if controller is None else driven(setup, controller))


def driven(setup: Setup, controller: Controller, arrive: bool = True) -> Trace:
    """The trace of a run under a law of one's own. arrive: ends where the reference does.

    Raises CohelmError for a setup with a plant or senses that such a law can not be given.
    """
    if setup.twin is not None or (setup.pilot is not None and setup.pilot.lidars):
        raise CohelmError(
            "a controller of your own drives the kinematic plant and is given the true obstacles: "
            "set simulation.plant=kinematic and senses=truth"
        )
    n, dt, made = setup.steps, setup.dt, setup.blank(setup.steps)
    rows, h, discs = made.rows, made.h, made.discs
    goal, gains = setup.goal, setup.gains
    max_acceleration = np.where(ever_moving(setup.obstacles), _MAX_ACCELERATION, 0.0)
    robot = at_rest(setup.start)._replace(energy=math.nan)  # of a blend that is not
    person = IDLE
    queue = np.zeros((setup.delay_steps, 2))
    done = n
    for k in range(n):
        t, there, pose = k * dt, discs[k], robot.pose
        place(there, setup.obstacles, t)
        person, stick = operate(
            person, setup.operator, setup.recorded_stick, pose, there, setup.obstacles.noticed, k,
            dt, setup.seed,
        )  # fmt: skip
        wanted = desired(setup.reference, t, setup.spline_speed)
        obstacles = _obstacles(there, max_acceleration, setup.obstacles.walls)
        now = Observation(t, dt, pose, robot.applied, obstacles, wanted, goal, stick)
        command, sound = _command(controller, now)
        robot, saturated = moved(k, dt, robot, command, stick, gains, setup.limits, queue)
        away = math.hypot(pose.x - goal[0], pose.y - goal[1])
        operator = human(limited(stick, gains), gains)
        decided = Step(
            *command, *command, *operator, *command, *_NOT_SAID, 1.0, 1.0, *_NOT_SAID, *_NOT_SAID,
            math.nan, _NOT_KNOWN if sound else INVALID, -1,
        )  # fmt: skip
        row = rows[k]
        note(row, h[k], t, pose, stick, wanted, decided, robot, saturated, there)
        row["e_p"], row["h"] = pose_error(pose, wanted), h[k].min(initial=math.inf)
        row["clearance"] = outline_clearance(
            pose, setup.outline, setup.reach, there, setup.obstacles.walls, NOWHERE
        )
        row["clearance_seen"], row["tau"], row["rate"] = math.nan, t, 1.0
        row["behavior"], row["course"] = FOLLOWING, 0
        row["to_go"], row["arrived"] = away, away < setup.near
        if arrive and away < setup.near and t > 0.5 * setup.reference.duration:
            done = k + 1
            break
    return made.until(done)


def _command(controller: Controller, now: Observation) -> tuple[Twist, bool]:
    """The law's command, and whether it was one."""
    given = controller(now)
    try:
        v, omega = given
        command = Twist(float(v), float(omega))
    except (TypeError, ValueError) as error:
        raise CohelmError(
            f"the controller must return a Twist (v, omega), got {given!r} at t = {now.t:.2f} s"
        ) from error
    if math.isfinite(command.v) and math.isfinite(command.omega):
        return command, True
    return Twist(0.0, 0.0), False


def _obstacles(discs: Floats, max_acceleration: Floats, walls: Floats) -> Obstacles:
    """The law's own: it may change them in place, and they are nobody else's."""
    return Obstacles(
        discs=discs[:, [X, Y, RADIUS, VX, VY]], segments=walls.copy(),
        max_acceleration=max_acceleration.copy(),
    )  # fmt: skip
