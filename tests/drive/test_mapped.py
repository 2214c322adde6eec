"""The frame of a map given with --map."""

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.drive.factory import mapped
from cohelm.drive.operate import DriveOptions, map_and_zones, robot_factory
from cohelm.perceive.localize.localization_map import free_at
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, write_map

NOWHERE = np.full((20, 40), UNKNOWN, dtype=np.int8)
START = Pose(10.0, 5.0, np.pi / 2)


@pytest.mark.parametrize(("from_start", "x", "y"), [(False, 1.0, 0.5), (True, 9.5, 6.0)])
def test_a_published_map_is_in_the_world_frame_and_our_own_in_the_frame_of_the_start(
    tmp_path, from_start, x, y
):
    cells = np.full((20, 40), OCCUPIED, dtype=np.int8)
    cells[5:15, 5:35] = FREE  # 1.5 m by 0.5 m round (1, 0.5)
    write_map(tmp_path, OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0), from_start))
    known = mapped(tmp_path / "map.yaml", START)
    assert free_at(known, x, y)
    assert not free_at(known, 10.5 - x, 6.5 - y)  # the other one's


def test_a_map_without_walls_is_refused_by_its_name(tmp_path):
    write_map(tmp_path, OccupancyMap(NOWHERE, 0.05, Pose(0.0, 0.0, 0.0)))
    with pytest.raises(CohelmError, match=r"map\.yaml: the map has no occupied cell"):
        mapped(tmp_path / "map.yaml", START)


BENT = "name: office\nreference: {speed_mps: 0.5, waypoints_m: [[0, 0], [2, 0.6], [6, -1.5]]}\n"
OFF = "start: {x_m: 1, y_m: 2, heading_rad: 0.5}\n"
OWN = "tests.api.carts:Cart"


@pytest.mark.parametrize(
    ("driver", "start", "from_start", "turned"),
    [
        (OWN, "", True, False), (OWN, OFF, True, True), (OWN, "", False, False),
        (None, "", True, True),
    ],
)  # fmt: skip
def test_a_map_of_the_first_drive_waypoints_and_a_real_robot_are_in_one_frame(
    tmp_path, driver, start, from_start, turned
):
    """Its start is not the heading of the route's spline, 0.35 rad here."""
    cells = np.full((20, 40), OCCUPIED, dtype=np.int8)
    cells[5:15, 5:35] = FREE
    write_map(tmp_path, OccupancyMap(cells, 0.05, Pose(-1.0, -0.5, 0.0), from_start))
    (tmp_path / "office.yaml").write_text(BENT + start)
    chart, site = tmp_path / "map.yaml", str(tmp_path / "office.yaml")
    options = DriveOptions("sally", site, "kinematic", True, None, [], driver, chart=chart)
    made = robot_factory(options)
    known = map_and_zones(options, made)[0]
    assert (known.origin != pytest.approx((-1.0, -0.5, 0.0))) == turned
    if driver is not None and from_start:
        assert made.start == pytest.approx((1.0, 2.0, 0.5) if start else (0.0, 0.0, 0.0))
