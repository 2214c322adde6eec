"""Nothing is left to compile when it has to be in time: not even what is only needed once lost.

In a process of its own, where no other test has had anything compiled.
"""

import multiprocessing
import os
import sys

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from cohelm.core.types import Pose, Twist
from cohelm.drive.factory import simulated
from cohelm.drive.session import SessionConfig, driver_of
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.pipeline import Perception, warm_up
from cohelm.pilot.replanning import Plan as Planned
from cohelm.robot.port import Odometry, Readings, Scan


def versions() -> dict[str, int]:
    """How many versions of each compiled function there are."""
    return {
        f"{name}.{key}": len(value.overloads)
        for name, module in list(sys.modules.items())
        if name.startswith("cohelm.")
        for key, value in list(vars(module).items())
        if isinstance(value, Dispatcher) and value.py_func.__module__ == name
    }


def look(perception: Perception, every: int) -> set[bool]:
    """Scans in the open lab of which only some beams come back, at a wrong place and then at none;
    whether it was lost."""
    lidar = perception.lidar
    ranges = np.full(len(lidar.beams), np.nan)
    ranges[::every] = 1.0 + 0.3 * np.sin(np.arange(len(ranges)))[::every]
    lost = set()
    for k in range(30):
        t = 0.1 * k
        odometry = Odometry(t + 0.05, Pose(0.02 * k, 0.0, 0.0), Twist(0.2, 0.0))
        readings = Readings(odometry, Scan(t, k, ranges, 0.05), None, None)
        for _ in range(30):  # a search is a slice of work at every call
            lost.add(perception.take(t + 0.05, readings).lost)
    return lost


def left_to_compile(line) -> None:
    robot = simulated("lab-guard")
    around = map_from_geometry(robot.scenario.walls(), robot.start)
    warm_up(robot.model, mapped=True)
    driver = driver_of(SessionConfig(robot), real_time=False)
    seen = Perception(robot.model, around, robot.start).take(0.0, Readings(None, None, None, None))
    driver.warm_up(seen)
    before = versions()

    lost = set()
    for every in (1, 2, 7):
        lost |= look(Perception(robot.model, around, Pose(6.0, 4.0, 0.0)), every)
    assert driver.pilot is not None
    course = driver.pilot.course
    driver.pilot.take(Planned(course, True, None, False, 1.0), robot.start, Twist(0.1, 0.0))
    after = versions()
    line.send((True in lost, {name for name, n in after.items() if n > before.get(name, 0)}))


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_after_the_warm_up_nothing_is_compiled_for_a_new_path_or_when_lost():
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=left_to_compile, args=(theirs,))
    process.start()
    theirs.close()
    was_lost, late = ours.recv()
    process.join(60.0)
    assert was_lost
    assert late == set()
