"""The compiled stepper drives as the loop does: what campaigns count is what ships.

The loop runs in simulated time, with gate and monitors, on the kinematic robot; the wheels keep one
speed through a period, as the stepper has it, and odometry is exact.
"""

from dataclasses import replace

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.law.reference import through
from cohelm.link.messages import Mode
from cohelm.link.operator import NullOperator
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop, LoopParams
from cohelm.loop.planning import InProcessPlanner
from cohelm.perceive.pipeline import Perception
from cohelm.pilot.pilot import Pilot
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.sensors import OdometryModel
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.run import run
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import Body, world
from tests.few import first

DT = 0.02
EXACT = OdometryModel(
    rate_hz=50.0, distance_error=0.0, slip=0.0, gyro_drift_degps=0.0, gyro_noise_degps=0.0
)
ROOM = [[-2, -4, 8, -4], [8, -4, 8, 4], [8, 4, -2, 4], [-2, 4, -2, -4]]
BODIES = {
    "a post on the way": [Body((3.0, 0.1, 0.0, 0.0, 0.2, 0.6))],
    "a narrow pass": [
        Body((3.0, 0.75, 0.0, 0.0, 0.2, 0.6)), Body((3.0, -0.75, 0.0, 0.0, 0.2, 0.6)),
    ],
    "a walker crosses": [Body((3.0, -2.5, 0.0, 0.5, 0.25, 0.6))],
}  # fmt: skip


def made(delay: float, bodies, name: str = "sally"):
    """The robot, and a run of it."""
    model = robot(name).model_copy(update={"odometry": EXACT, "delay_s": delay, "camera": None})
    setup = Setup(
        Pose(0.0, 0.0, 0.0), through([[0, 0], [2, 0], [4, 0], [6, 0]], 0.5), model.outline,
        model.bounds(), obstacles=world((bodies, np.array(ROOM, dtype=float))), dt=DT, seed=3,
        names=tuple(f"body_{i}" for i in range(len(bodies))), duration=8.0, delay=delay,
    )  # fmt: skip
    return model, with_pilot(setup, lidars=model.lidars)


def looped(model, setup, steps: int) -> np.ndarray:
    """Poses at the beginning of each period, and what the gate let through in it, by the loop."""
    settings, pilot = setup.pilot.settings, setup.pilot
    plant = Kinematic(model, setup.start, setup.obstacles, seed=setup.seed, step=DT)
    driver_pilot = Pilot(
        setup.reference, settings, delay=setup.delay, path_params=pilot.path_params,
        replan_params=pilot.replan_params,
    )  # fmt: skip
    planning = InProcessPlanner(driver_pilot.planner, pilot.thinking)
    driver = Driver(driver_pilot, settings, setup.delay, planning)
    perception = Perception(model, tracker_params=pilot.tracker_params)
    gated = LocalGatedRobot(plant, rules(model, DT))
    loop = Loop(gated, perception, driver, NullOperator(), RecordLine(None), LoopParams(period=DT))
    rows = []

    def until(loop: Loop) -> bool:
        truth = plant.truth()
        rows.append(
            (*truth.pose, *gated.gate.applied, loop.decision.behavior if loop.decision else -1)
        )
        assert loop.supervisor.mode == Mode.AUTOMATIC, gated.gate.reason
        return len(rows) == steps

    loop.period()  # the gate wants to have heard from the loop before it lets it drive
    assert loop.supervisor.choose(Mode.AUTOMATIC) == ""
    try:
        loop.run(until)
    finally:
        driver.close()
        gated.close()
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "delay"),
    first([("a post on the way", 0.0), ("a walker crosses", 0.04), ("a narrow pass", 0.04)]),
)
def test_stepper_and_loop_drive_the_same_way(name, delay):
    same(*made(delay, BODIES[name]))


def test_stepper_and_loop_drive_the_same_way_with_two_lidars():
    model, setup = made(0.04, BODIES["a walker crosses"], "sally-rear")
    same(model, replace(setup, duration=7.0))  # the walker is past its way


def same(model, setup):
    rows = run(setup).rows
    assert rows["x"][-1] > 2.0
    theirs = looped(model, setup, len(rows))
    ours = np.column_stack([rows[c] for c in ("x", "y", "psi", "safe_v", "safe_omega")])
    assert np.abs(theirs[:, :5] - ours).max() < 1e-9
