"""Returns of a scan in the body frame, with their errors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose

PATCH = 0.015
"""Returns of one surface within this of a return, on either side, are averaged with it [m]: over
3 cm a surface that can hurt is as good as flat; 2 mm deep, where its radius is 5 cm."""
NEIGHBOURS = 8
"""Largest number of beams averaged on either side."""
SAME = 4.2
"""Returns that differ by less than this many sigma are of one surface: the difference of two
has 1.41 sigma, so 3 of its own."""
SURE = 3.0
"""An obstacle may be nearer than its return by this many sigma of the average, plus the distance
between two beams."""
TOO_NEAR = math.ulp(0.0)
"""Error that marks what is too near to be measured [m]: zero in any sum, yet distinguishable."""


class Sensor(NamedTuple):
    """The parameters of a planar LiDAR."""

    mount: Pose
    """In the body frame."""
    bearings: Floats
    """Bearings of its beams in its own frame, counter-clockwise, (n,) [rad]."""
    step: float
    """From beam to beam [rad]."""
    range_min: float
    """Nearer surfaces return -inf [m]."""
    noise: float
    """Standard deviation of a range [m]."""
    rate: float
    """Scans a second."""
    sweep: float
    """From a scan's first beam to its last [s]."""
    latency: float
    """From its last beam to its reading [s]."""
    name: str = ""
    """Name, where there are several."""
    timeout: float = math.nan
    """Largest age of its newest scan [s]; NaN: by its rate."""
    range_max: float = math.inf
    """Farther surfaces return inf [m]."""
    height: float = math.nan
    """Height of the plane in which it measures, above the body's origin [m]; NaN: not described, or
    it measures in no plane."""
    forgets: float = math.inf
    """Time after which it forgets what it does not see any more [s]. If finite, it is a range
    sensor: its beams are one measurement, which vouches for no ground."""
    whole_from: float = 0.0
    """Obstacles nearer than this may be below its beams [m]."""
    floor_from: float = math.nan
    """Least distance at which it sees the floor [m]; NaN: it does not look for that."""
    floor_to: float = math.nan
    """Largest distance at which it sees the floor [m]."""
    vouched: float = 0.0
    """Distance around the robot within which there is floor where it is switched on [m]."""


class Returns(NamedTuple):
    """The returns of a scan."""

    points: Floats
    """In the body frame at the beam's time, (m, 2) [m]."""
    errors: Floats
    """Standard deviation of each, (m,) [m]."""
    margins: Floats
    """By how much the obstacle may be nearer, (m,) [m]."""
    passed: Floats
    """Share of the scan's time that had passed, (m,), in [0, 1]."""


def returns(ranges: Floats, sensor: Sensor, within: float) -> Returns:
    """The returns of one scan, up to `within` [m]. NaN and inf are none; -inf (REP-117) is one
    between the sensor and its least range, and gives a point at both."""
    return Returns(*_returns(
        np.array(ranges, dtype=np.float64), sensor.bearings, *sensor.mount, sensor.step,
        sensor.range_min, sensor.noise, sensor.forgets < math.inf, within,
    ))  # fmt: skip


@jit
def _returns(
    ranges: Floats, bearings: Floats, x: float, y: float, psi: float, step: float, least: float,
    noise: float, alone: bool, within: float,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """The compiled part. x, y, psi: of the mount; least: the least range; alone: whether the
    errors are those of single beams, not of averages."""
    n, hits, close = len(ranges), 0, 0
    for i in range(n):
        hits += 0.0 <= ranges[i] <= within and ranges[i] < math.inf
        close += ranges[i] < 0.0
    m, k = hits + 2 * close, 0
    points, errors, margins, passed = np.empty((m, 2)), np.empty(m), np.empty(m), np.empty(m)
    for part in range(3):  # hits; then what is too near: at the least range, and at 0
        for i in range(n):
            hit = 0.0 <= ranges[i] <= within and ranges[i] < math.inf
            if (part == 0 and not hit) or (part > 0 and not ranges[i] < 0.0):
                continue
            r, error, bound = (least if part == 1 else 0.0), TOO_NEAR, 0.0
            if part == 0:
                r, count = averaged(ranges, i, step, noise)
                error = noise / math.sqrt(1.0 if alone else count)
                bound = SURE * error
            bearing = psi + bearings[i]
            points[k, 0], points[k, 1] = x + r * math.cos(bearing), y + r * math.sin(bearing)
            errors[k], margins[k] = error, bound + r * step
            passed[k] = i / max(n - 1, 1)
            k += 1
    return points, errors, margins, passed


@jit
def averaged(ranges: Floats, i: int, step: float, noise: float) -> tuple[float, float]:
    """The range of a beam that returned, averaged over the patch of surface around it, and the
    number of beams averaged."""
    own, total, count = ranges[i], ranges[i], 1.0
    for apart in range(1, NEIGHBOURS + 1):
        if own > PATCH / (apart * step):
            break
        for j in (i + apart, i - apart):
            if 0 <= j < len(ranges) and abs(ranges[j] - own) <= SAME * noise:  # not for NaN, inf
                total += ranges[j]
                count += 1.0
    return total / count, count
