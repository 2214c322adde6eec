"""A PointCloud2 as a scan: of what stands between two heights, the nearest along each beam."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.robot.sensors import LidarModel
from cohelm.ros.floor import Floor

_FORMATS = {7: "f4", 8: "f8"}
"""Of `sensor_msgs/msg/PointField`: FLOAT32, FLOAT64."""
_MOST_POINTS = 2_000_000


def points(cloud: Any, topic: str) -> Floats:
    """(n, 3), x y z in the frame of the cloud [m]; NaN for what was not measured.

    Raises CohelmError for bytes that do not fit the message's description.
    """
    fields = {field.name: field for field in cloud.fields}
    step, row, n = int(cloud.point_step), int(cloud.row_step), int(cloud.width) * int(cloud.height)
    data = np.asarray(cloud.data, dtype=np.uint8)
    if not {"x", "y", "z"} <= fields.keys():
        raise CohelmError(f"{topic} has points without x, y and z: it has {', '.join(fields)}")
    order = ">" if cloud.is_bigendian else "<"
    chosen = [fields[name] for name in ("x", "y", "z")]
    formats = [_FORMATS.get(int(field.datatype), "") for field in chosen]
    ends = [int(one.offset) + int(kind[1:] or 0) for one, kind in zip(chosen, formats, strict=True)]
    if (
        "" in formats
        or not 0 <= n <= _MOST_POINTS
        or max(ends) > step
        or row < step * int(cloud.width)
        or len(data) < row * int(cloud.height)
    ):
        raise CohelmError(
            f"{topic} holds no cloud of points: {int(cloud.height)} rows of {int(cloud.width)}, "
            f"{step} and {row} bytes apart, in {len(data)} bytes; fix its driver"
        )
    kind = np.dtype({
        "names": ["x", "y", "z"], "formats": [order + one for one in formats],
        "offsets": [int(field.offset) for field in chosen], "itemsize": step,
    })  # fmt: skip
    shape = (int(cloud.height), int(cloud.width))
    found = np.ndarray(shape, kind, data.tobytes() if n else b"", 0, (row, step))
    with np.errstate(invalid="ignore"):  # bytes may be any kind of NaN
        return np.column_stack([found[name].ravel().astype(np.float64) for name in "xyz"])


class CloudRanges:
    """Projects the points of clouds onto the beams of a model."""

    def __init__(self, model: LidarModel, body: Floats, topic: str) -> None:
        """model: one with a height band. body: (4, 4), from the cloud's frame into the body's."""
        self._model, self._body, self._topic = model, body, topic
        self.floor = None if model.floor is None else Floor(model, model.floor)
        """Watched where the model has one."""
        self._numbers = model.lidar()

    def of(self, cloud: Any) -> Floats:
        """(beams,) [m]: of the points within the band, the distance on the floor of the nearest
        along each beam, as the sensor of the model sees it, or where floor ends that it ought to
        see; inf where there is none, -inf where it is nearer than the least range. CohelmError for
        what is no cloud."""
        model, lidar = self._model, self._numbers
        low, high = model.height_band_m or (-math.inf, math.inf)
        seen = points(cloud, self._topic)
        with np.errstate(invalid="ignore", over="ignore"):
            here = seen @ self._body[:3, :3].T + self._body[:3, 3]
            least = low if self.floor is None else -math.inf
            here = here[(here[:, 2] >= least) & (here[:, 2] <= high)]
            dx, dy = here[:, 0] - lidar.mount.x, here[:, 1] - lidar.mount.y
            far = np.hypot(dx, dy)
            near = far <= model.range_max_m  # no NaN either
            dx, dy, far, heights = dx[near], dy[near], far[near], here[near, 2]
            bearing = np.arctan2(dy, dx) - lidar.mount.psi - lidar.first + 0.5 * lidar.step
        beams = (np.mod(bearing, 2.0 * math.pi) / lidar.step).astype(np.int64)
        inside = beams < model.beams
        beams, far, heights = beams[inside], far[inside], heights[inside]
        made: Floats = np.full(model.beams, math.inf)
        stands = heights >= low
        np.minimum.at(made, beams[stands], far[stands])
        if self.floor is not None:
            made = self.floor.stood(beams, far, heights, made)
        made[made < model.range_min_m] = -math.inf
        return made
