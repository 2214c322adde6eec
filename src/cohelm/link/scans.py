"""Assembles scans from the parts in which the robot sends them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats
from cohelm.link.messages import ScanPart

_MOST_LIDARS = 16
_MOST_BEAMS = 100_000


def millimetres(ranges: Floats) -> NDArray[np.uint16]:
    """Ranges [m] as a `ScanPart` has them [mm]: 65535 for no return, also for NaN; 0 too near."""
    known = np.where(ranges == -math.inf, 0.0, ranges)
    far = ~np.isfinite(known)
    whole = np.round(1000.0 * np.where(far, 0.0, known))
    return np.where(far, 65535, np.minimum(whole, 65534)).astype(np.uint16)


class Scans:
    """Assembles the scans of each LiDAR."""

    def __init__(self) -> None:
        self._parts: dict[int, dict[int, ScanPart]] = {}
        """Parts of the newest scan of each LiDAR, by their first beam."""
        self._newest: dict[int, int] = {}
        """Number of the last scan of each that was returned."""

    def take(self, part: ScanPart) -> ScanPart | None:
        """Take a part, in any order; implausible parts are dropped. Returns all of the scan as one
        part, once it is whole, or others have been lost before it; lost parts count as beams
        without a return."""
        if part.lidar >= _MOST_LIDARS:
            return None
        parts = self._parts.setdefault(part.lidar, {})
        if parts and next(iter(parts.values())).number != part.number:
            if part.number < next(iter(parts.values())).number:
                return None
            parts.clear()
        if part.start + len(part.ranges) > part.beams or part.beams > _MOST_BEAMS:
            return None
        parts[part.start] = part
        ranges = np.full(part.beams, 65535, np.uint16)
        for piece in parts.values():
            if piece.beams == part.beams:
                ranges[piece.start : piece.start + len(piece.ranges)] = piece.ranges
        whole = sum(len(piece.ranges) for piece in parts.values()) >= part.beams
        if not whole and part.number <= self._newest.get(part.lidar, -2) + 1:
            return None
        self._newest[part.lidar] = part.number
        return part._replace(start=0, ranges=ranges)
