"""Reads a record, of a run or of a drive, into arrays by name: for pandas, or plain numpy."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.period import PERIOD
from cohelm.core.types import Floats
from cohelm.record.messages import attachment, messages
from cohelm.record.read import IncompleteRecord, read
from cohelm.record.write import METADATA


class Record(NamedTuple):
    """What stands in a record.

    >>> import cohelm
    >>> record = cohelm.read_record("drive.mcap")                  # doctest: +SKIP
    >>> pandas.DataFrame(record.table).plot("t", ["safe_v", "safe_omega"])   # doctest: +SKIP
    """

    kind: str
    """run: by `cohelm run`. drive: by `cohelm robot` or from the screen."""
    table: dict[str, NDArray[Any]]
    """Every number of every control step (`core.trace.ROW`) or period (`core.period.PERIOD`), by
    name, (n,); `t` is in seconds. SI units and radians."""
    scans: list[tuple[float, Floats]]
    """Of a drive: when a scan began [s], on the clock of `t`, and its ranges [m]."""
    events: list[tuple[float, str]]
    """Of a drive: when [s], and what the loop and the gate did."""
    scenario: str
    """The YAML text it was made by; empty if there was none."""


def read_record(path: str | Path) -> Record:
    """What stands in a record. One that was cut short is read up to there.

    Raises CohelmError for a file that is no record of cohelm.
    """
    file = Path(path)
    rows = [_row(m) for _, _, m in messages(file, ("/period",))]
    if not rows:
        return _run(file)
    table = np.array(rows, dtype=PERIOD)
    begun = next(stamp for _, stamp, _ in messages(file, ("/period",)))
    zero = begun - round(float(table["t"][0]) * 1e9)
    scans: list[tuple[float, Floats]] = []
    events: list[tuple[float, str]] = []
    for topic, stamp, m in messages(file, ("/scan", "/rosout")):
        t = (stamp - zero) * 1e-9
        if topic == "/scan":
            scans.append((t, np.asarray(m.ranges, dtype=np.float64)))
        else:
            events.append((t, f"{m.name}: {m.msg}"))
    said = attachment(file, "scenario.yaml")
    return Record("drive", _columns(table), scans, events, said.decode() if said else "")


def _run(file: Path) -> Record:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteRecord)
        try:
            trace = read(file)
        except CohelmError as error:
            if METADATA in str(error):
                raise
            raise CohelmError(
                f"{file} holds neither a run nor a drive of cohelm: give a record that "
                f"`cohelm run` or `cohelm robot` wrote ({error})"
            ) from error
    return Record("run", _columns(trace.rows), [], [], trace.scenario)


def _row(message: Any) -> tuple[Any, ...]:
    return tuple(getattr(message, name.lower()) for name in PERIOD.names or ())


def _columns(rows: NDArray[np.void]) -> dict[str, NDArray[Any]]:
    return {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
