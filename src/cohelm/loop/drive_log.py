"""Sends readings, decisions, words and events of a drive to recorder and live view."""

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

_NO_VIEW = "the live view is gone: the robot goes on without"
_VIEW_HANGS = "the live view does not answer: what it has no room for is not shown"


class DriveLog:
    """Says things once, to the recorder there is and to the live view, as much as they have room
    for."""

    def __init__(
        self, line: RecordLine, clock: Callable[[], float], live: RecordLine | None = None
    ) -> None:
        """clock: the robot's [s]."""
        self._line, self._clock = line, clock
        self._live = RecordLine(None) if live is None else live
        self._looks = False
        """Whether somebody looks through the camera, in the live view."""
        self.fault = ""
        """Why the recorder writes no more; empty while it does, or where there is none."""
        self._row = np.zeros((), dtype=ROW)
        self._odometry, self._scan = -math.inf, -1
        self._further: dict[str, int] = {}
        self._words: StatusWords | None = None
        self._outline: OutlineChange | None = None

    def __call__(self, message: object) -> None:
        """Anything."""
        self._line(message)
        self._live(message)

    def into(self, line: RecordLine) -> None:
        """Another recorder from now on, or none; the one before is not closed."""
        self._line, self.fault, self._words = line, "", None
        if self._outline is not None:
            line(self._outline)

    @property
    def open(self) -> bool:
        """Whether there is a recorder that still writes."""
        return self._line.open and not self.fault

    @property
    def wants_pictures(self) -> bool:
        """Whether there is anybody for them."""
        return self.open or self._looks

    @property
    def dropped(self) -> int:
        """Messages the recorder had no room for."""
        return self._line.dropped

    def why(self, mode: Mode) -> str:
        """Why the robot does not do what is asked for in a mode, as stations were told last; empty:
        it does."""
        words = self._words
        return "" if words is None or words.mode != mode else words.why

    @property
    def hung(self) -> bool:
        """Whether the recorder hangs."""
        return self._line.hung

    def failed(self) -> bool:
        """Whether the recorder has just shown that it writes no more; `fault` says why."""
        said = str(self._line.received() or self._line.broken)
        new = bool(said) and said != self.fault
        self.fault = said or self.fault
        return new

    def view_trouble(self) -> str:
        """What is wrong with the live view; empty: nothing, or there is none."""
        said = self._live.received()
        if isinstance(said, bool):
            self._looks = said
        if self._live.broken:
            self._looks = False
            return _NO_VIEW
        return _VIEW_HANGS if self._live.hung else ""

    @property
    def view_lost(self) -> bool:
        """Whether the live view has ended by itself."""
        return bool(self._live.broken)

    def event(self, text: str, serious: bool = False) -> None:
        """What happened."""
        self(Event(self._clock(), "loop", text, serious))

    def show(self, what: Map | ZoneMap | Polyline | Discs) -> None:
        """What the stations are shown, that the drive can be shown again."""
        self(Displayed(self._clock(), what))

    def outline(self, corners: Floats) -> None:
        """The robot's is another from now on, (k, 2) [m]."""
        self._outline = OutlineChange(self._clock(), corners)
        self(self._outline)

    def readings(self, readings: Readings) -> tuple[Scan, ...]:
        """What is new among them. Returns the scans that are, that of the first LiDAR first."""
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
        """One period, of which so much is known. Returns its row, good until the next one."""
        self._row[()] = values(known)
        self(self._row.tobytes())
        return self._row

    def words(self, words: StatusWords) -> None:
        """The words of a status, where they are new."""
        if words != self._words:
            self._words = words
            self(Displayed(self._clock(), words))
