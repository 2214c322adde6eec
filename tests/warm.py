"""Compiles what most tests need, with an empty cache more than a minute of one core: one room,
driven on exact arcs and through the loop on the twin. With `more` what several others need; make
runs that on the other core, when lint has ended. Where all is compiled, both take a few seconds.
"""

import sys

from cohelm.perceive.pipeline import warm_up
from cohelm.robot.clock import SteppedClock
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.study.campaign import suites
from cohelm.study.campaign.episode import Law, Plant
from cohelm.study.campaign.worker import chunk


def driven(suite: str, law: Law, plant: Plant = "kinematic") -> None:
    """One episode of a suite."""
    (row,) = chunk(suites.suite(suite, 1, None, plant), law, (6,))
    if row.fault:
        raise SystemExit(row.fault)


if __name__ == "__main__":
    if "more" not in sys.argv:
        driven("random", "guard")
        driven("random", "guard", "twin")
        warm_up(robot("sally-rear"), False)  # two LiDARs are other types to the compiler
    else:
        warm_up(robot("sally"), True)
        driven("adversary", "guard")
        driven("random", "none")
        Kinematic(robot("sally"), clock=SteppedClock()).read()
        Twin(robot("sally"), clock=SteppedClock()).picture(32, 24, kind="rays")
