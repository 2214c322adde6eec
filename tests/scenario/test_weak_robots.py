"""A robot that brakes and turns slowly is given a reference that it can follow."""

import numpy as np
import pytest

from cohelm.plan.course import poses_along
from cohelm.scenario import build, load
from cohelm.sim.run import run

CORNERS = """
name: corners
robot: ROBOT
reference:
  speed_mps: SPEED
  waypoints_m: [[0, 0], [2, 0], [4, 0], [5.5, 0], [6, 0.5], [6, 2], [6, 4], [6.5, 4.5], [8, 4.5],
    [10, 4.5], [10.5, 4], [10.5, 2], [10.5, 0.5], [11, 0], [13, 0]]
simulation: {step_s: 0.02, wheel_limits: true}
"""
HEAVY = """
name: heavy
footprint_m: [[0.5, -0.35], [0.5, 0.35], [-0.5, 0.35], [-0.5, -0.35]]
track_m: 0.6
wheel_radius_m: 0.1
limits: {speed_mps: 1.5, acceleration_mps2: 0.5, yaw_rate_radps: 0.6, yaw_acceleration_radps2: 0.5}
"""


@pytest.mark.parametrize(("robot", "speed", "near"), [("husky", 1.0, 0.05), (HEAVY, 1.5, 0.25)])
def test_it_stays_on_its_route_round_corners(tmp_path, robot, speed, near):
    name = robot
    if "\n" in robot:
        name = "heavy.yaml"
        (tmp_path / name).write_text(robot)
    file = tmp_path / "corners.yaml"
    file.write_text(CORNERS.replace("ROBOT", name).replace("SPEED", str(speed)))
    setup = build.setup(load.scenario(str(file)))
    rows = run(setup).rows
    route = poses_along(setup.reference, 0.01)[:, :2]
    away = [np.hypot(*(route - at).T).min() for at in zip(rows["x"], rows["y"], strict=True)]
    assert rows["arrived"][-1]
    assert max(away) < near
