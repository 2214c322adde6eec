"""The 50 open BARN worlds, LiDAR only: `python benchmarks/barn.py [--known] [--seeds N]`."""

from __future__ import annotations

import argparse
import math
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import Clock, Pace, Profile, govern, governed, nearest_ahead, profile
from cohelm.law.guard.step import BRAKING, STANDING, Rules, guard
from cohelm.law.guard.surroundings import Surroundings
from cohelm.law.reference import Reference, evaluate, through
from cohelm.law.track import track
from cohelm.perceive.band import spread
from cohelm.perceive.chart import swept
from cohelm.perceive.escape import Escape, escape, rest, wish
from cohelm.perceive.memory import Care, View, renew
from cohelm.perceive.way import Manners, way
from cohelm.robot.footprint import disc_clearance
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from cohelm.robot.sensors import Lidar, LidarModel
from cohelm.scenario.load import robot
from cohelm.scenario.worlds.barn import Barn, read_collection, score
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "barn" / "worlds.json"
DT = 0.02
SCANS = 30.0  # per second
PLAN_STEPS = 10  # between two plans
PLAN_DELAY = 2  # control steps from the start of planning until a plan takes effect
PACE = Pace(lateral=2.5, yaw_rate=3.0, deceleration=3.0, rise=4.0, fall=8.0)
RULES = Rules(dt=DT, margin=0.03, clear=0.015)
GAINS = Gains(k_x=1.0, k_psi=5.0)
MANNERS = Manners()
CARE = Care()


class Result(NamedTuple):
    number: int
    seed: int
    arrived: bool
    time: float
    score: float
    contact: bool
    gap: float
    shaped: int
    braked: int
    plans: int
    failed: int
    escapes: int
    length: float


class Drive(NamedTuple):
    """The episode between two plans."""

    k: int
    pose: Pose
    twist: Twist
    clock: Clock
    left: Escape
    gap: float
    shaped: int
    braked: int
    arrived: bool


class Plan(NamedTuple):
    reference: Reference
    paced: Profile


@jit
def drive(
    d: Drive, steps: int, plan: Plan, points: Floats, lidar: Lidar, view: View, care: Care,
    discs: Floats, outline: Floats, limits: Limits, gains: Gains, pace: Pace, rules: Rules,
    seed: int, sees: bool, goal: tuple[float, float], near: float,
) -> tuple[Drive, Floats]:  # fmt: skip
    """`steps` control steps: see, govern, track, guard, move; the truth is looked at last."""
    ranges = np.empty(len(lidar.beams))
    nothing, nobody, no_walls = np.empty((0, 6)), np.empty(0), np.empty((0, 4))
    k, pose, twist, clock, left = d.k, d.pose, d.twist, d.clock, d.left
    gap, shaped, braked, arrived = d.gap, d.shaped, d.braked, d.arrived
    dt = rules.dt
    for _ in range(steps):
        number = int(k * dt * SCANS)
        if sees and (k == 0 or number != int((k - 1) * dt * SCANS)):
            scan(pose, lidar, discs, no_walls, NO_GRID, seed, number, ranges)
            points = renew(points, pose, view, ranges, care)
        if left.distance != 0.0 or left.turn != 0.0:
            wanted = wish(left, 0.4, 1.5, dt)
        else:
            clock = govern(clock, pose, plan.reference, plan.paced, False, pace, dt)
            wanted = track(pose, governed(plan.reference, clock, pose, pace), gains)
        around = Surroundings(nothing, nobody, no_walls, points)
        passed = guard(pose, twist, wanted, around, outline, limits, rules)
        shaped += passed.culprit >= 0
        braked += passed.verdict == BRAKING or passed.verdict == STANDING
        twist = Twist(passed.v, passed.omega)
        if left.distance != 0.0 or left.turn != 0.0:
            left = rest(left, twist, dt)
        for part in range(1, 3):
            there = arc(pose, twist, 0.5 * part * dt)
            for i in range(len(discs)):
                dx, dy = discs[i, 0] - there.x, discs[i, 1] - there.y
                if dx * dx + dy * dy < 1.0:
                    c = disc_clearance(there, outline, discs[i, 0], discs[i, 1], discs[i, 4])
                    gap = min(gap, c)
        pose = arc(pose, twist, dt)
        k += 1
        if math.hypot(pose.x - goal[0], pose.y - goal[1]) < near:
            arrived = True
            break
    return Drive(k, pose, twist, clock, left, gap, shaped, braked, arrived), points


def surfaces(discs: Floats) -> Floats:
    around = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    x = discs[:, 0, None] + discs[:, 4, None] * np.cos(around)
    y = discs[:, 1, None] + discs[:, 4, None] * np.sin(around)
    return np.column_stack((x.ravel(), y.ravel()))


def plan(pose: Pose, points: Floats, line: Floats, outline: Floats, cruise: float) -> Plan | None:
    """The way on as a reference with its profile of speed; None if there is none."""
    found = way(pose, points, line, outline, MANNERS)
    if found is None or len(found.points) < 3:
        return None
    corners = np.vstack((found.points[:-1:2], found.points[-1:]))
    reference = through(corners, cruise)
    n = max(int(reference.duration * cruise / 0.05), 2)
    motions = [
        evaluate(reference.knots, reference.coeffs, float(t))
        for t in np.linspace(0.0, reference.duration, n)
    ]
    poses = np.array([(m.x, m.y, math.atan2(m.vy, m.vx)) for m in motions])
    return Plan(reference, profile(reference, swept(points, outline, poses), PACE))


def episode(world: Barn, seed: int, known: bool, cruise: float) -> Result:
    """One drive. A plan made at one instant takes effect PLAN_DELAY steps later."""
    jackal = robot("jackal")
    outline, limits = jackal.outline, jackal.bounds()
    lidar = LidarModel(noise_m=0.01, mount_x_m=0.12, rate_hz=SCANS).lidar()
    view = View(lidar.mount, lidar.first, lidar.step, lidar.range_min)
    points = surfaces(world.discs) if known else np.empty((0, 2))
    line = spread(world.route, 0.1)
    none = Escape(0.0, 0.0, 0.0)
    d = Drive(0, world.start, Twist(0.0, 0.0), Clock(0.0, 0.0, 0.0), none, math.inf, 0, 0, False)
    current = plan(d.pose, np.empty((0, 2)), line, outline, cruise)
    assert current is not None
    plans = failed = escapes = 0
    length = 0.0
    while d.k * DT < world.time_limit and not d.arrived:
        found = plan(d.pose, points, line, outline, cruise) if d.k else current
        plans += 1
        failed += found is None
        left = d.left
        for steps in (PLAN_DELAY, PLAN_STEPS - PLAN_DELAY):
            was = d.pose
            d, points = drive(
                d, steps, current, points, lidar, view, CARE, world.discs, outline, limits,
                GAINS, PACE, RULES, seed, not known, world.goal, world.near_goal,
            )  # fmt: skip
            length += math.hypot(d.pose.x - was.x, d.pose.y - was.y)
            if d.arrived:
                break
            if found is not None:  # what was planned meanwhile takes over, as far as it is done
                current, found = found, None
                tau = nearest_ahead(current.reference, d.pose, 0.0, 0.5)
                rate = min(max(d.twist.v / cruise, 0.0), 1.0)
                d = d._replace(clock=Clock(tau, rate, d.clock.waited))
        if d.left == left:  # held up, or none
            d = d._replace(left=none)
        ahead = governed(current.reference, d.clock, d.pose, PACE)
        off = math.remainder(ahead.psi - d.pose.psi, 2.0 * math.pi)
        if d.left == none and (abs(off) > 1.2 or d.clock.waited > 1.0):
            move = escape(d.pose, ahead.psi, points, outline)
            if move is not None and abs(off) < 0.3 and move.distance == 0.0:
                move = Escape(-0.2, 0.0, 0.0)  # looks where it should, but does not get on
            if move is not None:
                escapes += 1
                d = d._replace(left=move, clock=Clock(d.clock.tau, 0.0, 0.0))
    took = d.k * DT
    arrived = d.arrived and d.gap > 0.0
    return Result(
        world.number, seed, arrived, took, score(world.optimal_time, took, arrived),
        d.gap <= 0.0, d.gap, d.shaped, d.braked, plans, failed, escapes, length,
    )  # fmt: skip


def _one(job: tuple[Barn, int, bool, float]) -> Result:
    return episode(*job)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--known", action="store_true", help="obstacles known, no LiDAR")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--cruise", type=float, default=1.5, help="m/s")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--worlds", type=int, nargs="*")
    given = parser.parse_args()
    worlds = read_collection(DATA, 0.27)
    chosen = given.worlds or sorted(worlds)
    jobs = [
        (worlds[n], seed, given.known, given.cruise) for seed in range(given.seeds) for n in chosen
    ]
    begin = time.perf_counter()
    with ProcessPoolExecutor(given.jobs) as pool:
        results = list(pool.map(_one, jobs))
    wall = time.perf_counter() - begin
    print(
        "world seed arrived  time  2OT    score   gap    shaped braked  plans failed escapes length"
    )
    for r in results:
        w = worlds[r.number]
        print(
            f"{r.number:5d} {r.seed:4d} {r.arrived!s:7} {r.time:6.2f} {2 * w.optimal_time:6.2f} "
            f"{r.score:6.3f} {r.gap:7.4f} {r.shaped:6d} {r.braked:6d} {r.plans:5d} "
            f"{r.failed:6d} {r.escapes:7d} {r.length:6.2f}{'  CONTACT' if r.contact else ''}"
        )
    print(
        f"arrived {sum(r.arrived for r in results)} of {len(results)}, "
        f"contacts {sum(r.contact for r in results)}, "
        f"mean score {np.mean([r.score for r in results]):.4f}, "
        f"least gap {min(r.gap for r in results):.4f} m, "
        f"wall {wall:.1f} s on {given.jobs} processes"
    )


if __name__ == "__main__":
    main()
