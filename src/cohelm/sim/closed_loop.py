"""A run with the pilot: the robot sees, plans now and then, and drives by what it knows.

With a LiDAR it sees as the robot's loop does, `perceive.pipeline`, with odometry that is exact:
what stands as points, what moves as discs with velocities that it has estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.flat import Flat, flat, made, read, write
from cohelm.core.jit import jit
from cohelm.core.obstacles import Surroundings
from cohelm.core.trace import Trace
from cohelm.core.types import Floats, Pose, StickRecording
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.pilot.behavior import LED
from cohelm.pilot.pilot import NOTHING_NEAR, taken
from cohelm.pilot.replanning import Planner, Task
from cohelm.pilot.step import START, PilotState, Settings, limit_speed, pilot_step
from cohelm.plan.course import Course, course, nearly_done, route
from cohelm.plan.evasion.movers import empty_mover_history
from cohelm.plan.zones import Zoned
from cohelm.robot.achievable import stopping_distance
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.sim.grid import Grid
from cohelm.sim.lidar import noise_seed, scan
from cohelm.sim.odometer import next_reading_tick
from cohelm.sim.operator_model import IDLE, OperatorModel, OperatorState, operate
from cohelm.sim.setup import Piloted, Setup
from cohelm.sim.simulated import SimulatedLidar
from cohelm.sim.wheels import SimulatedState, at_rest, moved, note
from cohelm.sim.world import NOWHERE, World, outline_clearance, place

_NEAR = 8.0  # walls farther than this from the robot may be left out of a stretch of steps [m]
_FEW = 64  # up to so many walls, all are kept


class Scene(NamedTuple):
    """What stays the same during a run."""

    obstacles: World
    grid: Grid
    max_acceleration: Floats
    recorded_stick: StickRecording
    operator: OperatorModel
    seed: int
    reach: float
    goal: Floats
    """(2,), the end of the reference [m]."""
    near: float
    """Nearer to the goal than this, the robot has arrived [m], ..."""
    done: int
    """... if the row of the route where it is is this one, or a later one."""
    barred: Floats
    """(s, 4), the walls that a LiDAR sees besides the map's [m]."""
    sees: bool
    """Whether the robot drives by its LiDAR; else it is given the true obstacles."""


class Now(NamedTuple):
    """The run between two steps."""

    robot: SimulatedState
    pilot: PilotState
    person: OperatorState
    seen_obstacles: Surroundings
    """What it sees now, world frame; nothing for a robot that does not see."""
    led: bool
    arrived: bool


def pieces(setup: Setup, piloted: Piloted, length: int) -> Iterator[Trace]:
    """The run in traces of at most `length` steps; it ends when the robot has arrived."""
    wanted, settings = route(setup.reference), piloted.settings
    planner = Planner(wanted, settings, piloted.path_params, piloted.replan_params)
    scene = Scene(
        setup.obstacles, setup.grid, piloted.max_acceleration, setup.recorded_stick,
        setup.operator, setup.seed, setup.reach, np.array(setup.goal), setup.near,
        nearly_done(wanted.line, setup.near), setup.obstacles.walls if setup.barred is None
        else setup.barred, bool(piloted.lidars),
    )  # fmt: skip
    start, dt, delay, steps = setup.start, setup.dt, setup.delay_steps, setup.steps
    eyes = None
    if piloted.lidars:
        first, *further = piloted.lidars
        eyes = Perception(
            first.lidar(), tracker_params=piloted.tracker_params, outline=settings.outline,
            further=further,
            stopping=stopping_distance(settings.limits, delay * dt + piloted.scan_age),
        )  # fmt: skip
    scanners = [
        SimulatedLidar(one, noise_seed(scene.seed, i), 0) for i, one in enumerate(piloted.lidars)
    ]
    zones = None
    if piloted.zones:
        zones = Zoned(piloted.zones, settings.outline, settings.gains.u_d, settings.limits)
    queue, sent, mover_history = np.zeros((delay, 2)), np.zeros((delay, 2)), empty_mover_history()
    period = max(round(piloted.period / dt), 1)
    thinking = min(round(piloted.thinking / dt), period - 1)
    now = Now(at_rest(start), START, IDLE, NOTHING_NEAR, False, False)
    current = course(wanted.reference, 0, True, settings.pace)
    number, since, waiting, unobserved, scans = 0, 0, None, slice(0, 0), 0
    reaction = (period + delay) * dt
    walls = near_walls(scene.obstacles.walls, start, settings, reaction)
    limited, constant = flat(settings), flat(scene)
    limit_speed(limited[0], settings, math.inf)
    k, written = 0, 0
    out = setup.blank(min(length, steps))
    while k < steps and not now.arrived:
        fresh = False
        if eyes is not None:
            perceived = look(k, dt, now.robot, scene, scanners, eyes)
            now, unobserved = now._replace(seen_obstacles=perceived.obstacles), perceived.unobserved
            fresh, scans = perceived.scans != scans, perceived.scans
        seen = now.seen_obstacles
        if zones is not None:
            now = now._replace(seen_obstacles=zones.beside(seen, now.robot.pose))
            limit_speed(limited[0], settings, zones.limit(now.robot.pose)[0])
        if k % period == 0:
            walls = near_walls(scene.obstacles.walls, now.robot.pose, settings, reaction)
            seen_obstacles = known(k * dt, now.seen_obstacles, walls, scene)
            task = Task(
                now.pilot, now.robot.pose, now.robot.applied, seen_obstacles, current,
                (k - since) * dt, now.led, unobserved=unobserved,
            )  # fmt: skip
            waiting = planner(task)
        if waiting is not None and k % period == thinking:
            here, applied = now.robot.pose, now.robot.applied
            now = now._replace(pilot=taken(now.pilot, waiting, planner, here, applied))
            current = waiting.course
            if waiting.new:
                number, since = number + 1 if current.row else 0, k
            waiting = None
        upto = min(_next(k, period, thinking), steps, k + len(out) - written)
        if eyes is not None or zones is not None:
            upto = k + 1  # movers are predicted anew in every step, as in the loop
        part = slice(written, written + upto - k)
        state = flat(now)
        done = _advance(
            k, dt, state, flat(current), number, wanted.line, limited, constant, walls,
            queue, sent, mover_history, fresh, out.rows[part], out.h[part], out.discs[part],
        )  # fmt: skip
        now = made(Now, state[0].tolist(), 0, state[1])._replace(seen_obstacles=seen)
        k, written = k + done, written + done
        if written == len(out) or now.arrived or k == steps:
            yield out.until(written)
            out, written = setup.blank(max(min(length, steps - k), 0)), 0


def _next(k: int, period: int, thinking: int) -> int:
    """The next step after k at which a plan is begun or taken up."""
    at = k % period
    return k - at + (thinking if at < thinking else period)


def near_walls(walls: Floats, pose: Pose, settings: Settings, reaction: float) -> Floats:
    """The walls that come near the robot within a stretch of steps, and before it can stop.
    reaction: from one stretch to the next, with the delay [s]."""
    if len(walls) <= _FEW:
        return walls
    reach = farthest_corner(settings.outline)
    stopping = stopping_distance(settings.limits, reaction)
    near = max(_NEAR, reach + stopping) if math.isfinite(stopping) else _NEAR
    low = np.minimum(walls[:, :2], walls[:, 2:]) - near
    high = np.maximum(walls[:, :2], walls[:, 2:]) + near
    here = np.array(pose[:2])
    return walls[((low < here) & (here < high)).all(axis=1)]


def look(
    k: int, dt: float, robot: SimulatedState, scene: Scene, scanners: Sequence[SimulatedLidar],
    eyes: Perception,
) -> Seen:  # fmt: skip
    """What the robot sees in step k, with the scans that are due."""
    first, *further = (
        _scanned(k, dt, robot.pose, scene, one) if k == one.next else None for one in scanners
    )
    odometry = Odometry(k * dt, robot.pose, robot.applied)
    new = tuple(one for one in further if one is not None)
    return eyes.take(k * dt, Readings(odometry, first, further=new))


def _scanned(k: int, dt: float, pose: Pose, scene: Scene, scanner: SimulatedLidar) -> Scan:
    lidar, number = scanner.lidar, scanner.number
    scanner.next = next_reading_tick(k, scanner.model.rate_hz, dt)
    discs = np.empty((len(scene.obstacles.discs), 6))
    place(discs, scene.obstacles, k * dt)
    ranges = np.empty(len(lidar.beams))
    scan(pose, lidar, discs, scene.barred, scene.grid, scanner.seed, number, ranges)
    scanner.number += 1
    return Scan(k * dt, k, ranges, 0.0, scanner.model.name)


def known(t: float, seen_obstacles: Surroundings, walls: Floats, scene: Scene) -> Surroundings:
    """What the robot knows of its surroundings at time t: what it sees, or all there is."""
    if scene.sees:
        return seen_obstacles
    discs = np.empty((len(scene.obstacles.discs), 6))
    place(discs, scene.obstacles, t)
    return Surroundings(
        discs, scene.max_acceleration, np.zeros(len(discs)), walls, seen_obstacles.points
    )


_known = jit(known)  # called from Python it unpacks the scene, which takes longer than all it does


@jit
def _advance(
    first: int, dt: float, flat_now: Flat, flat_course: Flat, number: int, line: Floats,
    flat_settings: Flat, flat_scene: Flat, walls: Floats, queue: Floats, sent: Floats,
    mover_history: Floats, fresh: bool, rows: NDArray[np.void], h: Floats, discs: Floats,
) -> int:  # fmt: skip
    """Steps first ... first + len(rows) - 1, fewer on arrival; how many they were. fresh: whether
    the first one has a new scan.

    `core.flat`: of `Now`, which is written into, `Course`, `Settings` and `Scene`. To unpack and
    pack them as they are takes longer than a step.
    """
    now = read(Now, flat_now[0], 0, flat_now[1])
    course = read(Course, flat_course[0], 0, flat_course[1])
    settings = read(Settings, flat_settings[0], 0, flat_settings[1])
    scene = read(Scene, flat_scene[0], 0, flat_scene[1])
    robot, pilot, person, seen_obstacles = now.robot, now.pilot, now.person, now.seen_obstacles
    led, arrived = now.led, now.arrived
    done = 0
    for j in range(len(rows)):
        k = first + j
        pose, before = robot.pose, robot.applied
        there = discs[j]
        place(there, scene.obstacles, k * dt)
        obstacles = _known(k * dt, seen_obstacles, walls, scene)
        person, stick = operate(
            person, scene.operator, scene.recorded_stick, pose, there, scene.obstacles.noticed, k,
            dt, scene.seed,
        )  # fmt: skip
        pilot, d = pilot_step(
            pilot, pose, before, stick, obstacles, course, line, settings, dt, sent, mover_history,
            fresh and j == 0,
        )  # fmt: skip
        led = d.behavior == LED
        robot, saturated = moved(
            k, dt, robot, d.safe, stick, settings.gains, settings.limits, queue
        )
        away = math.hypot(pose.x - scene.goal[0], pose.y - scene.goal[1])
        arrived = away < scene.near and pilot.row >= scene.done
        row = rows[j]
        note(row, h[j], k * dt, pose, stick, d.desired, d, robot, saturated, there)
        row.h = h[j].min() if len(there) > 0 else math.inf
        row.clearance = outline_clearance(
            pose, settings.outline, scene.reach, there, walls, NOWHERE
        )
        row.course, row.to_go, row.arrived = number, away, arrived
        done = j + 1
        if arrived:
            break
    write(Now(robot, pilot, person, seen_obstacles, led, arrived), flat_now[0], 0)
    return done
