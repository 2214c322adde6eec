"""A camera that watches the floor shows that it sees by the floor: an empty hall is no doubt."""

import math

import numpy as np
import pytest

from cohelm.robot.plausibility.view import ScanView
from cohelm.scenario.load import robot

DEEP = robot("sally-depth").further_lidars[0]
LIDAR = DEEP.lidar()


@pytest.mark.parametrize(
    ("lidar", "ranges", "sees"),
    [(LIDAR, math.inf, True), (LIDAR, math.nan, False), (LIDAR, -math.inf, True),
     (LIDAR._replace(floor_from=math.nan), math.inf, False)],
)  # fmt: skip
def test_where_the_floor_is_seen_all_along_the_camera_sees(lidar, ranges, sees):
    view = ScanView(lidar, 0.29)
    view.take(np.full(DEEP.beams, ranges), None)
    assert (view.vouches(0.0), view.blank) == (sees, not sees)
