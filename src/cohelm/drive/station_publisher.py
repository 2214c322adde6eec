"""What a drive publishes to the stations, and the paths that they propose."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cohelm.core.types import Floats
from cohelm.drive.pictures import Packed
from cohelm.drive.rerouting import PathRequest
from cohelm.link.bulk_messages import Hello, Picture, Records
from cohelm.link.robot_bulk import RobotBulk
from cohelm.link.robot_end import RobotEnd
from cohelm.link.robot_records import listed
from cohelm.robot.model import RobotModel


class StationPublisher:
    """Publishes over both ends of the link. Its calls return at once."""

    def __init__(
        self, end: RobotEnd, bulk: RobotBulk, model: RobotModel, records: Path, camera: bool,
        carry_on: bool,
    ) -> None:  # fmt: skip
        """end, bulk: of the link; this object closes them. records: folder whose
        files can be fetched. camera: whether there will be pictures. carry_on: as of `LoopParams`.
        """
        self.end, self._bulk = end, bulk
        self.publish, self.reply = bulk.publish, bulk.reply
        self._records = records
        shown = model if camera else model.model_copy(update={"camera": None})
        self._hello = hello(shown, carry_on)
        self.publish(self._hello)
        self.list_records()

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline, (k, 2) [m]: stations draw that from now on."""
        self.publish(self._hello._replace(outline=outline.astype(np.float32)))

    def list_records(self) -> None:
        """Publish the list of records."""
        self.publish(Records(listed(self._records)))

    def path_requests(self) -> tuple[PathRequest, ...]:
        """Waypoints proposed since the last call."""
        return tuple(PathRequest(one.client, *one.what) for one in self._bulk.proposed())

    @property
    def watched(self) -> bool:
        """Whether a station shows pictures."""
        return self._bulk.watched

    def picture(self, packed: Packed, age: float) -> None:
        """Send a picture, unless a newer one comes before it has left.

        age: of the picture now [s]; on the link its stamp is of the link's clock, not the robot's.
        """
        taken = self.end.clock() - age
        self.publish(Picture(packed.number, taken, packed.pose, packed.data))

    def close(self) -> None:
        """Close the link."""
        self._bulk.close()
        self.end.close()


def hello(model: RobotModel, carry_on: bool) -> Hello:
    """The robot's description."""
    nan, camera = math.nan, model.camera
    lens = (nan, nan, nan, nan)
    if camera is not None:
        angle, tilt = math.radians(camera.field_of_view_deg), math.radians(camera.tilt_deg)
        lens = (angle, camera.mount_x_m, camera.mount_z_m, tilt)
    limits = model.limits
    return Hello(
        model.name, model.outline.astype(np.float32),
        limits.speed_mps or limits.wheel_speed_mps or nan, limits.yaw_rate_radps or nan, lens,
        carry_on,
    )  # fmt: skip
