"""Compresses camera frames to JPEG in a thread: the loop gives a frame and takes a picture."""

from __future__ import annotations

import io
import logging
import threading
from collections import deque
from typing import NamedTuple

from PIL import Image

from cohelm.core.types import Pose
from cohelm.robot.keep.record_pipe import LARGEST
from cohelm.robot.port import Encoded, Frame

_QUALITY, _LEAST = 75, 20  # of a JPEG
_LARGEST = LARGEST - 1000
"""Largest picture of a record [B]; a larger one gets less quality, then fewer pixels."""
_log = logging.getLogger("cohelm.drive")


class Packed(NamedTuple):
    """A picture, ready to be sent or recorded."""

    stamp: float
    """Time of exposure by the robot's clock [s]."""
    number: int
    pose: Pose
    """Of the robot on the map, as estimated when the frame was given."""
    data: bytes
    """JPEG."""


class Pictures:
    """Compresses the newest frame; an older one that still waits is dropped."""

    def __init__(self, waits: bool) -> None:
        """waits: compress at once, not in the thread: for simulated time."""
        self._waits = waits
        self._frames: deque[tuple[Frame | Encoded, Pose]] = deque(maxlen=1)
        self._packed: deque[Packed] = deque(maxlen=1)
        self._number = -1
        self._waker = threading.Event()
        self._open = True
        self._thread = threading.Thread(target=self._pack, name="pictures", daemon=True)
        if not waits:
            self._thread.start()

    def give(self, frame: Frame | Encoded, pose: Pose) -> None:
        """Compress a frame; the same frame again is ignored."""
        if frame.number == self._number:
            return
        self._number = frame.number
        if self._waits:
            self._packed.append(_packed(frame, pose))
        else:
            self._frames.append((frame, pose))
            self._waker.set()

    def take(self) -> Packed | None:
        """The newest picture, each once; or None."""
        try:
            return self._packed.pop()
        except IndexError:
            return None

    def close(self) -> None:
        """End the thread."""
        self._open = False
        self._waker.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def _pack(self) -> None:
        while True:
            self._waker.wait()
            self._waker.clear()
            if not self._open:
                return
            try:
                self._packed.append(_packed(*self._frames.pop()))
            except IndexError:  # it was compressed by the turn before
                continue
            except Exception:  # drop this picture
                _log.exception("a picture could not be packed")


def _packed(frame: Frame | Encoded, pose: Pose) -> Packed:
    """A frame as a JPEG of at most `_LARGEST`; one that is so already is not compressed again."""
    if isinstance(frame, Frame):
        image = Image.fromarray(frame.pixels)
    else:
        image = Image.open(io.BytesIO(frame.data))
        if image.format == "JPEG" and len(frame.data) <= _LARGEST:
            return Packed(frame.stamp, frame.number, pose, frame.data)
        image = image.convert("RGB")
    quality = _QUALITY
    while True:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=quality)
        if file.tell() <= _LARGEST:
            return Packed(frame.stamp, frame.number, pose, file.getvalue())
        if quality > _LEAST:
            quality = max(quality // 2, _LEAST)
        else:
            image, quality = image.reduce(2), _QUALITY
