"""A simulated robot in a world that is an occupancy map."""

import numpy as np

from cohelm.core.types import Pose
from cohelm.drive.factory import simulated
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, OccupancyMap, write_map

SCENARIO = """
name: on a map
robot: sally
start: {x_m: 2.5, y_m: 2.5, heading_rad: 0}
reference: {speed_mps: 0.5, waypoints_m: [[2.5, 2.5], [3.5, 2.5]]}
world: {kind: map, file: map.yaml}
walls_m: [[2.0, 4.0, 3.0, 4.0]]
"""


def test_map_cells_are_seen_by_the_lidar_and_avoided_on_both_plants(tmp_path):
    cells = np.full((100, 100), FREE, dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    write_map(tmp_path, OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)))
    (tmp_path / "scenario.yaml").write_text(SCENARIO, encoding="utf-8")
    for kind in ("kinematic", "twin"):
        robot = simulated(tmp_path / "scenario.yaml", kind, real_time=False)()
        try:
            robot.wait(0.3)
            ranges = robot.read().scan.ranges
            ahead, left, right = (ranges[k - 3 : k + 4].mean() for k in (360, 600, 120))
            assert abs(ahead - (4.95 - 2.8)) < 0.03
            assert abs(left - (4.0 - 2.5)) < 0.03  # the wall beside those of the map
            assert abs(right - (2.5 - 0.05)) < 0.03
            assert abs(robot.truth().clearance - (4.0 - 2.5 - 0.29)) < 0.01
        finally:
            robot.close()
