"""What a drive leaves: readings, decisions, words and events, on their way to a recorder."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cohelm.core.row import ROW, values
from cohelm.link.messages import Discs, Map, Polyline, Status
from cohelm.link.recorded_status import Displayed, StatusWords
from cohelm.robot.keep.gated_robot import Event
from cohelm.robot.keep.record_pipe import Line
from cohelm.robot.port import Readings, Scan


class DriveLog:
    """Says things once, to the recorder there is, as much as that has room for."""

    def __init__(self, line: Line, clock: Callable[[], float]) -> None:
        """clock: the robot's [s]."""
        self._line, self._clock = line, clock
        self.fault = ""
        """Why the recorder writes no more; empty while it does, or where there is none."""
        self._row = np.zeros((), dtype=ROW)
        self._odometry, self._scan = -math.inf, -1
        self._further: dict[str, int] = {}
        self._words: StatusWords | None = None

    def __call__(self, message: object) -> None:
        """Anything."""
        self._line(message)

    def into(self, line: Line) -> None:
        """Another recorder from now on, or none; the one before is not closed."""
        self._line, self.fault, self._words = line, "", None

    @property
    def open(self) -> bool:
        """Whether there is a recorder that still writes."""
        return self._line.open and not self.fault

    @property
    def dropped(self) -> int:
        """Messages the recorder had no room for."""
        return self._line.dropped

    @property
    def mute(self) -> bool:
        """Whether the recorder hangs."""
        return self._line.mute

    def failed(self) -> bool:
        """Whether the recorder has just shown that it writes no more; `fault` says why."""
        said = str(self._line.heard() or self._line.broken)
        new = bool(said) and said != self.fault
        self.fault = said or self.fault
        return new

    def event(self, text: str, serious: bool = False) -> None:
        """What happened."""
        self._line(Event(self._clock(), "loop", text, serious))

    def show(self, what: Map | Polyline | Discs) -> None:
        """What the stations are shown, that the drive can be shown again."""
        self._line(Displayed(self._clock(), what))

    def readings(self, readings: Readings) -> tuple[Scan, ...]:
        """What is new among them. Returns the scans that are, that of the first LiDAR first."""
        odometry, scan = readings.odometry, readings.scan
        if odometry is not None and odometry.stamp != self._odometry:
            self._odometry = odometry.stamp
            self._line(odometry)
        new = () if scan is None or scan.number == self._scan else (scan,)
        for one in new:
            self._scan = one.number
        for one in readings.further:
            if self._further.get(one.sensor) != one.number:
                self._further[one.sensor] = one.number
                new = (*new, one)
        for one in new:
            self._line(one)
        return new

    def period(self, known: Mapping[str, Any]) -> None:
        """One period, of which so much is known."""
        self._row[()] = values(known)
        self._line(self._row.tobytes())

    def words(self, driver: tuple[int, str], s: Status) -> None:
        """The words of a status, where they are new. driver: number and name."""
        told = StatusWords(*driver, s.mode, s.stopped, s.why, s.speed_cap, s.cap_reason, s.alarms)
        if told != self._words:
            self._words = told
            self._line(Displayed(self._clock(), told))
