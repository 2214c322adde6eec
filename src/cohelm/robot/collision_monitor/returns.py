"""Where a scan's returns are in the body frame, and by how much each may be wrong."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Ints, Pose

PATCH = 0.015
"""Returns of one surface within this of a return, on either side, are averaged with it [m]: over
3 cm a surface that can hurt is as good as flat; 2 mm deep, where its radius is 5 cm."""
NEIGHBOURS = 8
"""Beams on either side that are averaged at most."""
SAME = 4.2
"""Of one surface are returns that differ by less than this many sigma: the difference of two
has 1.41 sigma, so 3 of its own."""
SURE = 3.0
"""A thing may be nearer than its return by this many sigma of the average, and by as much as
two beams are apart."""


class Sensor(NamedTuple):
    """A planar LiDAR as numbers."""

    mount: Pose
    """In the body frame."""
    bearings: Floats
    """Of its beams in its own frame, counter-clockwise, (n,) [rad]."""
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
    """What to call it where there are several."""
    timeout: float = math.nan
    """Largest age of its newest scan [s]; NaN: by its rate."""
    range_max: float = math.inf
    """Farther surfaces return inf [m]."""
    height: float = math.nan
    """Of the plane in which it measures, above the body's origin [m]; NaN: nobody says so, or it
    measures in no plane."""
    forgets: float = math.inf
    """After so long it forgets what it does not see any more [s]. If it ever does, it is a range
    sensor: its beams are one measurement, which vouches for no ground."""


class Returns(NamedTuple):
    """What a scan saw."""

    points: Floats
    """In the body frame at the beam's time, (m, 2) [m]."""
    errors: Floats
    """Standard deviation of each, (m,) [m]."""
    margins: Floats
    """By how much the thing may be nearer, (m,) [m]."""
    passed: Floats
    """Which share of the scan's time had passed, (m,), in [0, 1]."""


def returns(ranges: Floats, sensor: Sensor, within: float) -> Returns:
    """The returns of one scan, but of those farther than `within` [m]. NaN and inf are none; -inf
    (REP-117) is something between the sensor and its least range, and stands at both."""
    close = np.flatnonzero(ranges < 0.0)
    hit = np.flatnonzero((ranges >= 0.0) & (ranges <= within) & np.isfinite(ranges))
    distances, counts = averaged(ranges, hit, sensor)
    if sensor.forgets < math.inf:
        counts = np.ones(len(hit))
    which = np.concatenate((hit, close, close))
    distances = np.concatenate(
        (distances, np.full(len(close), sensor.range_min), np.zeros(len(close)))
    )
    errors = np.concatenate((sensor.noise / np.sqrt(counts), np.zeros(2 * len(close))))
    bearings = sensor.mount.psi + sensor.bearings[which]
    points = np.empty((len(which), 2))
    points[:, 0] = sensor.mount.x + distances * np.cos(bearings)
    points[:, 1] = sensor.mount.y + distances * np.sin(bearings)
    margins = SURE * errors + distances * sensor.step
    return Returns(points, errors, margins, which / max(len(ranges) - 1, 1))


def averaged(ranges: Floats, hit: Ints, sensor: Sensor) -> tuple[Floats, Floats]:
    """Some ranges, each averaged over the patch of surface around it, and over how many beams."""
    own = np.where(np.isfinite(ranges), ranges, _NOWHERE)
    total, count = own.copy(), np.ones(len(own))
    for apart in range(1, NEIGHBOURS + 1):
        patch = PATCH / (apart * sensor.step)
        before, after = own[:-apart], own[apart:]
        same = np.abs(after - before) <= SAME * sensor.noise
        forth, back = same & (before <= patch), same & (after <= patch)
        np.add(total[:-apart], after, out=total[:-apart], where=forth)
        np.add(total[apart:], before, out=total[apart:], where=back)
        count[:-apart] += forth
        count[apart:] += back
    count = count[hit]
    return total[hit] / count, count


_NOWHERE = 1e6
"""The range of a beam without a return, where only differences count [m]."""
