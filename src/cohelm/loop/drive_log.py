"""Sends readings, periods, texts and events of a drive to the recorder and the live view."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cohelm.core.row import ROW, values
from cohelm.core.types import Floats
from cohelm.link.bulk_messages import Map, Polyline, ZoneMap
from cohelm.link.messages import Discs, Mode
from cohelm.link.recorded_status import Displayed, StatusWords
from cohelm.robot.keep.record_pipe import Event, OutlineChange, RecordLine
from cohelm.robot.port import Readings, Scan

_NO_VIEW = "the live view has ended: the robot continues without it"
_VIEW_HANGS = "the live view is too slow: some messages are not shown"


class DriveLog:
    """Sends everything once, to the recorder and the live view, as far as they have room."""

    def __init__(
        self, line: RecordLine, clock: Callable[[], float], live: RecordLine | None = None
    ) -> None:
        """clock: the robot's [s]."""
        self._line, self._clock = line, clock
        self._live = RecordLine(None) if live is None else live
        self._viewer_wants_pictures = False
        """Whether a viewer of the live view wants pictures."""
        self.fault = ""
        """Why the recorder has failed; empty: it has not, or there is none."""
        self._row = np.zeros((), dtype=ROW)
        self._odometry, self._scan = -math.inf, -1
        self._further: dict[str, int] = {}
        self._words: StatusWords | None = None
        self._outline: OutlineChange | None = None

    def __call__(self, message: object) -> None:
        """Send a message to both."""
        self._line(message)
        self._live(message)

    def set_recorder(self, line: RecordLine) -> None:
        """Use another recorder from now on, or none; the previous one is not closed."""
        self._line, self.fault, self._words = line, "", None
        if self._outline is not None:
            line(self._outline)

    @property
    def open(self) -> bool:
        """Whether there is a recorder that writes."""
        return self._line.open and not self.fault

    @property
    def wants_pictures(self) -> bool:
        """Whether anything uses pictures."""
        return self.open or self._viewer_wants_pictures

    @property
    def dropped(self) -> int:
        """Messages the recorder had no room for."""
        return self._line.dropped

    def why(self, mode: Mode) -> str:
        """Why the robot does less than requested in a mode, by the last status; empty: it does
        not."""
        words = self._words
        return "" if words is None or words.mode != mode else words.why

    @property
    def hung(self) -> bool:
        """Whether the recorder hangs."""
        return self._line.hung

    def failed(self) -> bool:
        """Whether the recorder has failed just now; `fault` has the reason."""
        reported = str(self._line.received() or self._line.broken)
        new = bool(reported) and reported != self.fault
        self.fault = reported or self.fault
        return new

    def view_trouble(self) -> str:
        """What is wrong with the live view; empty: nothing, or there is no live view."""
        reported = self._live.received()
        if isinstance(reported, bool):
            self._viewer_wants_pictures = reported
        if self._live.broken:
            self._viewer_wants_pictures = False
            return _NO_VIEW
        return _VIEW_HANGS if self._live.hung else ""

    @property
    def view_lost(self) -> bool:
        """Whether the live view's process has ended by itself."""
        return bool(self._live.broken)

    def event(self, text: str, serious: bool = False) -> None:
        """Log an event."""
        self(Event(self._clock(), "loop", text, serious))

    def show(self, what: Map | ZoneMap | Polyline | Discs) -> None:
        """Record what the stations are shown, for playback."""
        self(Displayed(self._clock(), what))

    def outline(self, corners: Floats) -> None:
        """The robot has another outline from now on, (k, 2) [m]."""
        self._outline = OutlineChange(self._clock(), corners)
        self(self._outline)

    def readings(self, readings: Readings) -> tuple[Scan, ...]:
        """Send what is new. Returns the new scans, that of the first LiDAR first."""
        odometry, scan = readings.odometry, readings.scan
        if odometry is not None and odometry.stamp != self._odometry:
            self._odometry = odometry.stamp
            self(odometry)
        new = () if scan is None or scan.number == self._scan else (scan,)
        for one in new:
            self._scan = one.number
        for one in readings.further:
            if self._further.get(one.sensor) != one.number:
                self._further[one.sensor] = one.number
                new = (*new, one)
        for one in new:
            self(one)
        return new

    def period(self, known: Mapping[str, Any]) -> NDArray[np.void]:
        """Record a period by its known fields. Returns its row, valid until the next one."""
        self._row[()] = values(known)
        self(self._row.tobytes())
        return self._row

    def words(self, words: StatusWords) -> None:
        """Record the texts of a status, where they have changed."""
        if words != self._words:
            self._words = words
            self(Displayed(self._clock(), words))
