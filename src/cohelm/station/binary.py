"""What travels to the page as bytes: maps, scans and pictures. `web/src/binary.ts` reads it.

Little-endian; the first four bytes say what it is. Arrays begin at a multiple of eight bytes, so
that the page can look at them in place.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import NDArray

from cohelm.link.messages import Map, Picture, ScanPart

MAP, SCAN, FRAME = 1, 2, 3
_MAP = struct.Struct("<II4d6I")
_SCAN = struct.Struct("<II6dII")
_FRAME = struct.Struct("<II4d")


def map_part(part: Map) -> bytes:
    """A map, or a rectangle of one; its cells stay compressed."""
    head = _MAP.pack(
        MAP, part.number, *part.origin, part.resolution, part.width, part.height,
        part.column, part.row, part.columns, part.rows,
    )  # fmt: skip
    return head + part.cells


def scan(part: ScanPart, ranges: NDArray[np.uint16], age_s: float) -> bytes:
    """A whole scan; `part` is any of its parts, `ranges` all of its beams [mm]."""
    head = _SCAN.pack(
        SCAN, part.number, *part.sensor, part.first, part.step, _finite(age_s) * 1e3, len(ranges), 0
    )
    return head + np.ascontiguousarray(ranges, dtype="<u2").tobytes()


def frame(picture: Picture, age_s: float) -> bytes:
    """A picture of the camera, with the pose it was taken from."""
    head = _FRAME.pack(FRAME, picture.number, *picture.pose, _finite(age_s) * 1e3)
    return head + picture.jpeg


def _finite(age: float) -> float:
    return age if math.isfinite(age) else 0.0
