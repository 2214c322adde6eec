"""How often the collision monitor acts while the filter is on, and whether it keeps anybody from
arriving: `python -m tests.robot.collision_monitor.with_filter [--rooms 20] [--barn FOLDER]`

The whole loop in simulated time, by its sensors alone: the lab on both simulators, and random rooms
where everything stands, or BARN worlds, on the kinematic one; each with the monitor and without.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import yaml

from cohelm.core.types import RADIUS, X, Y
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.robot.keep.gated_robot import LocalGatedRobot
from cohelm.robot.monitor import UNRESTRICTED
from cohelm.scenario.worlds.barn import Barn
from cohelm.sim.maker import Kind
from cohelm.study.campaign.barn import read
from cohelm.study.campaign.rooms import case
from tests.robot.collision_monitor.rooms import standing


def room(number: int, seed: int, folder: Path) -> Path:
    """A random room as a scenario; the robot goes from its start to its goal."""
    drawn = case(seed, number)
    around, start, goal = standing(drawn), drawn.setup.start, drawn.goal
    assert goal is not None
    written = {
        "name": f"room-{number}",
        "robot": "sally",
        "start": {"x_m": start.x, "y_m": start.y, "heading_rad": start.psi},
        "reference": {"speed_mps": 0.5, "waypoints_m": [[start.x, start.y], [goal.x, goal.y]]},
        "obstacles": [
            {
                "name": f"disc {i}",
                "center_m": [float(d[X]), float(d[Y])],
                "radius_m": float(d[RADIUS]),
            }
            for i, d in enumerate(around.discs)
        ],
        "walls_m": around.walls.tolist(),
    }
    path = folder / f"room-{number}.yaml"
    path.write_text(yaml.safe_dump(written))
    return path


def barn(found: Barn, folder: Path) -> Path:
    """A BARN world as a scenario."""
    number = found.number
    written = {
        "name": f"barn-{number}",
        "robot": "jackal",
        "start": {"x_m": found.start.x, "y_m": found.start.y, "heading_rad": found.start.psi},
        "reference": {"speed_mps": 1.0, "waypoints_m": found.route[::4].tolist()},
        "obstacles": [
            {
                "name": f"cylinder {i}",
                "center_m": [float(d[X]), float(d[Y])],
                "radius_m": float(d[RADIUS]),
            }
            for i, d in enumerate(found.discs)
        ],
        "walls_m": found.walls.tolist(),
    }
    path = folder / f"barn-{number}.yaml"
    path.write_text(yaml.safe_dump(written))
    return path


class Counted:
    """A monitor, and how often it acts."""

    def __init__(self, watched) -> None:
        self._watched, self.acted, self.periods, self.said = watched, 0, 0, set()

    def observe(self, now, readings, applied, stopped=False):
        """As the monitor."""
        return self._watched.observe(now, readings, applied, stopped)

    def restrict(self, now, twist):
        """As the monitor; counted."""
        found = self._watched.restrict(now, twist)
        self.periods += 1
        self.acted += found != UNRESTRICTED
        if found != UNRESTRICTED:
            self.said.add(f"{now:.1f} s, {found.share:.2f}: {found.reason}")
        return found


def drive(scenario: str | Path, kind: Kind, seed: int, *, watched: bool, limit: float = 150.0):
    """Until it arrives or the time is up: arrived, when [s], least clearance moving [m], counts."""
    with Session(SessionConfig(simulated(scenario, kind, real_time=False, seed=seed))) as session:
        gated = session.gated
        assert isinstance(gated, LocalGatedRobot)
        counted = [Counted(monitor) for monitor in gated._monitors]
        gated._monitors = tuple(counted) if watched else ()
        end = gated.now() + limit
        session.run(lambda loop: loop.driver.arrived or loop.gated.now() > end, Mode.AUTOMATIC)
        truth = gated.truth()
        acted, periods = sum(c.acted for c in counted), max([c.periods for c in counted], default=0)
        said = sorted(s for c in counted for s in c.said)
        arrived, when = session.loop.driver.arrived, gated.now()
        return arrived, when, truth.least_moving, acted, periods, said, gated.gate.reason


def main() -> None:
    """Drive all of them, and say what came of it."""
    ask = argparse.ArgumentParser()
    ask.add_argument("--rooms", type=int, default=20)
    ask.add_argument("--first", type=int, default=0)
    ask.add_argument("--seed", type=int, default=8000)
    ask.add_argument("--barn", type=Path)
    ask.add_argument("--worlds", type=int, default=10)
    ask.add_argument("--lab", action="store_true")
    given = ask.parse_args()
    total = acted = 0
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        drives: list[tuple[str | Path, Kind]] = []
        if given.lab:
            drives += [("lab-guard", "kinematic"), ("lab-guard", "twin")]
        numbers = range(given.first, given.first + given.rooms)
        drives += [(room(n, given.seed, folder), "kinematic") for n in numbers]
        if given.barn:
            worlds = read(given.barn)
            some = worlds[:: max(len(worlds) // given.worlds, 1)][: given.worlds]
            drives += [(barn(found, folder), "kinematic") for found in some]
        for scenario, kind in drives:
            on = drive(scenario, kind, given.seed, watched=True)
            off = drive(scenario, kind, given.seed, watched=False)
            total, acted = total + on[4], acted + on[3]
            name = Path(scenario).stem
            print(
                f"{name} {kind}: with {on[0]} {on[1]:.1f} s {on[2]:.3f} m, acted {on[3]} of {on[4]}"
                f"; without {off[0]} {off[1]:.1f} s {off[2]:.3f} m; {on[6]} {on[5][:3]}",
                flush=True,
            )
    print(f"acted in {acted} of {total} periods, {100.0 * acted / max(total, 1):.3f} %")


if __name__ == "__main__":
    main()
