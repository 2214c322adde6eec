"""A LaserScan as the robot's LiDAR model describes one: counter-clockwise, REP-117, always as many
beams."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints
from cohelm.robot.sensors import LidarModel
from cohelm.ros.transforms import Mount

NOISE = 0.02
"""Of a range, where neither the robot's description nor the message states it [m]."""
_MOST_BEAMS = 20_000


class Layout(NamedTuple):
    """Where the beams of the scans lie, in the sensor's frame as the message has it."""

    angle_min: float
    increment: float
    """From one to the next [rad], below 0 for clockwise."""
    beams: int


def layout(scan: Any, topic: str) -> Layout:
    """Of a `sensor_msgs/msg/LaserScan`. CohelmError for numbers that are none of a scan."""
    made = Layout(float(scan.angle_min), float(scan.angle_increment), len(scan.ranges))
    first, step, n = made
    if (
        not (math.isfinite(step) and math.isfinite(first))
        or step == 0.0
        or not 2 <= n <= _MOST_BEAMS
    ):
        raise CohelmError(
            f"{topic} holds no scan: {n} ranges, {step:g} rad apart from {first:g} rad: fix its "
            "driver"
        )
    if abs(step) * (n - 1) > 2.0 * math.pi * 1.02:
        raise CohelmError(
            f"{topic} covers {math.degrees(abs(step) * (n - 1)):.0f} deg, more than all round: its "
            "angle_increment or its number of ranges is wrong, fix the driver"
        )
    return made


def lidar_model(
    scan: Any, topic: str, mount: Mount, rate: float, latency: float, configured: LidarModel | None
) -> LidarModel:  # fmt: skip
    """The LiDAR that sends such scans.

    rate: as counted [Hz]. latency: least age of a last beam on arrival [s]. configured: the robot's
    description, for what no message has: name, noise and time-out.
    """
    first, step, n = layout(scan, topic)
    if upright := not mount.upside_down:
        middle = first + 0.5 * step * (n - 1)
    else:
        middle = -(first + 0.5 * step * (n - 1))
    whole = abs(step) * n >= 2.0 * math.pi * 0.995
    if whole and abs(step) * (n - 1) > 2.0 * math.pi * 0.9999:  # the last beam is the first again
        n -= 1
        middle -= 0.5 * step * (1.0 if upright else -1.0)
    view = 360.0 if whole else math.degrees(abs(step) * (n - 1))
    _, duration = taken(scan, mount)
    low, high = float(scan.range_min), float(scan.range_max)
    if not 0.0 <= low < high < math.inf:
        raise CohelmError(
            f"{topic} reports a range from {low:g} to {high:g} m: fix range_min and range_max in "
            "the driver"
        )
    return LidarModel(
        name="" if configured is None else configured.name,
        timeout_s=None if configured is None else configured.timeout_s,
        beams=n, field_of_view_deg=min(view, 360.0), range_min_m=low, range_max_m=high,
        rate_hz=rate, noise_m=configured.noise_m if configured is not None else NOISE,
        sweep_s=min(duration, 0.999 / rate), latency_s=min(max(latency, 0.0), 1.0),
        mount_x_m=mount.pose.x, mount_y_m=mount.pose.y,
        mount_yaw_deg=math.degrees(wrap(mount.pose.psi + middle)),
        mount_z_m=mount.height if math.isfinite(mount.height) else None,
    )  # fmt: skip


def sweep(scan: Any) -> float:
    """From its first beam to its last, as far as it says [s]."""
    duration = float(scan.time_increment) * max(len(scan.ranges) - 1, 0)
    return duration if math.isfinite(duration) and 0.0 < duration <= 1.0 else 0.0


def taken(scan: Any, mount: Mount) -> tuple[float, float]:
    """From its stamp to the first beam's measurement, and from there to the last [s].

    A scan whose beams come clockwise on the floor counts as measured at once in the middle of its
    time: a `Scan` runs counter-clockwise.
    """
    duration = sweep(scan)
    if (float(scan.angle_increment) < 0.0) != mount.upside_down:
        return 0.5 * duration, 0.0
    return 0.0, duration


class Ranges:
    """Maps ranges of the scans of a topic onto the beams of a model."""

    def __init__(self, model: LidarModel, mount: Mount, topic: str) -> None:
        self.model, self._mount, self._topic = model, mount, topic
        numbers = model.lidar()
        self._first, self._step = numbers.first, numbers.step
        self._yaw = model.mount.psi - mount.pose.psi
        self._layout: Layout | None = None
        self._beams: Ints = np.empty(0, dtype=np.int64)
        """Of scans with that layout, the model's beam of each of theirs."""

    def of(self, scan: Any) -> Floats:
        """(beams,) [m]: NaN where nothing was measured, which drivers also report as 0; -inf too
        near, inf nothing there. Several on one beam: the nearest. CohelmError for an invalid
        scan."""
        found = layout(scan, self._topic)
        if found != self._layout:
            self._layout, self._beams = found, self._beams_of(found)
        with np.errstate(invalid="ignore"):  # bytes may be any kind of NaN
            ranges: Floats = np.array(scan.ranges, dtype=np.float64)
        ranges[ranges == 0.0] = math.nan
        ranges[ranges < self.model.range_min_m] = -math.inf
        made: Floats = np.full(self.model.beams, math.nan)
        inside = self._beams < self.model.beams
        np.fmin.at(made, self._beams[inside], ranges[inside])
        return made

    def _beams_of(self, found: Layout) -> Ints:
        bearings = found.angle_min + found.increment * np.arange(found.beams)
        if self._mount.upside_down:
            bearings = -bearings
        turn = 2.0 * math.pi
        offset = np.mod(bearings - self._yaw - self._first + 0.5 * self._step, turn)
        return (offset / self._step).astype(np.int64)
