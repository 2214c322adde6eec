"""The camera's frames as JPEG, packed in a thread: the loop hands one over, and takes one back."""

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
"""A picture that is larger goes into no record: it is packed more tightly, and then smaller [B]."""
_log = logging.getLogger("cohelm.drive")


class Packed(NamedTuple):
    """A picture, ready to be sent or written down."""

    stamp: float
    """When it was taken, by the robot's clock [s]."""
    number: int
    pose: Pose
    """Of the robot on the map, as it was known when the frame was handed over."""
    data: bytes
    """JPEG."""


class Pictures:
    """Packs the newest frame; one that is not packed when a newer one comes never is."""

    def __init__(self, waits: bool) -> None:
        """waits: pack at once instead of in the thread, as simulated time may."""
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
        """Have a frame packed; one that was given before is not packed again."""
        if frame.number == self._number:
            return
        self._number = frame.number
        if self._waits:
            self._packed.append(_packed(frame, pose))
        else:
            self._frames.append((frame, pose))
            self._waker.set()

    def take(self) -> Packed | None:
        """The newest that is packed; each once."""
        try:
            return self._packed.pop()
        except IndexError:
            return None

    def close(self) -> None:
        """No more."""
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
            except IndexError:  # it was packed by the turn before
                continue
            except Exception:  # one picture less
                _log.exception("a picture could not be packed")


def _packed(frame: Frame | Encoded, pose: Pose) -> Packed:
    """What is JPEG already, and small enough, stays as it is."""
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
