"""Recorded sticks: a CSV file, plain or gzip, into times and deflections.

Three layouts, told apart by their header:

- own:    t, x, psi            deflections in [-1, 1]; also t, fore_aft, left_right
- runs:   run, t, joy_v, joy_w evenly sampled log of several runs, one pair of columns per source
- events: run, source, t, v, w unevenly timed log, as the messages were received

The two logs are those of the joystick experiments of behavior-circuits/input_mixing_example.
There the stick's full deflection is written as 1.0 fore-aft and 1.3 left-right (the driver's
scales of linear and angular velocity; every run's record is flat there), left positive. In runs
without an assistant the stick went straight to the robot, and its record is `cmd` / `cmd_vel`.

Times may start below 0 and be uneven; they never run backwards. A deflection holds until the
next event.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.files import read_bytes
from cohelm.core.types import Floats, StickRecording

_TIME = ("t", "t_s", "time", "time_s")
_FORE_AFT = ("x", "fore_aft", "stick_x")
_LEFT_RIGHT = ("psi", "left_right", "stick_psi")
_HANDS = ("joy", "joy_cmd", "cmd", "cmd_vel")  # the person's own hand, in order of preference
_LOG_SCALE = (1.0, 1.3)
_LARGEST = 500_000_000  # bytes, unpacked
_ROUNDING = 1e-9  # a deflection this little beyond 1 is cut in silence: v / full_scale rounds


class _Row(NamedTuple):
    line: int
    cells: dict[str, str]


def read(
    path: str | Path, run: str | None = None, source: str | None = None,
    full_scale: tuple[float, float] | None = None, clip: bool = False,
) -> StickRecording:  # fmt: skip
    """The stick recorded in a file.

    path: the file, or `file#run`, or `file#run:source`. run, source: which of several, as the
    file writes them. full_scale: what the file writes for full deflection [fore-aft,
    left-right]. clip: cut deflections beyond it instead of refusing them. Raises CohelmError
    with file, line, column and value for anything that is not a stick in order.
    """
    file, run, source = _chosen(path, run, source)
    header, rows = _table(file)
    rows = _of_run(file, header, rows, run)
    time = _column(file, header, _TIME)
    if "source" in header:
        source, rows = _of_source(file, rows, source)
        columns = (_column(file, header, ("v",)), _column(file, header, ("w",)))
        scale = _log_scale(source)
    elif any(name.endswith("_v") for name in header) and "psi" not in header:
        source, rows = _of_pair(file, header, rows, source)
        columns = (f"{source}_v", f"{source}_w")
        scale = _log_scale(source)
    else:
        columns = (_column(file, header, _FORE_AFT), _column(file, header, _LEFT_RIGHT))
        scale = (1.0, 1.0)
    scale = full_scale or scale
    times = _numbers(file, rows, time, 1.0)
    back = np.flatnonzero(np.diff(times) < 0.0)
    if back.size:
        i = int(back[0]) + 1
        raise CohelmError(
            f"{file}:{rows[i].line}: {time}: {times[i]:g} s comes after {times[i - 1]:g} s; "
            "sort the rows by time"
        )
    deflections = [
        _deflections(file, rows, column, full, clip)
        for column, full in zip(columns, scale, strict=True)
    ]
    return StickRecording(times, *deflections)


def runs(path: str | Path) -> list[str]:
    """The runs of a file, as it calls them, in its order; none where it holds a single one.

    Raises CohelmError where it is no stick file.
    """
    header, rows = _table(Path(path))
    if "run" not in header:
        return []
    return list(dict.fromkeys(row.cells["run"].strip() for row in rows))


def file_of(path: str | Path) -> Path:
    """The file that `path`, `path#run` or `path#run:source` is in."""
    return _chosen(path, None, None)[0]


def _log_scale(source: str) -> tuple[float, float]:
    """Full deflection of a log's source; what is not a hand's own record is already in [-1, 1]."""
    return _LOG_SCALE if source in _HANDS else (1.0, 1.0)


def _chosen(
    path: str | Path, run: str | None, source: str | None
) -> tuple[Path, str | None, str | None]:
    """The file, run and source that `path#run:source` names."""
    name, mark, choice = str(path).rpartition("#")
    if not mark or Path(path).exists():
        return Path(path), run, source
    inline_run, _, inline_source = choice.partition(":")
    return Path(name), inline_run or run, inline_source or source


def _table(file: Path) -> tuple[list[str], list[_Row]]:
    """Header and rows of a CSV file; blank lines and lines that start with # are skipped."""
    lines = _text(file).splitlines()
    kept = [(i, s) for i, s in enumerate(lines, 1) if s.strip() and not s.lstrip().startswith("#")]
    if not kept:
        raise CohelmError(f"{file}: the stick file is empty; it needs a header t,x,psi and rows")
    try:
        parsed = list(csv.reader(io.StringIO("\n".join(text for _, text in kept))))
    except csv.Error as error:
        raise CohelmError(f"{file}: {error}; a stick file holds numbers only") from error
    if len(parsed) != len(kept):
        raise CohelmError(f"{file}: a quoted cell spans lines; a stick file holds numbers only")
    header = [name.strip().lower() for name in parsed[0]]
    rows: list[_Row] = []
    for (line, _), cells in zip(kept[1:], parsed[1:], strict=True):
        if len(cells) != len(header):
            raise CohelmError(
                f"{file}:{line}: {len(cells)} cells, but the header has {len(header)} "
                f"({', '.join(header)})"
            )
        rows.append(_Row(line, dict(zip(header, cells, strict=True))))
    if not rows:
        raise CohelmError(f"{file}: the stick file has a header but no rows")
    return header, rows


def _text(file: Path) -> str:
    if not file.exists():
        beside = [f.name for f in file.parent.glob("*.csv*")] if file.parent.is_dir() else []
        raise CohelmError(f"{file}: no such stick file{did_you_mean(file.name, beside)}")
    if file.is_dir():
        raise CohelmError(f"{file}: is a folder, not a stick file")
    try:
        return read_bytes(file, _LARGEST, "a stick file", unpack=True).decode("utf-8-sig")
    except OSError as error:
        raise CohelmError(f"{file}: the stick file can not be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CohelmError(f"{file}: not a text file, so not a CSV stick file") from error


def _column(file: Path, header: list[str], names: tuple[str, ...]) -> str:
    for name in names:
        if name in header:
            return name
    other = f" (or {', '.join(names[1:])})" if names[1:] else ""
    raise CohelmError(f"{file}: no column {names[0]}{other}; found: {', '.join(header)}")


def _of_run(file: Path, header: list[str], rows: list[_Row], run: str | None) -> list[_Row]:
    if "run" not in header:
        if run is not None:
            raise CohelmError(f"{file}: holds a single run, so run {run!r} can not be chosen")
        return rows
    runs = list(dict.fromkeys(row.cells["run"].strip() for row in rows))
    if run is None and len(runs) == 1:
        return rows
    if run not in runs:
        what = "which run?" if run is None else f"no run {run!r};"
        raise CohelmError(
            f"{file}: {what} it holds {', '.join(runs)}; choose with {file.name}#{runs[0]}"
        )
    return [row for row in rows if row.cells["run"].strip() == run]


def _of_source(file: Path, rows: list[_Row], source: str | None) -> tuple[str, list[_Row]]:
    """The rows of one source of an event log, by default the person's own hand."""
    found = list(dict.fromkeys(row.cells["source"].strip() for row in rows))
    if source is None:
        source = next((hand for hand in _HANDS if hand in found), None)
    if source not in found:
        what = "which source?" if source is None else f"no source {source!r};"
        raise CohelmError(f"{file}: {what} there are {', '.join(found)}")
    return source, [row for row in rows if row.cells["source"].strip() == source]


def _of_pair(
    file: Path, header: list[str], rows: list[_Row], source: str | None
) -> tuple[str, list[_Row]]:
    """The rows of one pair of columns `source_v`, `source_w` of a run log that are filled in."""
    found = [name[:-2] for name in header if name.endswith("_v") and f"{name[:-2]}_w" in header]
    if not found:
        raise CohelmError(
            f"{file}: no pair of columns such as joy_v and joy_w; found: {', '.join(header)}"
        )
    filled = [name for name in found if any(row.cells[f"{name}_v"].strip() for row in rows)]
    if source is None:
        source = next((hand for hand in _HANDS if hand in filled), None)
    if source not in filled:
        what = "which source?" if source is None else f"no source {source!r} in this run;"
        raise CohelmError(f"{file}: {what} there are {', '.join(filled) or 'none'}")
    return source, [row for row in rows if row.cells[f"{source}_v"].strip()]


def _numbers(file: Path, rows: list[_Row], column: str, full: float) -> Floats:
    """A column as numbers, in parts of `full`."""
    values = np.empty(len(rows))
    for i, row in enumerate(rows):
        cell = row.cells[column].strip()
        try:
            values[i] = float(cell)
        except ValueError:
            values[i] = math.nan
        if not math.isfinite(values[i]):
            what = repr(cell) if cell else "nothing"
            raise CohelmError(f"{file}:{row.line}: {column}: must be a finite number, got {what}")
    return values / full


def _deflections(file: Path, rows: list[_Row], column: str, full: float, clip: bool) -> Floats:
    values = _numbers(file, rows, column, full)
    beyond = np.flatnonzero(np.abs(values) > 1.0 + _ROUNDING)
    if beyond.size and not clip:
        i = int(beyond[0])
        others = f" (and {beyond.size - 1} more rows)" if beyond.size > 1 else ""
        raise CohelmError(
            f"{file}:{rows[i].line}: {column}: deflection {values[i]:g} is beyond -1 ... 1{others}"
            "; give full_scale, or clip: true to cut it"
        )
    return np.clip(values, -1.0, 1.0)
