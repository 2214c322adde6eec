"""Shared memory for scans and frames from the gate process to the loop, without locks; and for the
call of the driver in which that process may hang.

The gate process writes only when the loop requests readings, and the loop copies them before it
requests again: so what is read is consistent, and a loop that hangs blocks no process.
"""

from __future__ import annotations

import mmap
import os
from itertools import accumulate
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings, Scan

_ALIGNED = 64  # bytes
_NUMBER = 8  # bytes of a range
CALLS = ("", "read", "send", "stop")
"""Of a robot's driver; the first: none."""


class Stored(NamedTuple):
    """Where an array lies, instead of the array itself."""

    at: int
    shape: tuple[int, ...]
    dtype: str


class SharedMemory:
    """Memory for a scan of each LiDAR, and a frame. It is freed when both processes end."""

    def __init__(self, handle: int, scans: dict[str, int], frame: int) -> None:
        """handle: of the memory, see `shared`. scans: bytes for each LiDAR's scan, by name, the
        first one first. frame: bytes for a frame."""
        self.handle, self.scans, self.frame = handle, scans, frame
        self._memory = mmap.mmap(handle, _size(scans, frame))
        ends = list(accumulate(map(_aligned, scans.values()), initial=0))
        self._at = dict(zip(scans, ends, strict=False))
        self._frame_at = ends[-1]

    def calling(self, call: str) -> None:
        """The driver is in this one of `CALLS` from now on."""
        self._memory[-1] = CALLS.index(call)

    @property
    def called(self) -> str:
        """The call that it is in."""
        return CALLS[self._memory[-1]]

    def put(self, readings: Readings) -> Readings:
        """Store the arrays; returns the readings with `Stored` for each that has room."""
        scan, frame = readings.scan, readings.frame
        further = [self._put_scan(one, one.sensor) for one in readings.further]
        readings = readings._replace(
            scan=None if scan is None else self._put_scan(scan, next(iter(self.scans), "")),
            further=tuple(one for one in further if one is not None),
        )
        if frame is not None:
            pixels = self._put(np.asarray(frame.pixels), self._frame_at, self.frame)
            readings = readings._replace(frame=frame._replace(pixels=pixels) if pixels else None)
        return readings

    def take(self, readings: Readings) -> Readings:
        """Inverse of `put`, with read-only copies of the arrays."""
        scan, frame = readings.scan, readings.frame
        readings = readings._replace(
            scan=None if scan is None else scan._replace(ranges=self._take(scan.ranges)),
            further=tuple(one._replace(ranges=self._take(one.ranges)) for one in readings.further),
        )
        if frame is not None:
            readings = readings._replace(frame=frame._replace(pixels=self._take(frame.pixels)))
        return readings

    def _put_scan(self, scan: Scan, lidar: str) -> Scan | None:
        ranges = self._put(
            np.asarray(scan.ranges), self._at.get(lidar, 0), self.scans.get(lidar, 0)
        )  # fmt: skip
        return scan._replace(ranges=ranges) if ranges else None

    def _put(self, what: NDArray[Any], at: int, room: int) -> Any:
        if what.nbytes > room:
            return None
        there = np.ndarray(what.shape, what.dtype, self._memory, at)
        there[...] = what
        return Stored(at, what.shape, what.dtype.str)

    def _take(self, where: Any) -> Any:
        at, shape, dtype = cast("Stored", where)
        out = np.ndarray(shape, dtype, self._memory, at).copy()
        out.flags.writeable = False
        return out


def shared(model: RobotModel) -> SharedMemory:
    """Allocate memory for a robot's sensors. Raises CohelmError where there is none."""
    camera = model.camera
    scans = {lidar.name: _NUMBER * lidar.beams for lidar in model.lidars}
    frame = 3 * camera.width * camera.height if camera else 0
    try:
        handle = os.memfd_create("cohelm sensors", os.MFD_CLOEXEC)
        os.ftruncate(handle, _size(scans, frame))  # subject to the limit on file sizes
    except OSError as error:
        raise CohelmError(
            f"there is no memory for scans and frames, {_size(scans, frame)} bytes "
            f"({error.strerror}): see `ulimit -f`, `ulimit -n`"
        ) from error
    return SharedMemory(handle, scans, frame)


def _aligned(size: int) -> int:
    return -(-size // _ALIGNED) * _ALIGNED


def _size(scans: dict[str, int], frame: int) -> int:
    return sum(map(_aligned, scans.values())) + frame + 1
