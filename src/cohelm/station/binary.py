"""Binary messages to the page: maps, zones, scans and pictures. `web/src/binary.ts` reads them.

Little-endian; the first four bytes are the type. Arrays begin at a multiple of eight bytes, so that
the page can read them in place.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from cohelm.link.bulk_messages import Map, Picture, ZoneMap
from cohelm.link.scans import WholeScan

MAP, SCAN, FRAME, ZONES = 1, 2, 3, 4
_MAP = struct.Struct("<II4d6I")
_ZONES = struct.Struct("<II5d2I")
_SCAN = struct.Struct("<II6dII")
_FRAME = struct.Struct("<II4d")


def map_part(part: Map) -> bytes:
    """A map, or a rectangle of one; its cells stay compressed."""
    head = _MAP.pack(
        MAP, part.number, *part.origin, part.resolution, part.width, part.height,
        part.column, part.row, part.columns, part.rows,
    )  # fmt: skip
    return head + part.cells


def zones(message: ZoneMap) -> bytes:
    """Keep-out or speed zones; cells stay compressed."""
    head = _ZONES.pack(
        ZONES,
        message.what,
        *message.origin,
        message.resolution,
        message.usual,
        message.columns,
        message.rows,
    )
    return head + message.cells


def scan(whole: WholeScan, age: float) -> bytes:
    """A scan. age: since it was taken [s]."""
    ranges = np.ascontiguousarray(whole.ranges, dtype="<u2")
    head = _SCAN.pack(
        SCAN, whole.number, *whole.sensor, whole.first, whole.step, _finite(age) * 1e3,
        len(ranges), whole.lidar,
    )  # fmt: skip
    return head + ranges.tobytes()


def frame(picture: Picture, age: float) -> bytes:
    """A picture of the camera, with the pose it was taken from."""
    head = _FRAME.pack(FRAME, picture.number, *picture.pose, _finite(age) * 1e3)
    return head + picture.jpeg


def _finite(age: float) -> float:
    return age if math.isfinite(age) else 0.0
