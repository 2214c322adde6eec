"""Messages of Nav2's costmap filters, sound ones and others."""

from __future__ import annotations

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    nav_msgs__msg__MapMetaData as MapMetaData,
    nav_msgs__msg__OccupancyGrid as OccupancyGrid,
)

from cohelm.record.ros2 import header, pose
from cohelm.ros.masks import KEEP_OUT
from cohelm.ros.mismatch import FILTER_INFO
from cohelm.ros.types import store

CELLS = np.array([[0, 100, -1], [30, 0, 100]], np.int8)


def info(topic="filter_mask", kind=KEEP_OUT, base=0.0, multiplier=1.0):
    made = store().types[FILTER_INFO]
    return made(header(0, "map"), kind, topic, base, multiplier)


def grid(
    cells=CELLS, resolution=0.1, origin=(1.0, -2.0, 0.5), frame="map", width=None, inclined=0.0
):
    at = pose(*origin)
    at.orientation.x = inclined
    rows, columns = cells.shape
    about = MapMetaData(header(0, "").stamp, resolution, width or columns, rows, at)
    return OccupancyGrid(header(0, frame), about, cells.ravel())
