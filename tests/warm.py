"""Compiles what most tests need: one room, driven on exact arcs and through the loop on the twin.

With an empty cache this takes more than a minute of one core, while lint has the other; else a few
seconds.
"""

from cohelm.perceive.pipeline import rehearse
from cohelm.scenario.load import robot
from cohelm.study.campaign import suites
from cohelm.study.campaign.worker import chunk

if __name__ == "__main__":
    for plant in ("kinematic", "twin"):
        (row,) = chunk(suites.suite("random", 1, None, plant), "guard", (6,))
        if row.fault:
            raise SystemExit(row.fault)
    rehearse(robot("sally-rear"), False)  # two LiDARs are other types to the compiler
