"""A scenario into a run: numbers, arrays, and the checks that need the whole of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.row import ROW
from cohelm.core.types import Floats, Pose, StickRecording
from cohelm.law.govern import profile
from cohelm.law.reference import Reference, tabulate
from cohelm.link import stick as sticks
from cohelm.perceive.track.params import TrackerParams
from cohelm.pilot.step import Settings
from cohelm.plan.zones import UNZONED
from cohelm.robot.clearance import disc_clearance, segment_clearance
from cohelm.robot.limits import Limits
from cohelm.robot.model import LONGEST_DELAY, RobotModel, checked_sight
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.load import digest, dump, standing_alone
from cohelm.scenario.model import Scenario
from cohelm.scenario.stick import StickFile, StickOperator, StickScript
from cohelm.scenario.world import Read
from cohelm.sim.grid import NO_GRID, solid_at
from cohelm.sim.operator_model import OperatorModel, replay
from cohelm.sim.setup import REACHED, Piloted, Setup, Twinned
from cohelm.sim.world import NOWHERE, World, ever_moving, outline_clearance

_LARGEST_RUN = 2**30  # bytes of a recorded run


def setup(scenario: Scenario) -> Setup:
    """All that one run needs; its `scenario` is YAML text that makes the same run again.

    Raises CohelmError if the robot starts inside an obstacle or a wall, the run is too long to
    be held in memory, or the stick file can not be used.
    """
    alone = standing_alone(scenario, Path())
    robot = alone.described()
    reference = alone.reference.spline()
    start = alone.first_pose(reference)
    recorded_stick, alone = _recorded_stick(alone)
    operator = alone.stick.person() if isinstance(alone.stick, StickOperator) else OperatorModel()
    limits = robot.bounds(enforced=alone.simulation.wheel_limits)
    gains = alone.law.gains(alone.reference.speed_mps)
    scenery = alone.scenery()
    obstacles = alone.build_world(scenery)
    made = Setup(
        start=start, reference=reference, outline=robot.outline, limits=limits,
        gains=gains, spline_speed=alone.reference.feed_forward == "spline",
        obstacles=obstacles,
        names=(*(obstacle.name for obstacle in alone.obstacles), *scenery.names),
        recorded_stick=recorded_stick, operator=operator, dt=alone.simulation.step_s,
        duration=alone.simulation.duration_s,
        delay=alone.simulation.delay_s, seed=alone.simulation.seed, grid=scenery.grid,
        barred=alone.walls(Read()) if scenery.grid is not NO_GRID else None,
        near=alone.reference.arrive_m or REACHED,
        pilot=_piloted(alone, robot, limits, obstacles, start),
        twin=Twinned(robot, alone.simulation.twin) if alone.simulation.plant == "twin" else None,
        scenario=dump(alone),
    )  # fmt: skip
    _check_length(made, alone)
    _check_start(made, alone)
    return made


def warnings(scenario: Scenario) -> list[str]:
    """What will run but is probably a mistake, one sentence each.

    A reference beyond the robot's limits; a stick file that ends before the run does, or begins
    after it.
    """
    alone = standing_alone(scenario, Path())
    reference = alone.reference.spline()
    found = _beyond_limits(alone, reference)
    found += [f"world: {note}" for note in alone.scenery().left_out]
    recorded_stick, _ = _recorded_stick(alone)
    if alone.simulation.plant == "twin" and not alone.simulation.wheel_limits:
        found.append("simulation.wheel_limits: the twin's wheels always have their limits")
    run_s = alone.simulation.duration_s or reference.duration
    played = isinstance(alone.stick, StickFile)
    if played and recorded_stick.times[0] >= run_s:
        found.append(
            f"stick: the file begins at {recorded_stick.times[0]:.1f} s, and the run ends at "
            f"{run_s:.1f} s, so nothing of it is played; set stick.start_s to shift its times"
        )
    elif played and recorded_stick.times[-1] < run_s:
        found.append(
            f"stick: the file ends at {recorded_stick.times[-1]:.1f} s of {run_s:.1f} s; "
            "from then on the stick is centred and the controller leads"
        )
    return found


def _settings(alone: Scenario, robot: RobotModel, limits: Limits) -> Settings:
    made = alone.law.settings(
        robot.outline, limits, alone.reference.speed_mps, alone.simulation.step_s
    )
    return made._replace(spline_speed=alone.reference.feed_forward == "spline")


def _piloted(
    alone: Scenario, robot: RobotModel, limits: Limits, obstacles: World, start: Pose
) -> Piloted | None:
    """What a run with the guard needs beyond the rest; None for the paper's law."""
    law = alone.law
    if law.filter != "guard":
        return None
    lidars: tuple[LidarModel, ...] = ()
    if alone.senses == "lidar":
        if robot.lidar is None:
            raise CohelmError(
                f"{alone.name}: senses: {robot.name} has no LiDAR; describe one in the robot's "
                "YAML file, or set senses to truth"
            )
        lidars = checked_sight(robot).lidars
    acceleration = law.guard.obstacle_acceleration_mps2
    return Piloted(
        settings=_settings(alone, robot, limits),
        max_acceleration=np.where(ever_moving(obstacles), acceleration, 0.0),
        lidars=lidars,
        tracker_params=TrackerParams(max_acceleration=acceleration),
        path_params=law.path_params(),
        replan_params=law.replan_params(),
        period=law.plan.period_s,
        zones=UNZONED if alone.zones is None else alone.zones.read(start),
    )


def _recorded_stick(alone: Scenario) -> tuple[StickRecording, Scenario]:
    """The stick's table, and the scenario with the digest of the file it came from."""
    stick = alone.stick
    if isinstance(stick, StickScript):
        t, x, psi = np.array(stick.events, dtype=np.float64).T
        return replay(t, x, psi), alone
    if not isinstance(stick, StickFile):
        return replay(), alone
    table = sticks.read(stick.path, stick.run, stick.source, stick.full_scale, stick.clip)
    now = digest(sticks.file_of(stick.path))
    if stick.sha256 is not None and stick.sha256 != now:
        raise CohelmError(
            f"{stick.path}: the stick file has changed since this scenario was written down "
            "(its sha256 differs); remove stick.sha256 to play it as it is now"
        )
    named = alone.model_copy(update={"stick": stick.model_copy(update={"sha256": now})})
    return table._replace(times=table.times + stick.start_s), named


def _check_length(made: Setup, alone: Scenario) -> None:
    row = ROW.itemsize + 56 * len(made.names)  # h and a disc's row for each obstacle
    steps = made.steps
    if steps * row > _LARGEST_RUN:
        longest = _LARGEST_RUN / row * made.dt
        raise CohelmError(
            f"{alone.name}: simulation: {steps:.3g} steps of {made.dt:g} s would take "
            f"{steps * row / 2**30:.3g} GiB to hold; at most {longest:.3g} s fit: "
            "shorten duration_s or raise step_s"
        )
    if made.twin is not None and made.twin.robot.delay_s + made.delay > LONGEST_DELAY:
        raise CohelmError(
            f"{alone.name}: simulation.delay_s: {made.delay:g} s and the robot's own "
            f"{made.twin.robot.delay_s:g} s are more than the {LONGEST_DELAY:g} s that a twin can "
            "be late: shorten it, or set simulation.plant to kinematic"
        )
    if made.delay_steps > steps:
        raise CohelmError(
            f"{alone.name}: simulation.delay_s: {made.delay:g} s is longer than the run, so no "
            "command would reach the wheels"
        )


def _check_start(made: Setup, alone: Scenario) -> None:
    """The real outline stands clear of everything at t = 0."""
    for i, obstacle in enumerate(alone.obstacles):
        x, y = obstacle.start
        clearance = disc_clearance(made.start, made.outline, x, y, obstacle.radius_m)
        _check_clearance(clearance, made.start, alone, f"obstacle {obstacle.name} (obstacles.{i})")
    for i, wall in enumerate(alone.walls_m):
        clearance = segment_clearance(made.start, made.outline, *wall)
        _check_clearance(
            clearance, made.start, alone, f"the wall from {wall[:2]} to {wall[2:]} (walls_m.{i})"
        )
    _check_world(made, alone)


def _check_world(made: Setup, alone: Scenario) -> None:
    """The same for what the world's file holds; on a map the robot stands in no solid cell."""
    clearance = outline_clearance(
        made.start, made.outline, made.reach,
        made.obstacles.discs[len(alone.obstacles) :],
        made.obstacles.walls[len(alone.walls_m) :], NOWHERE,
    )  # fmt: skip
    _check_clearance(clearance, made.start, alone, "something of the world's file")
    if solid_at(made.grid, made.start.x, made.start.y):
        _check_clearance(-1.0, made.start, alone, "a solid cell of the map")


def _check_clearance(clearance: float, start: Pose, alone: Scenario, what: str) -> None:
    if clearance <= 0.0:
        raise CohelmError(
            f"{alone.name}: start: the robot at ({start.x:g}, {start.y:g}) m, heading "
            f"{math.degrees(start.psi):.0f} deg, stands {-clearance:.3f} m inside {what}; "
            "move one of them"
        )


def _beyond_limits(alone: Scenario, reference: Reference) -> list[str]:
    """Where the reference exceeds the robot's limits most. Under the guard it slows down where it
    turns."""
    robot = alone.described()
    limits = robot.bounds()
    steps = min(max(round(reference.duration / 0.01), 2000), 1_000_000)
    table = tabulate(reference, reference.duration / steps, steps, True)
    rate: Floats = np.ones(len(table))
    if alone.law.filter == "guard":
        pace = _settings(alone, robot, limits).pace
        rate = profile(reference, np.full(len(table), math.inf), pace).rate
    speed, yaw_rate = rate * np.abs(table[:, 3]), rate * np.abs(table[:, 4])
    rim = speed + 0.5 * limits.track * yaw_rate
    requested = (
        ("a speed", speed, limits.speed, "m/s"),
        ("a yaw rate", yaw_rate, limits.yaw_rate, "rad/s"),
        ("a wheel speed", rim, limits.wheel_speed, "m/s"),
    )
    found: list[str] = []
    for what, series, bound, unit in requested:
        worst = int(series.argmax())
        if series[worst] > bound:
            t = worst * reference.duration / steps
            found.append(
                f"reference: asks for {what} of {series[worst]:.2f} {unit} at t = {t:.1f} s, but "
                f"{robot.name} has {bound:g} {unit}; lower speed_mps or smooth the waypoints"
            )
    return found
