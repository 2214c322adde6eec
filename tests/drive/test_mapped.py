"""The frame of a map given with --map."""

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.drive.factory import mapped
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
