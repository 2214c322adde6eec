"""The robot's outline as it changes, from a topic (geometry_msgs/msg/PolygonStamped)."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.robot.footprint import convex_outline, farthest_corner
from cohelm.robot.model import RobotModel
from cohelm.ros.mismatch import POLYGON
from cohelm.ros.port import LATCHED, SENSOR, Received, Transport

_SAME = 0.001
"""Corners that are nearer to each other are the same [m]."""
_MOST = 32
"""Corners."""
_CHANGES, _WITHIN = 5, 5.0
"""An outline that changes so often within so long can not be kept clear [s]."""


class FootprintTopic:
    """The newest outline received, or what is wrong with it; None before the first."""

    def __init__(self, transport: Transport, topic: str, body: str, model: RobotModel) -> None:
        """body: the frame of the base, in which an outline has to be. model: the robot's file; an
        outline that reaches more than twice as far, or less far than its least, is none."""
        self._topic, self._body, self._model = topic, body, model
        self._lock = threading.Lock()
        self._newest: Floats | None = None
        self._error = ""
        self._changes: deque[float] = deque(maxlen=_CHANGES)
        """When it last was another than before [s]."""
        for qos in (SENSOR, LATCHED):  # repeated best effort, or latched
            transport.subscribe(topic, POLYGON, qos, self._on_polygon)

    def read(self) -> tuple[Floats | None, str]:
        """The outline, (k, 2) [m], and why it can not be relied on; empty: it can."""
        with self._lock:
            return self._newest, self._error

    def _on_polygon(self, received: Received) -> None:
        try:
            if received.message is None:
                raise CohelmError(f"it can not be read ({received.damage})")
            made, error = self._outline(received.message), ""
        except CohelmError as why:
            made, error = None, f"{self._topic}: {why}"
        now = time.monotonic()
        with self._lock:
            if made is not None and not _same(made, self._newest):
                if self._newest is not None:
                    self._changes.append(now)
                self._newest = made
            self._error = error or self._restless(now)

    def _restless(self, now: float) -> str:
        if len(self._changes) < _CHANGES or now - self._changes[0] > _WITHIN:
            return ""
        return (
            f"{self._topic}: the outline changes with every message: publish it in the frame of "
            "the base, and another one only when the robot has another shape"
        )

    def _outline(self, message: Any) -> Floats:
        """Of a message. CohelmError for what is no outline of the robot's."""
        frame = message.header.frame_id.lstrip("/")
        if frame != self._body:
            raise CohelmError(
                f"it is in the frame {frame!r}, and an outline is in that of the base, "
                f"{self._body!r}: publish it in that"
            )
        axle, reach = self._model.axle_x_m, self._model.reach
        corners = [(float(one.x) - axle, float(one.y)) for one in message.polygon.points]
        if len(corners) > _MOST:
            raise CohelmError(f"an outline has at most {_MOST} corners, got {len(corners)}")
        made = convex_outline(np.array(corners, dtype=np.float64).reshape(-1, 2))
        edges = np.roll(made, -1, axis=0) - made
        if not (edges[:, 1] * made[:, 0] > edges[:, 0] * made[:, 1]).all():
            raise CohelmError(
                "the outline does not contain the middle of the axle: give it in the frame of the "
                "base"
            )
        far = farthest_corner(made)
        if far > 2.0 * reach:
            raise CohelmError(
                f"the outline reaches {far:.2f} m from the base, more than twice the "
                f"{reach:.2f} m of the robot's file: fix either"
            )
        return self._model.checked_outline(made)


def _same(made: Floats, before: Floats | None) -> bool:
    """Whether it is the outline that there was, wherever its corners begin."""
    if before is None or made.shape != before.shape:
        return False
    off = np.abs(made[:, None] - before[None]).max(axis=2)
    first = int(off[0].argmin())
    return float(np.abs(made - np.roll(before, -first, axis=0)).max()) <= _SAME
