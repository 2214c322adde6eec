"""What somebody asks of a driving robot beside driving: another way, a record, pictures.

`turn` is called between two periods of the loop and takes no time; what takes long is done in a
thread, and taken up by a later turn.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose
from cohelm.drive.over_link import OverLink
from cohelm.drive.proposed import judged
from cohelm.drive.recorder import Recording
from cohelm.drive.session import Session, driver_of
from cohelm.drive.shown import drawn, way
from cohelm.law.reference import Reference
from cohelm.link.messages import Answer, Checked, Map, Mode, Polyline, Waypoints
from cohelm.link.robot_bulk import Proposed
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop
from cohelm.perceive.frames import placed
from cohelm.perceive.known import Known
from cohelm.robot.keep.kept import standing
from cohelm.robot.keep.lines import Line
from cohelm.scenario.load import dump

_MOST = 4
"""Proposals looked at in one turn: of a person who drags, the newest."""
_log = logging.getLogger("cohelm.drive")


class Desk:
    """Of one session. `close` after it."""

    def __init__(self, session: Session, operator: OverLink, known: Known | None, records: Path):
        """known: the map. records: the folder for records."""
        self._session, self._operator, self._records = session, operator, records
        self._cells, self._bounds = _occupied(known)
        self._speed = session.plan.robot.scenario.reference.speed_mps
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._pose = session.plan.robot.start
        self._accepted: Floats | None = None
        self._after: Mode | None = None
        self._building = False
        self._built: tuple[Driver, Reference] | None = None
        self._recording: Recording | None = None
        self._lines: tuple[socket.socket | None, socket.socket | None] | None = None
        """Ends for loop and keeper to speak into from the next turn on."""
        self._drawn: tuple[Map | Polyline, ...] = ()
        self._wanted = False
        self._taken = threading.Event()
        operator.record = self._record
        session.shown = operator.picture
        self._map = () if known is None else (drawn(known),)
        self._show(*self._map, *way(session.plan.robot.scenario.reference.spline()))
        self._thread = threading.Thread(target=self._work, name="desk", daemon=True)
        self._thread.start()

    # ---- in the loop's thread -----------------------------------------------------------

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        if loop.seen is not None:
            self._pose = loop.seen.pose
        for one in self._operator.proposed()[-_MOST:]:
            self._jobs.put(lambda one=one: self._judge(one))
        if self._lines is not None:
            ours, keepers = self._lines
            loop.record_into(Line(ours))
            loop.keeper.record_into(keepers)
            self._lines = None
            self._taken.set()
            for one in self._drawn:
                loop.note(one)
        self._change_way(loop)

    def _change_way(self, loop: Loop) -> None:
        """Stand, have a driver made for the new way, and go on with it as before."""
        if self._accepted is not None and not self._building:
            if loop.mode != Mode.HOLD:
                self._after = loop.mode
                loop.choose(Mode.HOLD)
            elif loop.seen is not None and standing(loop.seen.twist):
                points, self._accepted, self._building = self._accepted, None, True
                pose = loop.seen.pose
                self._jobs.put(lambda: self._build(points, pose))
        if self._built is not None:
            (driver, reference), self._built = self._built, None
            old, loop.driver = loop.driver, driver
            self._session.driver = driver
            self._jobs.put(old.close)
            lines = way(reference)
            self._show(*self._map, *lines)
            for line in lines:
                loop.note(line)
            self._building = False
            after, self._after = self._after, None
            if after is not None and self._accepted is None:
                loop.choose(after)

    def _record(self, on: bool) -> str:
        """Asked by a person; the thread does it."""
        if on == self._wanted:
            return "it is recording already" if on else "it is not recording"
        if on and self._session.recording is not None:
            return "the whole drive is being recorded"
        self._wanted = on
        self._jobs.put(self._begin if on else self._finish)
        return ""

    # ---- in the desk's thread -----------------------------------------------------------

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception:
                _log.exception("what was asked for could not be done")

    def _judge(self, one: Proposed) -> None:
        if not isinstance(one.what, Waypoints):
            return
        number, points, only_check = one.what
        outline = self._session.plan.robot.model.outline
        said = judged(points, self._pose, self._speed, outline, self._cells, self._bounds)
        ok, why = said.reference is not None, said.why
        if ok and not only_check and one.client != self._operator.driver:
            ok, why = False, "you do not drive"
        self._operator.reply(one.client, Checked(Answer(number, ok, why), said.worst))
        if ok and not only_check:
            self._accepted = points

    def _build(self, points: Floats, pose: Pose) -> None:
        plan = self._session.plan
        said = judged(points, pose, self._speed, plan.robot.model.outline, self._cells,
                      self._bounds)  # fmt: skip
        if said.reference is None:
            _log.warning("the way can not be followed any more: %s", said.why)
            self._building = False
            return
        driver = driver_of(plan, plan.robot.real_time, said.reference)
        self._built = (driver, said.reference)

    def _begin(self) -> None:
        robot = self._session.plan.robot
        # only a whole record is called .mcap, and can be fetched
        path = self._records / f"{time.strftime('%Y%m%d-%H%M%S')}.part"
        try:
            self._records.mkdir(parents=True, exist_ok=True)
            made = Recording(path, robot.model, dump(robot.scenario))
        except (CohelmError, OSError) as error:
            _log.warning("no record: %s", error)
            self._wanted = False
            return
        now = self._session.loop.keeper.now()
        made.begin(time.time_ns() - round(now * 1e9))
        self._recording, self._lines = made, (made.loop, made.keeper)

    def _finish(self) -> None:
        made, self._recording = self._recording, None
        if made is None:
            return
        loop = self._session.loop  # it must speak no more when the lines are closed
        if loop.turning:
            self._taken.clear()
            self._lines = (None, None)
            self._taken.wait(1.0)
        else:
            loop.record_into(Line(None))
            with contextlib.suppress(CohelmError):  # there is no keeper any more
                loop.keeper.record_into(None)
        made.close(within=120.0)  # what starts slowly on a busy machine also ends slowly
        made.path.rename(made.path.with_suffix(".mcap"))
        self._operator.list_records()

    def _show(self, *all_: Map | Polyline) -> None:
        """To the stations now, and to records that begin later."""
        self._drawn = all_
        for one in all_:
            self._operator.publish(one)

    def close(self) -> None:
        """Finish what is being done, and the record."""
        self._jobs.put(self._finish)
        self._jobs.put(None)
        self._thread.join(30.0)
        if self._built is not None:
            self._built[0].close()


def _occupied(known: Known | None) -> tuple[Floats, Floats]:
    """Centres of occupied cells (p, 2), and the corners of the map (2, 2) [m]."""
    if known is None:
        return np.empty((0, 2)), np.empty((0, 2))
    rows, columns = np.nonzero(known.gap <= 0.0)
    own = np.asarray(np.column_stack((columns, rows)) + 0.5, dtype=np.float64) * known.resolution
    height, width = known.gap.shape
    ends = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
    corners = placed(np.array(ends, dtype=np.float64) * known.resolution, known.origin)
    return placed(own, known.origin), np.stack((corners.min(axis=0), corners.max(axis=0)))
