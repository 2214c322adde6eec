"""Starts and ends records on request.

The last request counts: while a record is being started or finished, further requests only change
what follows. So at most one operation is under way, and nothing queues.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.drive.jobs import Jobs, told
from cohelm.drive.recorder import Recording
from cohelm.drive.session import Session
from cohelm.drive.shown import recordable
from cohelm.drive.station_publisher import StationPublisher
from cohelm.link.bulk_messages import Map, Polyline, ZoneMap
from cohelm.loop.loop import Loop
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import dump

_FINISH = 120.0
"""Time for finishing a record on a busy machine [s]."""
_LEAVE = 20.0
"""... but at the end of the drive [s]."""
_log = logging.getLogger("cohelm.drive")

Make = Callable[[Path, RobotModel, str], Recording]


class RecordSwitch:
    """The records of one session; called from the loop's thread."""

    def __init__(
        self, session: Session, publisher: StationPublisher, folder: Path, jobs: Jobs,
        drawn: Callable[[], Iterable[Map | ZoneMap | Polyline]], make: Make,
    ) -> None:  # fmt: skip
        """folder: for the records. drawn: what each record has to begin with."""
        self._session, self._publisher, self._folder = session, publisher, folder
        self._jobs, self._drawn, self._make = jobs, drawn, make
        self._wanted = self._busy = False
        self._made: Recording | None = None
        """The present recording."""
        self._failed = ""
        """What went wrong beside the loop, until it is an alarm."""
        self._attached = False
        """Whether loop and gate process send to it."""
        publisher.end.record = self.request

    def request(self, on: bool) -> str:
        """Start or end a record; returns why not, or ""."""
        if on == self._wanted:
            return "it is recording already" if on else "it is not recording"
        if on and self._session.recording is not None:
            return "the whole drive is being recorded"
        self._wanted = on
        return ""

    def turn(self, loop: Loop) -> None:
        """Between two periods: one step towards the requested state."""
        if self._failed:
            loop.alarms.over_already("no record", self._failed)
            self._failed = ""
        if self._busy:
            return
        made = self._made
        if self._attached and loop.log.fault:  # finished as far as it goes: another may be begun
            self._wanted = False
        if made is None and self._wanted:
            self._busy = True
            self._jobs.do(self._begin)
        elif made is not None and not self._wanted:
            self._detach(loop)
            self._busy = True
            self._jobs.do(lambda: self._finish(made, _FINISH))
        elif made is not None and not self._attached:
            self._attached = True
            loop.record_into(RecordLine(made.loop))
            loop.gated.record_into(made.gated)
            for one in self._drawn():
                loop.log.show(recordable(one))

    def close(self) -> None:
        """Finish the present record, after the loop has ended."""
        if not self._jobs.close(_LEAVE):
            _log.warning("a record in %s is still being written", self._folder)
        elif self._made is not None:
            self._detach(self._session.loop)
            self._finish(self._made, _LEAVE)

    def _detach(self, loop: Loop) -> None:
        """Detach loop and gate process from the recorder."""
        if self._attached:
            self._attached = False
            loop.record_into(RecordLine(None))
            with contextlib.suppress(CohelmError):  # the gate process may have ended
                loop.gated.record_into(None)

    def _begin(self) -> None:
        robot = self._session.plan.robot
        try:
            made = self._make(_free(self._folder), robot.model, dump(robot.scenario))
            now = self._session.loop.gated.now()
            made.begin(time.time_ns() - round(now * 1e9))
            made.keep()
            self._made = made
        except Exception as error:
            self._failed = f"no record: {told(error)}"
            _log.warning("%s", self._failed)
            self._wanted = False
        finally:
            self._busy = False

    def _finish(self, made: Recording, within: float) -> None:
        try:
            if not made.close(within):
                _log.warning("%s is not whole, or still being written", made.path)
                self._failed = "the record is not whole, or still being written"
            made.path.rename(made.path.with_suffix(".mcap"))
            self._publisher.list_records()
        except Exception as error:
            self._failed = f"the record stays {made.path.name}: {told(error)}"
            _log.warning("%s", self._failed)
        finally:
            self._made, self._busy = None, False


def _free(folder: Path) -> Path:
    """A new record's name. Only a whole one is called .mcap, and can be fetched."""
    stem, n = time.strftime("%Y%m%d-%H%M%S"), 1
    path = folder / f"{stem}.part"
    while path.exists() or path.with_suffix(".mcap").exists():  # two within a second
        n += 1
        path = folder / f"{stem}-{n}.part"
    return path
