"""The lab on sensors only, through the whole loop in simulated time: path tracking errors.

python -m benchmarks.lab [--kind kinematic|twin] [--seeds 3] [--push 2.0 --at 22]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cohelm.core.scalars import wrap
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.law.verdict import UNTOUCHED
from cohelm.link.messages import Mode
from cohelm.pilot.behavior import FOLLOWING
from cohelm.robot.gate.modes import GateMode
from cohelm.sim.maker import Kind
from cohelm.study.campaign.suites import with_all_round_lidar

FREE = 0.5
"""The path is free where nothing is seen nearer than this to the outline [m], the guard changes
nothing, and the robot follows the requested route, without a detour or an operator;"""
NEAR, BACK = 0.03, 3.0
"""from when it has first come as near to the route again [m], or for so long had the time to [s].
The whole is counted from there: corners, slow places, and how far it swings over."""


class LabResult(NamedTuple):
    kind: str
    seed: int
    arrived: bool
    time: float
    """[s]"""
    least: float
    """Smallest gap of the real outline while the robot moved [m]."""
    path_rms: float
    """From the reference to the robot's true position when that took effect, where free [m]."""
    path_99: float
    free: float
    """Share of the drive in which the path was free."""
    located_rms: float
    """Position error while not lost [m]."""
    located_99: float
    heading_rms: float
    """[rad]"""
    found: float
    """After a push: until it was localised again to 5 cm [s]; NaN: was not pushed."""
    mode: str
    reason: str


def drive(
    kind: Kind, seed: int, push: float = 0.0, at: float = 22.0, limit: float = 120.0,
    scenario: str = "lab-guard", all_round: bool = False,
) -> LabResult:  # fmt: skip
    """One drive of the lab; at a time [s] it is pushed `push` metres to the east."""
    rows: list[tuple[float, ...]] = []
    pushed = found = math.nan
    made = simulated(scenario, kind, real_time=False, seed=seed)
    blind = made.model.model_copy(update={"camera": None})  # no viewer, and pictures take long
    blind = with_all_round_lidar(blind) if all_round else blind
    made = replace(made, scenario=made.scenario.model_copy(update={"robot": blind}))
    with Session(SessionConfig(made)) as session:
        gated, loop = session.loop.gated, session.loop

        def until(_: object) -> bool:
            nonlocal pushed, found
            now, truth, seen, d = gated.now(), gated.truth(), loop.seen, loop.decision
            assert seen is not None
            off = math.hypot(seen.pose.x - truth.pose.x, seen.pose.y - truth.pose.y)
            if d is not None:
                pilot = loop.driver.pilot
                on_route = pilot is not None and pilot.course.row == 0 and d.behavior == FOLLOWING
                free = float(on_route and d.clearance_seen > FREE and d.verdict == UNTOUCHED)
                turned = wrap(seen.pose.psi - truth.pose.psi)
                row = (now, *truth.pose[:2], *d.desired[:2], free, off, turned, float(seen.lost))
                rows.append(row)
            if push and math.isnan(pushed) and now >= at:
                gated._robot.push(push, 0.0, 0.0)
                pushed = now
            elif math.isnan(found) and now > pushed + 0.2 and off < 0.05 and not seen.lost:
                found = now - pushed
            return loop.driver.arrived or now > limit

        session.run(until, Mode.AUTOMATIC)
        truth, gate = gated.truth(), gated.gate
        arrived, time = loop.driver.arrived, gated.now()
    table = np.array(rows)
    ahead = round(session.plan.robot.delay(session.plan.period) / session.plan.period)
    there, wanted = table[ahead:, 1:3], table[:-ahead, 3:5]
    apart = np.hypot(*(there - wanted).T)
    free = back(table[:-ahead, 5] == 1.0, apart, round(BACK / session.plan.period))
    way = apart[free]
    known = table[table[:, 8] == 0.0]
    return LabResult(
        kind, seed, arrived, time, truth.least_moving, rms(way), float(np.percentile(way, 99)),
        float(free.mean()), rms(known[:, 6]), float(np.percentile(known[:, 6], 99)),
        rms(known[:, 7]), found, GateMode(gate.mode).name, gate.reason,
    )  # fmt: skip


def back(clear: np.ndarray, apart: np.ndarray, patience: int) -> np.ndarray:
    """Where the path is free, and has been since the robot was back on its route."""
    found, there, since = np.zeros(len(clear), dtype=bool), False, 0
    for k in range(len(clear)):
        since = since + 1 if clear[k] else 0
        there = bool(clear[k]) and (there or apart[k] < NEAR or since >= patience)
        found[k] = there
    return found


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kind", choices=["kinematic", "twin"], default="kinematic")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--push", type=float, default=0.0, help="metres to the east")
    parser.add_argument("--at", type=float, default=22.0, help="when; at 22 s in the corridor")
    args = parser.parse_args()
    for seed in range(args.seeds):
        r = drive(args.kind, seed, args.push, args.at)
        print(
            f"{r.kind} seed {r.seed}: {'arrived' if r.arrived else 'NOT ARRIVED'} {r.time:.1f} s, "
            f"least gap {100 * r.least:.1f} cm, path {100 * r.path_rms:.1f} cm rms "
            f"({100 * r.path_99:.1f} at 99 %, {100 * r.free:.0f} % of the drive), "
            f"place {100 * r.located_rms:.2f} cm rms "
            f"({100 * r.located_99:.2f} at 99 %), heading {math.degrees(r.heading_rms):.2f} deg, "
            f"found after {r.found:.1f} s, {r.mode} {r.reason}",
            flush=True,
        )


if __name__ == "__main__":
    main()
