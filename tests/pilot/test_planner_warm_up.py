"""The first detour waits for no compiler: it took 8 s on a new machine, under a red alarm."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.planner_warm_up import warm_up_planner
from cohelm.pilot.replanning import Planner
from cohelm.robot.model import SHIPPED
from cohelm.scenario.load import robot
from tests.pilot.drives import SETTINGS, drive

TAIL = np.array([[0.1, 0.25], [-0.9, 0.35], [-0.9, -0.35], [0.1, -0.25]])
DEAD_END = [(2.92, -1.6, 5.76, -2.74), (5.76, -2.74, 7.13, 0.67), (7.13, 0.67, 4.29, 1.81)]
DOOR = [(3.0, 0.4, 3.0, 3.0), (3.0, -0.4, 3.0, -3.0)]
AISLE = [(-0.6, 0.36, 9.0, 0.36), (-0.6, -0.36, 9.0, -0.36), (-0.6, -0.36, -0.6, 0.36)]
HERE = (0.0, 0.0, 0.0)
LONG = SETTINGS._replace(outline=TAIL)

REPLAYED = """
import pickle, sys
from numba.core.dispatcher import Dispatcher
from cohelm.pilot.planner_warm_up import warm_up_planner

def compiled():
    return {
        (f.__module__, f.__name__, str(s))
        for name, module in list(sys.modules.items()) if name.startswith("cohelm.")
        for f in vars(module).values() if isinstance(f, Dispatcher) for s in f.signatures
    }

asked = pickle.load(open(sys.argv[1], "rb"))
warm_up_planner(asked[0][0])
before, kinds = compiled(), set()
for planner, task in asked:
    made = planner(task)
    kinds.add((made.new, made.move is not None))
for one in sorted(compiled() - before):
    print(*one)
print(len(asked), len(kinds))
"""


def test_after_a_warm_up_no_plan_has_anything_to_compile(tmp_path, monkeypatch):
    asked, plan = [], Planner.__call__

    def noted(planner, task):
        asked.append((planner, task))
        return plan(planner, task)

    monkeypatch.setattr(Planner, "__call__", noted)
    drive([(0, 0), (4, 0), (8, 0)], [(3.0, 0.05, 0, 0, 0.3)], start=HERE, seconds=20.0)
    drive([(0, 0), (3, 0), (6, 0)], walls=DOOR, start=(2.0, 0.3, -0.5), settings=LONG, seconds=8.0)
    drive([(5, 0), (6, 0), (11, 0)], walls=DEAD_END, start=(6.75, 0.18, -0.38), settings=LONG,
          seconds=15.0)  # fmt: skip
    drive([(0, 0), (4, 0), (8, 0)], walls=AISLE, start=(0.2, 0.0, 3.0), seconds=3.0)
    movers = [(2.5, -1.0, 0, 0.4, 0.3), (5, 0, 0, 0, 0.2)]
    drive([(0, 0), (4, 0), (8, 0)], movers, start=HERE, seconds=8.0)
    kept = tmp_path / "asked.pkl"
    kept.write_bytes(pickle.dumps(asked))
    done = subprocess.run(
        [sys.executable, "-c", REPLAYED, kept], capture_output=True, text=True, check=True
    )
    *compiled, counts = done.stdout.splitlines()
    assert not compiled
    plans, kinds = map(int, counts.split())
    assert plans > 100
    assert kinds >= 3


@pytest.mark.parametrize("name", SHIPPED)
def test_any_shipped_robots_planner_warms_up(name):
    model = robot(name)
    settings = SETTINGS._replace(outline=model.outline, limits=model.bounds())
    warm_up_planner(Pilot(through([(0, 0), (5, 0)], 0.2), settings).planner)
