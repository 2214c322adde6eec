"""Replays a recorded drive as a robot behind the port."""

from __future__ import annotations

import bisect
import io
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.core.schema import first_fault
from cohelm.core.types import Pose, Twist
from cohelm.record.file import ROBOT, SCENARIO
from cohelm.record.messages import attachment, messages
from cohelm.record.ros2 import yaw
from cohelm.record.topics import IMAGE, scan_topic
from cohelm.robot.clock import ClockedRobot
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Encoded, Frame, Health, Odometry, Readings, Scan, untouched


class Replayed(ClockedRobot):
    """Plays `/odom`, `/scan` (and those of further LiDARs), `/cmd_vel` and the camera's pictures of
    a record; time 0 is its first odometry reading.

    Commands have no effect: `send` returns the recorded command. After the record's end nothing
    new comes.
    """

    def __init__(self, path: Path, model: RobotModel | None = None) -> None:
        """model: of a robot whose record does not describe it.

        Raises CohelmError for a file that is no record, or holds no odometry, or no robot.
        """
        super().__init__(model or recorded_model(path), None)
        self.whole = True
        """Whether the record was finished, and is not damaged."""
        found = _read(path, self.model, self._damaged)
        self.odometry, self.scans, self._driven, self._photos, self._further = found
        """All readings of odometry and LiDAR, in the order of time."""
        self._stamps = [o.stamp for o in self.odometry]
        self._ends = _ends(self.scans)
        self._further_ends = [_ends(scans) for scans in self._further]
        self._turns = [t for t, _ in self._driven]
        self._taken = [photo.stamp for photo in self._photos]
        self._frame: Frame | None = None

    def _damaged(self, _: str) -> None:
        self.whole = False

    @property
    def duration(self) -> float:
        """Of the record [s]."""
        return self._stamps[-1]

    def read(self) -> Readings:
        """The newest readings at that time."""
        now = self.now() + 1e-9
        k = bisect.bisect_right(self._stamps, now)
        s = bisect.bisect_right(self._ends, now)
        return Readings(
            self.odometry[k - 1] if k else None, self.scans[s - 1] if s else None,
            self._picture(now),
            Health(self.now(), math.nan, ()),
            tuple(
                scans[i - 1]
                for scans, ends in zip(self._further, self._further_ends, strict=True)
                if (i := bisect.bisect_right(ends, now))
            ),
            untouched(self.model, self.now()),
        )  # fmt: skip

    def _picture(self, now: float) -> Frame | None:
        """The newest frame, unpacked once."""
        k = bisect.bisect_right(self._taken, now)
        if not k:
            return None
        stamp, number, jpeg = self._photos[k - 1]
        if self._frame is None or self._frame.number != number:
            with Image.open(io.BytesIO(jpeg)) as image:
                self._frame = Frame(stamp, number, np.asarray(image.convert("RGB")))
        return self._frame

    def send(self, twist: Twist) -> Twist:
        """The command recorded at that time."""
        k = bisect.bisect_right(self._turns, self.now() + 1e-9)
        return self._driven[k - 1][1] if k else Twist(0.0, 0.0)

    def stop(self) -> None:
        """Without effect."""
        self._open()


def recorded_model(path: Path) -> RobotModel:
    """The robot that a record describes. CohelmError where it describes none."""
    data = attachment(path, ROBOT)
    if data is None and attachment(path, SCENARIO) is not None:  # a drive has both
        raise CohelmError(f"{path} is the record of a run, not of a robot's drive: give one")
    if data is None:
        raise CohelmError(
            f"{path} does not say which robot it is of, or is cut short before it does; give "
            "--robot to `cohelm map`"
        )
    try:
        return RobotModel.model_validate(json.loads(data))
    except ValueError as error:
        why = first_fault(error) if isinstance(error, ValidationError) else str(error)
        raise CohelmError(f"{path}: its description of the robot is damaged: {why}") from error


def _ends(scans: list[Scan]) -> list[float]:
    return [scan.stamp + scan.duration for scan in scans]


def _read(
    path: Path, model: RobotModel, damaged: Callable[[str], None]
) -> tuple[
    list[Odometry], list[Scan], list[tuple[float, Twist]], list[Encoded], list[list[Scan]]
]:  # fmt: skip
    odometry: list[Odometry] = []
    names = {"/scan": "" if model.lidar is None else model.lidar.name}
    names |= {scan_topic(one.name): one.name for one in model.further_lidars}
    scans: dict[str, list[Scan]] = {topic: [] for topic in names}
    driven: list[tuple[float, Twist]] = []
    photos: list[Encoded] = []
    newest: dict[str, float] = {}
    zero, psi = -1, 0.0
    for topic, stamp, m in messages(path, ("/odom", *names, "/cmd_vel", IMAGE), damaged):
        zero = stamp if zero < 0 and topic == "/odom" else zero
        t = (stamp - zero) * 1e-9
        if zero < 0 or t <= newest.get(topic, -math.inf):
            continue  # a clock went back: nothing is new until it is as late again
        newest[topic] = t
        if topic == "/odom":
            place, twist = m.pose.pose.position, m.twist.twist
            turned = psi + wrap(yaw(m.pose.pose.orientation) - psi)  # round and round, as it came
            now = Odometry(
                t, Pose(place.x, place.y, turned), Twist(twist.linear.x, twist.angular.z)
            )
            if not all(map(math.isfinite, (*now.pose, *now.twist))):
                continue  # a fault, which has stopped the drive; what came after it counts
            psi = turned
            odometry.append(now)
        elif topic in scans:
            n = len(m.ranges)
            ranges = np.asarray(m.ranges, dtype=np.float64)
            ranges = np.clip(
                ranges, m.range_min, m.range_max, where=np.isfinite(ranges), out=ranges
            )
            duration, number = float(m.time_increment) * max(n - 1, 1), len(scans[topic])
            scans[topic].append(Scan(t, number, ranges, duration, names[topic]))
        elif topic == IMAGE:
            photos.append(Encoded(t, len(photos), bytes(m.data)))
        else:
            driven.append((t, Twist(m.twist.linear.x, m.twist.angular.z)))
    if not odometry:
        raise CohelmError(f"{path} holds no odometry (/odom): give the record of a drive")
    first, *further = scans.values()
    return odometry, first, driven, photos, further
