"""Once a robot's monitors are made nothing is left to compile: the gate's process is waited for."""

import sys

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.robot.achievable import achievable
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.watch import monitors
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import world
from tests.robot.plausibility.watched import ROOM, person

PERIOD = 0.02
BIG = np.array([[0.6, 0.35], [-0.6, 0.35], [-0.6, -0.35], [0.6, -0.35]])


def compiled() -> dict[str, int]:
    """How many kinds of arguments each compiled function of the monitors has been made for."""
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith(("cohelm.robot.collision_monitor", "cohelm.robot.plausibility")):
            for key, what in vars(module).items():
                if hasattr(what, "signatures") and what.__module__ == name:
                    found[f"{name}.{key}"] = len(what.signatures)
    return found


@pytest.mark.parametrize("name", ["sally", "sally-rear", "sally-depth", "turtlebot4"])
def test_nothing_is_compiled_while_the_robot_drives(name):
    model = robot(name).model_copy(update={"camera": None})
    people = tuple(person(1.5 + 0.5 * k, -1.5, 0.1, 0.4) for k in range(3))
    driven = Kinematic(model, Pose(0.0, 0.0, 0.0), world((people, ROOM)), seed=3)
    watching = monitors(model, rules(model, PERIOD))
    before, sent = compiled(), Twist(0.0, 0.0)
    assert before
    for k in range(1, 400):
        driven.wait(k * PERIOD)
        readings = driven.read()
        if readings.odometry is not None and 150 < k < 170:  # a push: scans and odometry disagree
            pose = readings.odometry.pose
            moved = pose._replace(x=pose.x + 0.03 * (k - 150))
            readings = readings._replace(odometry=readings.odometry._replace(pose=moved))
        if k > 200:
            readings = readings._replace(outline=BIG if k < 300 else model.outline)
        for monitor in watching:
            monitor.observe(k * PERIOD, readings, sent)
            monitor.restrict(k * PERIOD, sent)
        wanted = Twist(0.4, 0.8 * np.sin(0.05 * k)) if k % 100 < 80 else Twist(-0.2, 0.0)
        sent = achievable(wanted, sent, model.bounds(), PERIOD)
        driven.send(sent)
    assert compiled() == before
