"""Plays back the record of a run or a drive as the robot's messages to its stations."""

from __future__ import annotations

import bisect
import math
import tempfile
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose
from cohelm.core.types import Pose
from cohelm.drive.shown import docks_message
from cohelm.drive.station_publisher import hello
from cohelm.law import verdict as verdicts
from cohelm.link import bulk_messages as b, messages as m
from cohelm.link.recorded_status import StatusWords
from cohelm.link.scans import millimetres
from cohelm.loop.status import AHEAD, AHEAD_STEP, status
from cohelm.record import markers
from cohelm.record.read import RecordedPeriods, periods
from cohelm.record.replay import recorded_model
from cohelm.record.shown import TOPICS as SHOWN, ZONES, from_message
from cohelm.record.topics import IMAGE, scan_topic
from cohelm.robot.gate.modes import GateMode
from cohelm.scenario import load
from cohelm.scenario.model import Scenario
from cohelm.station.robot_link import News

_NAN = math.nan
_EVENT_SHOWN = 4.0  # how long an event stays on the screen [s]
_MODES = {int(GateMode.SHARED): m.Mode.SHARED, int(GateMode.AUTOMATIC): m.Mode.AUTOMATIC}
_NO_WORDS = StatusWords(0, "", m.Mode.HOLD, "", "", math.inf, "", ())
_WHY = {
    verdicts.SHAPED: "an obstacle", verdicts.POWERLESS: "the filter could not act",
    verdicts.INVALID: "a number that is not finite",
    verdicts.BRAKING: "braking: nothing else is certain",
    verdicts.STANDING: "standing: nothing else is certain",
}  # fmt: skip


class _Series:
    """Values in order of time."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.all: list[Any] = []

    def add(self, t: float, value: Any) -> None:
        """Append a value."""
        self.times.append(max(t, self.times[-1]) if self.times else t)
        self.all.append(value)

    def newest(self, t: float) -> Any:
        """The last one up to `t`, or None."""
        k = bisect.bisect_right(self.times, t)
        return self.all[k - 1] if k else None

    def between(self, since: float, t: float) -> list[Any]:
        """Those after `since`, up to `t`."""
        at = bisect.bisect_right
        return self.all[at(self.times, since) : at(self.times, t)]


class _Jpeg(NamedTuple):
    number: int
    taken: float
    at: int
    size: int


class Playback:
    """The messages of a record, by time."""

    def __init__(self, path: Path) -> None:
        """Raises CohelmError if the file holds no record."""
        self._series: dict[str, _Series] = {}
        self._pictures = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as this
        weakref.finalize(self, self._pictures.close)
        # a truncated record is shown as far as it goes
        topics = ("/scan", scan_topic("*"), "/rosout", "/scene", IMAGE, *SHOWN)
        found = periods(path, topics, self._add)
        self._simulated = found.kind == "run"
        self._rows = _filled(found.rows) if self._simulated else found.rows
        site = _site(path, found)
        model = site.robot if self._simulated and site is not None else recorded_model(path)
        if isinstance(model, str):
            raise CohelmError(f"{path}: its scenario names a robot without describing it")
        self._model, usual = model, _NAN if site is None else site.reference.speed_mps
        for topic in ZONES:
            if topic in self._series:
                series = self._series[topic]
                series.all = [one._replace(usual=usual) for one in series.all]
        camera = IMAGE in self._series
        seen = self._model if camera else self._model.model_copy(update={"camera": None})
        self._hello = hello(seen, False)
        if "/scene" in self._series:  # one for each outline
            series = self._series["/scene"]
            series.all = [self._hello._replace(outline=one) for one in series.all]
        self._docks = docks_message([] if site is None else [one.dock() for one in site.docks])
        self._lidars = [
            ("/scan" if k == 0 else scan_topic(one.name), one.lidar().mount)
            for k, one in enumerate(self._model.lidars)
        ]
        """Topic and mount of each LiDAR."""
        self._scans: dict[int, m.ScanPart] = {}
        self._picture: b.Picture | None = None
        self._times: list[float] = self._rows["t"].tolist()
        self.start = self._times[0]
        """The robot's clock at the start [s]."""
        self.duration = self._times[-1] - self.start
        """Length of the record [s]."""

    def first(self) -> list[b.FromRobot]:
        """Constant messages: the robot and its docks."""
        return [self._hello, *((self._docks,) if self._docks.all else ())]

    def at(self, t: float) -> list[News]:
        """The newest messages at time `t` [s]; the same objects until there are newer ones."""
        now = self.start + t + 1e-9
        k = max(bisect.bisect_right(self._times, now) - 1, 0)
        out = [News(self._status(k), self._times[k], 0.0)]
        for topic in ("/scene", *SHOWN):
            if topic != "/diagnostics" and (what := self._newest(topic, now)) is not None:
                out.append(News(what, now, 0.0))
        for k, (topic, mount) in enumerate(self._lidars):
            scan = self._newest(topic, now)
            if scan is not None:
                if k not in self._scans or self._scans[k].number != scan.number:
                    sensor = compose(self._pose(scan.taken), mount)
                    self._scans[k] = scan._replace(lidar=k, sensor=sensor)
                out.append(News(self._scans[k], scan.taken, now - scan.taken))
        jpeg = self._newest(IMAGE, now)
        if jpeg is not None:
            if self._picture is None or self._picture.number != jpeg.number:
                self._picture = self._seen(jpeg)
            out.append(News(self._picture, jpeg.taken, now - jpeg.taken))
        return out

    # ---- reading ------------------------------------------------------------------------

    def _add(self, topic: str, t: float, message: Any) -> None:
        series = self._series.setdefault(topic, _Series())
        count = len(series.all)
        if topic == "/scan" or topic.startswith(scan_topic("")):
            ranges = millimetres(message.ranges)
            first, step = float(message.angle_min), float(message.angle_increment)
            sensor, beams = Pose(0.0, 0.0, 0.0), len(ranges)
            series.add(t, m.ScanPart(count, 0, t, sensor, beams, 0, first, step, ranges))
        elif topic == "/rosout":
            level = m.Severity.WARNING if message.level >= 40 else m.Severity.NOTICE
            text = f"{message.name}: {message.msg}"
            series.add(t, m.Alarm(10_000 + count, level, True, True, text))
        elif topic == IMAGE:
            jpeg = bytes(message.data)
            at = self._pictures.seek(0, 2)
            self._pictures.write(jpeg)
            series.add(t, _Jpeg(count, t, at, len(jpeg)))
        elif topic == "/scene":
            if (outline := markers.outline(message)) is not None:
                series.add(t, outline.astype(np.float32))
        else:
            series.add(t, from_message(topic, message))

    # ---- messages -----------------------------------------------------------------------

    def _newest(self, topic: str, now: float) -> Any:
        series = self._series.get(topic)
        return None if series is None else series.newest(now)

    def _pose(self, t: float) -> Pose:
        row = self._rows[max(bisect.bisect_right(self._times, t) - 1, 0)]
        return Pose(float(row["x"]), float(row["y"]), float(row["psi"]))

    def _seen(self, jpeg: _Jpeg) -> b.Picture:
        self._pictures.seek(jpeg.at)
        data = self._pictures.read(jpeg.size)
        return b.Picture(jpeg.number, jpeg.taken, self._pose(jpeg.taken), data)

    def _status(self, k: int) -> m.Status:
        row, now = self._rows[k], self._times[k]
        words: StatusWords = self._newest("/diagnostics", now) or _derived_words(row)
        happened: list[m.Alarm] = []
        if "/rosout" in self._series:
            happened = self._series["/rosout"].between(now - _EVENT_SHOWN, now)
        words = words._replace(alarms=(*words.alarms, *reversed(happened))[:8])
        shown = status(row, words, "/map" in self._series, self._ahead(now))
        return shown._replace(localised=m.Localised.EXACT) if self._simulated else shown

    def _ahead(self, now: float) -> tuple[tuple[float, float], ...]:
        """The recorded poses ahead."""
        then = [now + (i + 1) * AHEAD_STEP for i in range(AHEAD)]
        return tuple(self._pose(t)[:2] for t in then if t <= self._times[-1])


def _filled(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Rows of a run with the columns it leaves out: all is exact there, and nothing acts between
    stick and wheels."""
    out = rows.copy()
    out["measured_v"], out["measured_omega"] = rows["applied_v"], rows["applied_omega"]
    out["clearance_seen"], out["progress"] = rows["clearance"], np.linspace(0.0, 1.0, len(rows))
    out["arming"], out["mode"] = m.Arming.ARMED, GateMode.SHARED
    return out


def _derived_words(row: np.void) -> StatusWords:
    """Status texts derived from the numbers of a row."""
    mode = _MODES.get(int(row["mode"]), m.Mode.HOLD)
    why = _WHY.get(int(row["verdict"]), "the wheels' limits" if row["saturated"] else "")
    return _NO_WORDS._replace(mode=mode, why=why)


def _site(path: Path, found: RecordedPeriods) -> Scenario | None:
    """The scenario in a record; None where that of a drive can not be read."""
    try:
        return load.parse(found.scenario, Scenario, str(path))
    except CohelmError as error:
        if found.kind == "run":  # its robot is described nowhere else
            raise CohelmError(f"the scenario in {path} can not be read: {error}") from error
        return None
