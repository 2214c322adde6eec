"""Makes a map from a recorded drive, continues one, and applies the user's corrections."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_free, check_regular
from cohelm.core.interrupts import INTERRUPTS
from cohelm.core.types import Floats, Pose, Progress
from cohelm.perceive.map.mapper import Mapper, MappingResult, encounters
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.perceive.map.raster import Raster, cropped, raster
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.record.replay import Replayed
from cohelm.robot.model import RobotModel
from cohelm.scenario.worlds.carmen import RecordedDrive, read_log
from cohelm.study.bags import BagTopics, is_bag, read_bag
from cohelm.study.localized_drive import localized_drive
from cohelm.study.map_files import MapResult, occupancy, outcome, show, write, write_result
from cohelm.study.mapping_session import NAME, MappingSession, Mark

RESOLUTION = 0.025
"""Default side of a cell [m]."""
_MAGIC = b"\x89MCAP"
_NO_RETURN = 0.98  # of the range: farther ends are taken for none
_FARTHEST = 25.0  # and no beam is drawn farther than this [m]
_LOOK_AGAIN = 1.0  # a growing record is read so often [s]
_ENDED = 10.0  # and has ended if nothing came for this long [s]
_SAVED = 30.0  # what is done is kept so often, for the power to fail [s]
_SHOWN, _DRAWING = 2.0, 0.05  # map.png is drawn so often [s], in this share of the time at most
_SAME = 1e-6  # scans that end at times no farther apart are one [s]


def drive(
    path: Path, robot: RobotModel | None = None, topics: BagTopics | None = None
) -> RecordedDrive:
    """Odometry and scans of a record: our MCAP, any with /odom and /scan, a bag, or a CARMEN log.

    robot: whose LiDAR it was, where an MCAP record does not have it. topics: of a bag that has
    several. Raises CohelmError where the file is none of them, or holds nothing to map.
    """
    if is_bag(path):
        return read_bag(path, topics or BagTopics(), robot and robot.lidar)
    if topics is not None and topics != BagTopics():
        raise CohelmError(
            f"{path} is no ROS bag: --scan-topic and --odom-topic are for one; of ROS 2, name the "
            "folder that has its metadata.yaml"
        )
    check_regular(path)
    try:
        with path.open("rb") as file:
            mcap = file.read(len(_MAGIC)) == _MAGIC
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error
    if not mcap and path.suffix == ".mcap":
        raise CohelmError(f"{path} is not an MCAP file: give a record, or a CARMEN log")
    if not mcap:
        return read_log(path)
    replayed = Replayed(path, robot)
    if not replayed.scans:
        raise CohelmError(f"{path} holds no scan (/scan): give the record of a drive with a LiDAR")
    lidar = replayed.model.lidar
    if lidar is None:
        raise CohelmError(f"{path}: the robot {replayed.model.name} has no LiDAR to map with")
    return RecordedDrive(replayed.odometry, replayed.scans, lidar, replayed.whole)


class _BetweenScans:
    """Takes `INTERRUPTS` that are handled between two scans: in the middle of one, what is kept
    would fit nothing. Pressed again, it comes at once."""

    def __init__(self) -> None:
        self._pressed = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for kind in INTERRUPTS:
                if callable(signal.getsignal(kind)):
                    self._before[kind] = signal.signal(kind, self._press)
        return self

    def __exit__(self, *_: object) -> None:
        for kind, handler in self._before.items():
            signal.signal(kind, handler)

    def _press(self, kind: int, frame: FrameType | None) -> None:
        if self._pressed:
            self._before[kind](kind, frame)
        self._pressed = True

    def now(self) -> None:
        """KeyboardInterrupt if it was pressed."""
        if self._pressed:
            raise KeyboardInterrupt


class Interrupted(KeyboardInterrupt):
    """Mapping was interrupted, and what it had done was kept."""


def mapped(
    path: Path, folder: Path, resolution: float | None, progress: Progress, *, live: bool = False,
    robot: RobotModel | None = None, resume: bool = False, topics: BagTopics | None = None,
    localise: bool = False,
) -> MapResult:  # fmt: skip
    """Map a record into a folder: map.yaml, map.pgm, map.png, trajectory.csv, loops.csv,
    mapping.json, and survey.npz to go on from. map.png is drawn anew every few seconds meanwhile.

    live: the record is still being written; go on until nothing more comes, or Ctrl-C. resume: go
    on with the mapping in the folder, where it was interrupted; or, with another record, from where
    its drive ended. localise: then localize the record on the map. Raises Interrupted where Ctrl-C
    is not the usual end. Raises CohelmError where the folder holds a mapping, unless that is to go
    on.
    """
    start = time.perf_counter()
    if not resume:
        _check_unmapped(folder, "choose another folder with --out, or go on with it by --resume")
    session = MappingSession.read(folder) if resume else None
    recorded = _live_drive(path, robot) if live else drive(path, robot, topics)
    if session is None:
        session = MappingSession(
            recorded.lidar, Mapper(recorded.lidar.lidar()), resolution or RESOLUTION
        )
    else:
        session.resolution = resolution or session.resolution
        _go_on(session, recorded, path)
    try:
        with _BetweenScans() as interruption:
            saved = grown = time.monotonic()
            show_at = saved + _SHOWN
            while True:
                new = _new(recorded, session, live)
                for k, sweep in enumerate(new):
                    session.add(sweep)
                    if k % 20 == 0:
                        at = f"scan {len(session.stamps)}, {session.survey.places} places"
                        progress(at, 0.0 if live else 0.6 * k / len(new))
                    interruption.now()
                    if session.blank:  # nothing worth a folder
                        continue
                    if time.monotonic() - saved > _SAVED:
                        session.save(folder)
                        saved = time.monotonic()
                    if time.monotonic() > show_at:
                        show_at = _shown(session, folder)
                if not live:
                    break
                grown = time.monotonic() if new else grown
                if time.monotonic() - grown > _ENDED:
                    break
                time.sleep(_LOOK_AGAIN)
                interruption.now()
                recorded = drive(path, robot)
    except KeyboardInterrupt as stop:
        if not session.complete:
            raise
        if not live:  # of a live drive, Ctrl-C is the usual end
            session.save(folder)
            raise Interrupted from stop
    session.whole = session.whole and (recorded.whole or live)
    if not session.stamps:
        raise CohelmError(f"{path}: no scan came while there was odometry: record both")
    if session.blank:
        raise CohelmError(
            f"{path}: not one of its {len(session.stamps)} scans has a return in it, so there is "
            "nothing to map: check the LiDAR, or --robot for its range"
        )
    session.save(folder)  # closing loops takes a while, too
    _shown(session, folder)
    again = recorded if localise else None
    return _finished(session, folder, progress, start, recorded.left_out, again)


def marked(
    folder: Path, out: Path, resolution: float | None, progress: Progress, *,
    remove_loops: Sequence[int], marks: Sequence[Mark], undo: bool,
) -> MapResult:  # fmt: skip
    """Draw an earlier mapping's folder again, with further corrections.

    remove_loops: numbers in its loops.csv. undo: take back the last mark first. Raises CohelmError
    where there is no such loop, mark or mapping, or another mapping in `out`.
    """
    start = time.perf_counter()
    if out.resolve() != folder.resolve():
        _check_unmapped(out, "choose another folder with --out")
    session = MappingSession.read(folder)
    session.resolution = resolution or session.resolution
    if undo:
        if not session.marks:
            raise CohelmError(f"{folder}: nothing is marked in this mapping, so nothing to undo")
        session.marks.pop()
    if remove_loops:
        progress("finding the loops", 0.1)
        found = encounters(_marked(session)[0].finished())
        for number in remove_loops:
            if not 1 <= number <= len(found):
                raise CohelmError(
                    f"{folder}: there is no loop {number}: it has {len(found)}, see its loops.csv"
                )
            pairs = [[float(a), float(b)] for a, b in found[number - 1]]
            session.marks.append(Mark("remove-loop", pairs))
    session.marks += marks
    return _finished(session, out, progress, start)


def _check_unmapped(folder: Path, mend: str) -> None:
    check_free(folder, (NAME, "map.yaml", "map.pgm"), "a mapping", mend)


def _go_on(session: MappingSession, recorded: RecordedDrive, path: Path) -> None:
    """The same drive where it was interrupted, or another from where the last one ended."""
    if recorded.lidar != session.lidar:
        raise CohelmError(f"{path}: is of another LiDAR than the mapping: map it by itself")
    if any(abs(s.stamp + s.duration - session.last) < _SAME for s in recorded.scans):
        session.whole = True  # as the record is now
    else:
        session.survey.set_down()
        session.last = -math.inf


def _marked(session: MappingSession) -> tuple[Mapper, NDArray[np.bool_]]:
    """The survey with the corrections, and which of its scans are not drawn. The session's own is
    left as it is, so that it can go on, and marks be taken back."""
    survey = Mapper.restored(session.lidar.lidar(), session.survey.state())
    for mark in session.marks:
        if mark.kind == "remove-loop":
            survey.keep_apart([(int(a), int(b)) for a, b in mark.values])
    out = session.cut()
    if out.all():
        raise CohelmError("all of the drive is cut, so nothing is left to draw: --undo one mark")
    if out.any():
        survey.leave_out(np.flatnonzero(out).tolist())
    return survey, out


def _finished(
    session: MappingSession, folder: Path, progress: Progress, start: float, left_out: str = "",
    again: RecordedDrive | None = None,
) -> MapResult:  # fmt: skip
    """left_out: of the record, as in `RecordedDrive`. again: a drive to localize on the map."""
    survey, out = _marked(session)
    try:
        made = survey.finished(lambda share: progress("closing loops", 0.6 + 0.3 * share))
        progress("drawing", 0.9)
        drawn = _drawn(session, made, out)
        result = outcome(session, made, drawn, time.perf_counter() - start, left_out)
        session.save(folder)
        write(folder, session, made, drawn, result)
        if again is not None:
            trajectory = np.column_stack((session.stamps, np.array(made.poses)))
            localized = localized_drive(
                again.lidar, again.odometry, again.scans, occupancy(drawn).known(), trajectory,
                lambda what, share: progress(what, 0.9 + 0.1 * share),
            )  # fmt: skip
            result = replace(result, localized=localized)
            write_result(folder, result)
    except KeyboardInterrupt as stop:
        raise Interrupted from stop
    return result


def _live_drive(path: Path, robot: RobotModel | None) -> RecordedDrive:
    """What is there of a record that is being written, as soon as something is."""
    end = time.monotonic() + _ENDED
    while True:
        try:
            return drive(path, robot)
        except CohelmError:
            if time.monotonic() > end:
                raise
        time.sleep(_LOOK_AGAIN)


def _new(recorded: RecordedDrive, session: MappingSession, live: bool) -> list[DeskewedScan]:
    later = [s for s in recorded.scans if s.stamp + s.duration > session.last + _SAME]
    if session.stamps and not later:
        return []
    try:
        return mapping_scans(recorded.lidar.lidar(), recorded.odometry, later)
    except CohelmError:
        if session.stamps or live:
            return []
        raise


def _shown(session: MappingSession, folder: Path) -> float:
    """Draw map.png as the drive is placed by now; returns when to draw it next [s]."""
    start = time.monotonic()
    made = session.survey.so_far()
    show(folder, made, _drawn(session, made, session.cut()))
    end = time.monotonic()
    return end + max(_SHOWN, (end - start) / _DRAWING)


def _drawn(session: MappingSession, made: MappingResult, out: NDArray[np.bool_]) -> Raster:
    mount = session.lidar.lidar().mount
    reach = min(_NO_RETURN * session.lidar.range_max_m, _FARTHEST)
    poses: list[Pose] = []
    ends: list[Floats] = []
    for k, seen in session.points.items():
        if not out[k]:
            points = seen.astype(np.float64)
            near = np.hypot(points[:, 0] - mount.x, points[:, 1] - mount.y) < reach
            poses.append(made.poses[k])
            ends.append(points[near])
    drawn = raster(poses, ends, mount, session.resolution)
    for mark in session.marks:
        if mark.kind == "crop":
            x1, y1, x2, y2 = mark.values[0]
            drawn = cropped(drawn, (min(x1, x2), min(y1, y2)), (max(x1, x2), max(y1, y2)))
    return drawn
