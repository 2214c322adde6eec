"""A Range of a sonar or infrared sensor as a scan: one range for all the beams of its cone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.schema import first_fault
from cohelm.core.types import Floats
from cohelm.robot.sensors import LidarModel

_STEEPEST = math.radians(20.0)
"""A sensor that looks farther up or down does not measure how far away a thing stands [rad]."""


def described(
    message: Any, topic: str, matrix: Floats, rate: float, latency: float, configured: LidarModel
) -> LidarModel:  # fmt: skip
    """The range sensor that sends such a `sensor_msgs/msg/Range`: its cone and ranges are the
    message's, projected onto the floor.

    matrix: (4, 4), from its frame, whose x axis the cone has, into the body's. rate: as counted
    [Hz]. latency: least age on arrival [s]. Raises CohelmError for an impossible cone.
    """
    low, high, view = (
        float(v) for v in (message.min_range, message.max_range, message.field_of_view)
    )
    if not 0.0 <= low <= high < math.inf or high == 0.0:
        raise CohelmError(
            f"{topic} reports a range from {low:g} to {high:g} m: fix min_range and max_range in "
            "the driver"
        )
    if not 0.0 < view <= math.pi:
        raise CohelmError(
            f"{topic} says that its cone is {math.degrees(view):g} deg wide: fix field_of_view "
            "[rad] in the driver"
        )
    x, y, z = matrix[:3, 0].tolist()
    if not abs(z) <= math.sin(_STEEPEST):
        raise CohelmError(
            f"{topic}: the sensor looks {abs(math.degrees(math.asin(z))):.0f} deg "
            f"{'up' if z > 0.0 else 'down'}, and up to {math.degrees(_STEEPEST):.0f} can be used: "
            "fix its frame in the robot's description (x is where it looks)"
        )
    flat = math.hypot(x, y)
    keys = {
        "name": configured.name, "range_sensor": True, "field_of_view_deg": math.degrees(view),
        "range_min_m": flat * low, "range_max_m": flat * high, "rate_hz": rate,
        "noise_m": configured.noise_m, "timeout_s": configured.timeout_s,
        "forget_s": configured.forget_s,
        "latency_s": min(max(latency, 0.0), 1.0), "mount_x_m": float(matrix[0, 3]),
        "mount_y_m": float(matrix[1, 3]), "mount_yaw_deg": math.degrees(math.atan2(y, x)),
    }  # fmt: skip
    try:
        return LidarModel.model_validate(keys)  # as many beams as the cone needs
    except ValidationError as error:
        raise CohelmError(f"{topic} describes no range sensor: {first_fault(error)}") from error


class ConeRanges:
    """Sets one range on all the beams of a model."""

    def __init__(self, model: LidarModel, matrix: Floats, topic: str) -> None:
        self._beams, self._topic = model.beams, topic
        self._limits = model.range_min_m, model.range_max_m
        self._flat = math.hypot(float(matrix[0, 0]), float(matrix[1, 0]))

    def of(self, message: Any) -> Floats:
        """(beams,) [m], all the same: inf for nothing, -inf for too near, NaN where nothing was
        measured, which drivers also report as 0. CohelmError where its limits are not those found
        at the start."""
        low, high = float(message.min_range), float(message.max_range)
        before = tuple(limit / self._flat for limit in self._limits)
        if not np.allclose((low, high), before, rtol=0.01, atol=0.002):
            raise CohelmError(
                f"{self._topic} reports a range from {low:g} to {high:g} m, and said from "
                f"{before[0]:g} to {before[1]:g} m when it was looked at: fix its driver, or "
                "start again"
            )
        made: Floats = np.full(
            self._beams, self._flat * rep117_range(float(message.range), low, high)
        )
        return made


def rep117_range(measured: float, low: float, high: float) -> float:
    """A range by REP-117 [m]. low, high: those of the message; equal ones are of a sensor that only
    reports whether something is nearer than that, as -inf, or not, as inf."""
    if math.isnan(measured) or -math.inf < measured <= 0.0:
        return math.nan
    if measured > high:
        return math.inf
    if measured < low or low == high:
        return -math.inf
    return measured
