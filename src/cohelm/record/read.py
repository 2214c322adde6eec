"""Reads a record back: a run exactly as it was, and any record as arrays by name."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Attachment, Header, Metadata
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.files import as_path
from cohelm.core.row import blank
from cohelm.core.trace import Trace
from cohelm.core.types import Floats
from cohelm.record import period
from cohelm.record.file import METADATA, RECORD, SCENARIO, STOPPED
from cohelm.record.messages import Decoder, records
from cohelm.record.topics import scan_topic

Handle = Callable[[str, float, Any], None]


def _ignore(_topic: str, _t: float, _message: Any) -> None:
    pass


class IncompleteRecord(UserWarning):
    """The file ends too early, or is damaged: only the periods before are there."""


class Record(NamedTuple):
    """What stands in a record.

        >>> import cohelm
        >>> record = cohelm.read_record("drive.mcap")  # doctest: +SKIP
        >>> pandas.DataFrame(record.table).plot("t", ["safe_v", "safe_omega"])  # doctest: +SKIP

    `read_record` makes it.
    """

    kind: str
    """run: by `cohelm run`. drive: by `cohelm robot` or from the screen."""
    table: dict[str, NDArray[Any]]
    """Every number of every control period (`core.row.FIELDS`), by name, (n,); `t` is in seconds.
    SI units and radians; NaN, or -1 of a number that counts or names: not known."""
    scans: list[tuple[float, Floats]]
    """Of a drive: when a scan began [s], on the clock of `t`, and its ranges [m]."""
    events: list[tuple[float, str]]
    """Of a drive: when [s], and what the loop and the gate did."""
    scenario: str
    """The YAML text it was made by; empty if there was none."""
    further_scans: dict[str, list[tuple[float, Floats]]]
    """The scans of further LiDARs, by their names."""
    damage: str = ""
    """Why the record is not whole: then only what came before is here. Empty if it is."""

    def __repr__(self) -> str:
        """What there is of each, not all of it."""
        rows = len(self.table["t"])
        return (
            f"Record(kind={self.kind!r}, table: {len(self.table)} columns of {rows}, "
            f"{len(self.scans)} scans, {len(self.events)} events)"
        )


@dataclass
class RecordedPeriods:
    """The control periods of a record, and its metadata."""

    about: dict[str, str]
    scenario: str = ""
    periods: list[object] = field(default_factory=list[object])
    """Messages of `/period`."""
    rows: NDArray[np.void] = field(default_factory=lambda: blank(0))
    """... and as rows of `core.row.ROW`."""
    damage: str = ""
    """Empty if it is whole."""

    @property
    def kind(self) -> str:
        """run or drive."""
        return self.about.get("kind", "")

    @property
    def epoch(self) -> int:
        """Time stamp of t = 0 [ns]."""
        return int(self.about["epoch_ns"])


def read_record(path: str | Path) -> Record:
    """Read a record: a file, or a run's folder. One that was cut short, or is damaged, is read up
    to there, with an `IncompleteRecord` warning and the reason in `damage`.

        >>> import cohelm
        >>> record = cohelm.read_record("drive.mcap")  # doctest: +SKIP
        >>> record.kind, record.table["t"][-1], record.events  # doctest: +SKIP

    Raises CohelmError for a file that is no record of cohelm.
    """
    scans: list[tuple[float, Floats]] = []
    further: dict[str, list[tuple[float, Floats]]] = {}
    events: list[tuple[float, str]] = []
    prefix = scan_topic("")

    def handle(topic: str, t: float, m: Any) -> None:
        if topic == "/rosout":
            events.append((t, f"{m.name}: {m.msg}"))
            return
        name = topic.removeprefix(prefix)
        of = scans if topic == "/scan" else further.setdefault(name, [])
        of.append((t, np.asarray(m.ranges, dtype=np.float64)))

    file = as_path(path, "a record's file or folder")
    file = file / RECORD if file.is_dir() else file
    found = periods(file, ("/scan", prefix + "*", "/rosout"), handle)
    names = found.rows.dtype.names or ()
    table = {name: np.ascontiguousarray(found.rows[name]) for name in names}
    return Record(found.kind, table, scans, events, found.scenario, further, found.damage)


def read(path: Path) -> Trace:
    """The run in a file that `Recorder` wrote, equal to the last bit.

    From a file that was not finished, or is damaged, the steps up to there, with an
    `IncompleteRecord` warning.

    Raises CohelmError where there is no such file, or no run of cohelm in it.
    """
    found = periods(path)
    if found.kind != "run":
        raise CohelmError(
            f"{path} is the record of a drive, which has no scores: look at it with `cohelm "
            f"station --replay {path}`, or give one that `cohelm run` wrote"
        )
    try:
        names, dt = tuple(json.loads(found.about["obstacles"])), float(found.about["dt"])
        h, discs = period.obstacles(found.periods, len(names))
    except (KeyError, TypeError, ValueError) as error:
        raise CohelmError(
            f"{path}: its description of the run is damaged ({error}): run it again"
        ) from error
    return Trace(found.rows, h, discs, names, dt, found.scenario)


def periods(path: Path, topics: Sequence[str] = (), handle: Handle = _ignore) -> RecordedPeriods:
    """All control periods up to the end of the data, or to where it is damaged. handle: called
    with topic, time on the clock of the periods' `t` [s] and message for all on `topics`, in order;
    a `*` in a topic stands for anything. An `IncompleteRecord` warning says where it is damaged.

    Raises CohelmError if there is no such file, it is no record of cohelm or one by another
    version, or has no period.
    """
    found, library, damage = RecordedPeriods({}), "", list[str]()
    decoder = Decoder(path, lambda topic: bool(found.about) and _wanted(topic, topics))
    for record in records(path, damage.append):
        match record:
            case Header():
                library = record.library
            case Metadata(name=name) if name == METADATA:
                found.about = record.metadata
                _check(path, found.about)
            case Metadata(name=name) if name == STOPPED:
                damage.append(f"the run was stopped by {record.metadata.get('by')}")
            case Attachment(name=name) if name == SCENARIO:
                found.scenario = record.data.decode(errors="replace")
            case _ if (came := decoder.take(record)) is not None:
                topic, message = came
                if topic != period.TOPIC:
                    handle(topic, 1e-9 * (record.log_time - found.epoch), message)
                elif record.sequence == len(found.periods):
                    found.periods.append(message)
                else:
                    damage.append(f"period {len(found.periods)} is missing")
                    break
            case _:
                pass
    found.damage = damage[0] if damage else ""
    if not found.about and not library.startswith("cohelm"):
        by = f" (it was written by {library})" if library else ""
        raise CohelmError(
            f"{path} is no record of cohelm{by}: give a file that `cohelm run` or `cohelm robot` "
            "wrote"
        )
    if not found.periods:
        raise CohelmError(f"{path} ends before its first control period: make it again")
    try:
        found.rows = period.rows(found.periods)
    except AttributeError as error:
        raise CohelmError(
            f"{path} was written by cohelm {found.about['version']}, which did not record "
            f"{error.name!r} yet: read it with that version"
        ) from error
    if found.damage:
        t = float(found.rows["t"][-1])
        warnings.warn(
            f"{path} is not whole ({found.damage}); it is read up to t = {t:.2f} s",
            IncompleteRecord,
            stacklevel=3,
        )
    return found


def _wanted(topic: str, topics: Sequence[str]) -> bool:
    return topic == period.TOPIC or any(fnmatchcase(topic, one) for one in topics)


def _check(path: Path, about: dict[str, str]) -> None:
    """Raises CohelmError where a record that says this of itself can not be understood here."""
    version, written = about.get("version", "?"), about.get("period_version")
    if written != str(period.VERSION):
        raise CohelmError(
            f"{path} was written by cohelm {version} in another form of {period.TOPIC} "
            f"({written or 'an older one'}, here {period.VERSION}): read it with that version"
        )
    if "version" not in about or not about.get("epoch_ns", "").lstrip("-").isdigit():
        raise CohelmError(f"{path}: its description is damaged: make it again")
