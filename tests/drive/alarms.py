"""Counts false alarms of the plausibility monitor.

Episodes of the campaigns, driven by their own fast simulation; what odometry and LiDAR would have
read along them, errors and all, is given to the monitor: `python -m tests.drive.alarms random`.

Recorded people leave the recording wherever they are, three or four who walk together at once; in
the campaign they are gone from one instant to the next. Nobody does that: here they walk out of
the LiDAR's sight first.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np

from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.port import Readings, Scan
from cohelm.scenario.load import robot
from cohelm.scenario.worlds.tracks import ELSEWHERE
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from cohelm.sim.odometer import Odometer
from cohelm.study.campaign.episode import Interventions, traced
from cohelm.study.campaign.suites import suite

UNSEEN = (
    "the scan shows nothing at all: it does not confirm free space",
    "the LiDAR has not shown that it sees what lies ahead",
)
"""No alarm about a lie: so slow a robot is meant to be where nothing is within sight."""

_PACE, _PUSH = 1.3, 1.0  # at which people walk off [m/s, m/s^2]


class Leaving:
    """Lets people walk out of sight whose recording has ended."""

    def __init__(self, sight: float) -> None:
        self._sight = sight
        self._before: Floats | None = None
        self._off: dict[int, Floats] = {}

    def seen(self, discs: Floats, robot: Pose, dt: float) -> Floats:
        """Discs as the LiDAR sees them, those who leave among them; to be asked at every step."""
        out = discs.copy()
        there = np.abs(discs[:, 0]) < 0.5 * ELSEWHERE
        if self._before is not None:
            was = np.abs(self._before[:, 0]) < 0.5 * ELSEWHERE
            for which in np.flatnonzero(was & ~there).tolist():
                self._off[which] = self._before[which].copy()
        for which, row in list(self._off.items()):
            away = row[:2] - (robot.x, robot.y)
            distance = float(np.hypot(*away))
            if there[which] or distance > self._sight:
                del self._off[which]
                continue
            push = _PACE * away / max(distance, 1e-6) - row[2:4]
            row[2:4] += push * min(_PUSH * dt / max(float(np.hypot(*push)), 1e-6), 1.0)
            row[:2] += dt * row[2:4]
            out[which] = row
        self._before = discs
        return out


def alarms(made, number: int, said: Counter, shown: bool = False) -> float:
    """Counts what was done in one episode, once for each spell, and for how long in all [s]:
    faults, holds and slow-downs, and apart from them where the robot was slow for what it can not
    see.

    Returns how long the episode was [s].
    """
    case = made.case(number)
    setup, model = case.setup, robot(case.robot)
    lidar, rate = model.lidar.lidar(), model.lidar.rate_hz
    monitor = PlausibilityMonitor(model)
    odometer = Odometer(model.odometry, number)
    odometry, looked, before, t = odometer.start(0.0), None, "", 0.0
    half, count = 0.5 * model.track_m, 0
    last, leaving = None, Leaving(lidar.range_max + 1.0)
    for piece in traced(case, "guard", Interventions()):
        for row, discs in zip(piece.rows, piece.discs, strict=True):
            t = float(row["t"])
            pose = Pose(float(row["x"]), float(row["y"]), float(row["psi"]))
            people = leaving.seen(discs, pose, setup.dt)
            if last is not None:
                v, omega = float(last["applied_v"]), float(last["applied_omega"])
                left, right = (v - half * omega) * setup.dt, (v + half * omega) * setup.dt
                odometry = odometer.reading(t, setup.dt, left, right, omega * setup.dt)
            last = row
            if looked is None or t - looked.stamp >= 1.0 / rate - 1e-6:
                ranges = np.empty(len(lidar.beams))
                scan(
                    pose, lidar, np.ascontiguousarray(people), setup.obstacles.walls, NO_GRID,
                    number, count, ranges,
                )  # fmt: skip
                looked = Scan(t, count, ranges, 0.0)
                count += 1
            told = Twist(float(row["safe_v"]), float(row["safe_omega"]))
            readings = Readings(odometry, looked, None, None)
            got = monitor.observe(t, readings, told)
            if not got.fault and got.share == 1.0:
                got = monitor.restrict(t, told)
            what = "fault" if got.fault else "hold" if got.share == 0.0 else "slow"
            if what == "slow" and got.reason in UNSEEN:
                what = "unseen"
            now = f"{what}: {got.reason}" if got.reason else ""
            if now:
                said[f"{what}_s"] += setup.dt
            if now and now.split(":")[0] != before.split(":")[0]:
                said[what] += 1
                if shown:
                    print(f"  {made.name} {number} at {t:.1f} s: {now}", flush=True)
            before = now
            if got.fault:
                return t  # latched
    return t


def main() -> None:
    """Count."""
    parser = argparse.ArgumentParser()
    parser.add_argument("suite")
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--data", type=Path)
    given = parser.parse_args()
    made = suite(given.suite, given.seed, given.data)
    said, t, number = Counter(), 0.0, given.first
    while t < 3600.0 * given.hours:
        t += alarms(made, number, said, shown=True)
        number += 1
    out = {"suite": given.suite, "hours": t / 3600.0, "episodes": number - given.first, **said}
    print(json.dumps(out), flush=True)


if __name__ == "__main__":
    main()
