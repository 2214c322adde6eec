"""The physics twin: its speed, its accuracy, and what the guard must assume of it.

`python benchmarks/twin.py` prints tables for docs/twin.md; `--quick` for a look.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.guard.bounds import braked
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.robot.model import RobotModel
from cohelm.scenario import load
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.camera import camera
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import TwinModel, lag
from cohelm.sim.world import Body, World, world

DT = 0.02
EMPTY = world(([], np.empty((0, 4))))


def lab() -> tuple[RobotModel, Pose, World]:
    made = load.scenario("lab-avoid", [])
    assert made.start is not None
    start = Pose(made.start.x_m, made.start.y_m, made.start.heading_rad)
    return load.robot("sally"), start, made.build_world()


def field(count: int) -> World:
    """So many cylinders, as in a BARN world."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-10.0, 10.0, (count, 2))
    return world(([Body((x, y, 0.0, 0.0, 0.075, 0.3)) for x, y in at if math.hypot(x, y) > 1.5],
                  np.empty((0, 4))))  # fmt: skip


def drive(robot: Twin | Kinematic, twist: Twist, seconds: float) -> None:
    end = robot.now() + seconds - 1e-9
    while robot.now() < end:
        robot.send(twist)
        robot.wait(robot.now() + DT)
        robot.read()


def rates(seconds: float) -> list[tuple[str, float, float]]:
    """How many times faster than real time, wall and CPU, with LiDAR and without camera."""
    sally, start, course = lab()
    found: list[tuple[str, float, float]] = []
    for name, place, obstacles in (
        ("nothing around", Pose(0.0, 0.0, 0.0), EMPTY), ("the lab", start, course),
        ("200 cylinders", Pose(0.0, 0.0, 0.0), field(200)),
    ):  # fmt: skip
        robot = Twin(sally, place, obstacles, camera="none")
        drive(robot, Twist(0.2, 0.6), 1.0)
        wall, cpu = time.perf_counter(), time.process_time()
        drive(robot, Twist(0.2, 0.6), seconds)
        found.append((name, seconds / (time.perf_counter() - wall),
                      seconds / (time.process_time() - cpu)))  # fmt: skip
    return found


def pictures(count: int) -> list[tuple[str, int, int, float, float]]:
    """Milliseconds for a picture of the lab: wall and CPU."""
    sally, start, course = lab()
    robot = Twin(sally, start, course, camera="none")
    robot.wait(0.1)
    robot.truth()
    found: list[tuple[str, int, int, float, float]] = []
    for kind, width, height in (("auto", 640, 480), ("rays", 320, 240)):
        drawn = camera(robot.mujoco, width, height, kind)  # pyright: ignore
        drawn.draw(robot.data)
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(count):
            drawn.draw(robot.data)
        found.append((drawn.says, width, height, 1e3 * (time.perf_counter() - wall) / count,
                      1e3 * (time.process_time() - cpu) / count))  # fmt: skip
        drawn.close()
    return found


def reached(robot: Twin | Kinematic, commanded: Twist) -> Twist:
    """Mean speeds in the second second."""
    drive(robot, commanded, 2.0)
    a = robot.truth()
    drive(robot, commanded, 2.0)
    b = robot.truth()
    turned, chord = b.pose.psi - a.pose.psi, math.dist(a.pose[:2], b.pose[:2])
    way = chord if abs(turned) < 1e-3 else chord * 0.5 * turned / math.sin(0.5 * turned)
    return Twist(math.copysign(way, commanded.v) / 2.0, turned / 2.0)


def stopped(robot: Twin | Kinematic, commanded: Twist) -> tuple[float, float, float]:
    """From driving steadily to standing: way [m], turn [rad], time [s]."""
    drive(robot, commanded, 2.0)
    a = robot.truth()
    way, last = 0.0, a
    while True:
        robot.send(Twist(0.0, 0.0))
        robot.wait(robot.now() + DT)
        now = robot.truth()
        way += math.dist(last.pose[:2], now.pose[:2])
        last = now
        if abs(now.twist.v) + abs(now.twist.omega) < 0.01:
            return way, now.pose.psi - a.pose.psi, now.stamp - a.stamp


class Errors(NamedTuple):
    """Distance of the outline's corners from their predicted stop [m]."""

    in_step: float
    """While the command is held: assumption 2."""
    braking: float
    """Largest along the stop: assumption 3."""
    typical: float
    """Median over the stops of the largest along each."""
    longer: float
    """Largest excess of the stop over its prediction."""


def predicted(
    model: RobotModel, settings: TwinModel, delay: float, episodes: int, commanded: bool = True
) -> Errors:
    """Hold a command for a step and brake, from random driving: the twin beside the arithmetic.

    delay: from command to wheels as the guard assumes it, in whole control steps [s]. The twist
    that the arithmetic starts from is the one commanded a delay ago, or the measured one.
    """
    rng = np.random.default_rng(3)
    limits, outline = model.bounds(), model.outline
    steps = round(delay / DT)
    in_step, worst, longer, each = 0.0, 0.0, 0.0, []
    for _ in range(episodes):
        robot = Twin(model, settings=settings, camera="none")
        command, sent = Twist(0.0, 0.0), [Twist(0.0, 0.0)] * (steps + 1)
        for k in range(int(rng.integers(40, 120))):
            if k % 15 == 0:
                nominal = Twist(rng.uniform(-1.0, 1.0) * limits.speed,
                             rng.uniform(-1.0, 1.0) * limits.yaw_rate)  # fmt: skip
            command = achievable(nominal, command, limits, DT)
            robot.send(command)
            sent.append(command)
            robot.wait(robot.now() + DT)
        now = robot.truth()
        coming = sent[len(sent) - steps :] if steps else []
        before = sent[-steps - 1] if commanded else now.twist
        pose, twist, poses, held = now.pose, before, [now.pose], command
        stop: list[Twist] = []
        while held != Twist(0.0, 0.0):
            held = braked(held, limits, DT)
            stop.append(held)
        for order in (*coming, *stop):
            twist = achievable(order, twist, limits, DT)
            pose = arc(pose, twist, DT)
            poses.append(pose)
        off = []
        for k in range(len(poses) - 1 + 5):
            robot.send(stop[k] if k < len(stop) else Twist(0.0, 0.0))
            robot.wait(robot.now() + DT)
            off.append(apart(outline, robot.truth().pose, poses[min(k + 1, len(poses) - 1)]))
        in_step = max(in_step, *off[: steps + 1])
        each.append(max(off))
        worst = max(worst, max(off))
        end = robot.truth().pose
        ahead = math.cos(pose.psi) * (end.x - pose.x) + math.sin(pose.psi) * (end.y - pose.y)
        longer = max(longer, ahead * math.copysign(1.0, before.v))
    return Errors(in_step, worst, float(np.median(each)), longer)


def apart(outline: Floats, a: Pose, b: Pose) -> float:
    """How far any corner is from itself [m]."""

    def placed(pose: Pose) -> Floats:
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        return outline @ np.array([[c, s], [-s, c]]) + pose[:2]

    return float(np.hypot(*(placed(a) - placed(b)).T).max())


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--quick", action="store_true")
    quick = arguments.parse_args().quick
    sally = load.robot("sally")

    print("\n| around the robot | × real time | of CPU time |\n|---|---|---|")
    for name, wall, cpu in rates(10.0 if quick else 60.0):
        print(f"| {name} | {wall:.0f} | {cpu:.0f} |")

    print("\n| camera | size | wall ms | CPU ms |\n|---|---|---|---|")
    for says, width, height, wall, cpu in pictures(5 if quick else 30):
        print(f"| {says} | {width} × {height} | {wall:.0f} | {cpu:.0f} |")

    print("\n| asked | twin | kinematic |\n|---|---|---|")
    for commanded in (Twist(1.0, 0.0), Twist(0.0, 1.0), Twist(0.5, 0.5), Twist(-0.5, 0.0)):
        got = [reached(make(sally), commanded) for make in (_twin, Kinematic)]
        cells = " | ".join(f"{t.v:.4f} m/s, {t.omega:.4f} rad/s" for t in got)
        print(f"| {commanded.v:g} m/s, {commanded.omega:g} rad/s | {cells} |")

    print("\n| stop from | twin | kinematic |\n|---|---|---|")
    for commanded in (Twist(0.5, 0.0), Twist(1.0, 0.0), Twist(0.0, 1.5), Twist(0.5, 0.5)):
        got = [stopped(make(sally), commanded) for make in (_twin, Kinematic)]
        cells = " | ".join(f"{way:.3f} m, {turn:.3f} rad, {t:.2f} s" for way, turn, t in got)
        print(f"| {commanded.v:g} m/s, {commanded.omega:g} rad/s | {cells} |")

    episodes = 10 if quick else 100
    print("\n| twin | delay assumed | in the step | along the stop (median) | longer |")
    print("|---|---|---|---|---|")
    commanded = [("as it comes", TwinModel(), delay) for delay in (0.04, 0.06, 0.08, 0.10)]
    for label, physics in (
        ("lag 10 ms", TwinModel(wheel_lag_s=0.01)), ("lag 50 ms", TwinModel(wheel_lag_s=0.05)),
        ("friction 0.3", TwinModel(friction=0.3)), ("friction 0.15", TwinModel(friction=0.15)),
    ):  # fmt: skip
        commanded.append((label, physics, lag(sally, physics, DT)))
    for label, physics, delay in commanded:
        mm = [1e3 * value for value in predicted(sally, physics, delay, episodes)]
        print(
            f"| {label} | {delay * 1e3:.0f} ms | {mm[0]:.1f} mm | {mm[1]:.1f} mm "
            f"({mm[2]:.1f}) | {mm[3]:.1f} mm |"
        )


def _twin(model: RobotModel) -> Twin:
    return Twin(model, camera="none")


if __name__ == "__main__":
    main()
