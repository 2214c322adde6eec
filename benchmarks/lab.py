"""The lab on sensors only, through the whole loop in simulated time: how well it keeps to the path.

python -m benchmarks.lab [--kind kinematic|twin] [--seeds 3] [--push 2.0 --at 22]
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import wrap
from cohelm.drive.session import Plan, Session
from cohelm.drive.simulated import Kind, simulated
from cohelm.link.messages import Mode
from cohelm.robot.gate.modes import Mode as GateMode

FREE = (
    0.5  # nothing in the way: no thing seen nearer than this, and the reference does not wait [m]
)


class Result(NamedTuple):
    kind: str
    seed: int
    arrived: bool
    time: float
    """[s]"""
    least: float
    """Smallest gap of the real outline while the robot moved [m]."""
    path_rms: float
    """From the reference to where the robot really was when that took effect, where free [m]."""
    path_99: float
    located_rms: float
    """Of the place, where not lost [m]."""
    located_99: float
    heading_rms: float
    """[rad]"""
    found: float
    """After a push: until it knew again where it was, to 5 cm [s]; NaN: was not pushed."""
    mode: str
    reason: str


def drive(
    kind: Kind, seed: int, push: float = 0.0, at: float = 22.0, limit: float = 120.0,
    scenario: str = "lab-guard",
) -> Result:  # fmt: skip
    """One drive of the lab; at a time [s] it is pushed `push` metres to the east."""
    rows: list[tuple[float, ...]] = []
    pushed = found = math.nan
    with Session(Plan(simulated(scenario, kind, real_time=False, seed=seed))) as session:
        keeper, loop = session.loop.keeper, session.loop

        def until(_: object) -> bool:
            nonlocal pushed, found
            now, truth, seen, d = keeper.now(), keeper.truth(), loop.seen, loop.decision
            assert seen is not None
            off = math.hypot(seen.pose.x - truth.pose.x, seen.pose.y - truth.pose.y)
            if d is not None:
                free = float(d.gap > FREE and d.rate > 0.99)
                turned = wrap(seen.pose.psi - truth.pose.psi)
                row = (now, *truth.pose[:2], d.x_d, d.y_d, free, off, turned, float(seen.lost))
                rows.append(row)
            if push and math.isnan(pushed) and now >= at:
                keeper._robot.push(push, 0.0, 0.0)
                pushed = now
            elif math.isnan(found) and now > pushed + 0.2 and off < 0.05 and not seen.lost:
                found = now - pushed
            return loop.driver.arrived or now > limit

        session.run(until, Mode.AUTOMATIC)
        truth, gate = keeper.truth(), keeper.gate
        arrived, time = loop.driver.arrived, keeper.now()
    table = np.array(rows)
    ahead = round(session.plan.robot.model.delay_s / session.plan.period)
    there, wanted = table[ahead:, 1:3], table[:-ahead, 3:5]
    way = np.hypot(*(there - wanted).T)[table[:-ahead, 5] == 1.0]
    known = table[table[:, 8] == 0.0]
    return Result(
        kind, seed, arrived, time, truth.least_moving, rms(way), float(np.percentile(way, 99)),
        rms(known[:, 6]), float(np.percentile(known[:, 6], 99)), rms(known[:, 7]), found,
        GateMode(gate.mode).name, gate.reason,
    )  # fmt: skip


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kind", choices=["kinematic", "twin"], default="kinematic")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--push", type=float, default=0.0, help="metres to the east")
    parser.add_argument("--at", type=float, default=22.0, help="when; at 22 s in the corridor")
    given = parser.parse_args()
    for seed in range(given.seeds):
        r = drive(given.kind, seed, given.push, given.at)
        print(
            f"{r.kind} seed {r.seed}: {'arrived' if r.arrived else 'NOT ARRIVED'} {r.time:.1f} s, "
            f"least gap {100 * r.least:.1f} cm, path {100 * r.path_rms:.1f} cm rms "
            f"({100 * r.path_99:.1f} at 99 %), place {100 * r.located_rms:.2f} cm rms "
            f"({100 * r.located_99:.2f} at 99 %), heading {math.degrees(r.heading_rms):.2f} deg, "
            f"found after {r.found:.1f} s, {r.mode} {r.reason}",
            flush=True,
        )


if __name__ == "__main__":
    main()
