"""A campaign's folder: its plan, and its rows in parts that are whole or not there.

    campaign.json           the plan; another plan is refused
    rows/part-000001.parquet, ...   rows as they came, at most a second apart
    report.html, summary.json       made at the end, and again where rows are newer

A part is written to a temporary file, flushed to the disk and then moved to its place, so that
neither kill -9 nor a full disk leaves half of one. An episode that was driven but not yet written
is driven again, with the same result.
"""

from __future__ import annotations

import fcntl
import importlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self, get_type_hints

from cohelm.core.errors import CohelmError
from cohelm.core.files import json_text, make_folder, whole
from cohelm.study.campaign.result import EpisodeResult

pa: Any = importlib.import_module("pyarrow")  # neither has types
pq: Any = importlib.import_module("pyarrow.parquet")

PLAN, ROWS = "campaign.json", "rows"
_LOCK = ".lock"

_VERSIONS = {
    "code": "this code", "own": "your law", "data_digest": "the data in --data",
}  # fmt: skip
"""Digests in a plan, and what they are of."""

_LABELS = ("version", "commit", "began")
"""For a reader alone: it is the digests that tell whether rows belong together."""

Key = tuple[str, int]
"""Of a row: law and episode."""

_TYPES: dict[Any, Any] = {
    str: pa.string(),
    int: pa.int64(),
    bool: pa.bool_(),
    float: pa.float64(),
    list[float]: pa.list_(pa.float64()),
}
SCHEMA = pa.schema([(name, _TYPES[kind]) for name, kind in get_type_hints(EpisodeResult).items()])
"""The columns of `EpisodeResult`, in order."""


class Store:
    """An open folder: `with Store(folder, plan) as s:`. One process at a time.

    `rows` are those that are there already. Raises CohelmError where the folder belongs to
    another campaign, or to a process that is still at it, or can not be written.
    """

    def __init__(self, folder: Path, plan: dict[str, Any]) -> None:
        self.folder = folder
        self._plan = plan
        self.rows: dict[Key, EpisodeResult] = {}
        self._part = 0

    def __enter__(self) -> Self:
        make_folder(self.folder / ROWS)
        try:
            self._lock = (self.folder / _LOCK).open("w")
        except OSError as error:
            raise _unwritten(self.folder, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise CohelmError(
                f"{self.folder}: another campaign is at work in this folder; wait for it, or "
                "choose another with --out"
            ) from error
        try:
            self._open()
        except BaseException:
            self._lock.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def _open(self) -> None:
        there = read_plan(self.folder)
        if there is None:
            if any((self.folder / ROWS).glob("*.parquet")):
                raise CohelmError(
                    f"{self.folder}: holds rows but no {PLAN}, so their plan is unknown; choose "
                    "another folder with --out"
                )
            put(self.folder / PLAN, json_text(self._plan).encode())
        elif names := _differing(there, self._plan):
            raise CohelmError(f"{self.folder}: {_difference(names, there, self._plan)}")
        for leftover in (self.folder / ROWS).glob("*.part"):
            leftover.unlink()
        self.rows = read_rows(self.folder)
        numbers = (part.stem[5:] for part in (self.folder / ROWS).glob("part-*.parquet"))
        self._part = max((int(one) for one in numbers if one.isdecimal()), default=0)

    def add(self, rows: Iterable[EpisodeResult]) -> None:
        """Write rows, those that are new; when this returns they are on the disk."""
        new = {key: row for row in rows if (key := (row.law, row.episode)) not in self.rows}
        if not new:
            return
        columns = list(zip(*new.values(), strict=True))
        table = pa.table(dict(zip(EpisodeResult._fields, columns, strict=True)), schema=SCHEMA)
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        self._part += 1
        put(self.folder / ROWS / f"part-{self._part:06d}.parquet", sink.getvalue().to_pybytes())
        self.rows.update(new)


def read_plan(folder: Path) -> dict[str, Any] | None:
    """The plan of the campaign in a folder; None if there is none.

    Raises CohelmError where the file is there but can not be used.
    """
    path = folder / PLAN
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except NotADirectoryError as error:
        raise CohelmError(f"{folder}: is a file, not a campaign's folder") from error
    except (OSError, ValueError, RecursionError) as error:
        raise CohelmError(f"{path}: is not a campaign's plan ({error}); choose another") from error
    if not isinstance(plan, dict):
        raise CohelmError(f"{path}: is not a campaign's plan; choose another folder")
    return plan  # pyright: ignore[reportUnknownVariableType]


def origin(folder: Path) -> dict[str, Any]:
    """By which code the campaign in a folder is driven, and since when; empty: it does not say."""
    kept, names = read_plan(folder) or {}, (*_LABELS, "code", "own")
    return {name: kept[name] for name in names} if kept.keys() >= set(names) else {}


def read_rows(folder: Path) -> dict[Key, EpisodeResult]:
    """All rows of a campaign's folder, each once; of a row that is there twice the first.

    Raises CohelmError where a part is damaged or of another version.
    """
    rows: dict[Key, EpisodeResult] = {}
    for part in sorted((folder / ROWS).glob("part-*.parquet")):
        try:
            table = pq.read_table(part)
            columns = [column.to_pylist() for column in table.columns]
        except (OSError, ValueError) as error:
            raise CohelmError(
                f"{part}: is not a whole Parquet file ({str(error).splitlines()[0]}); remove it, "
                "and its episodes are driven again"
            ) from error
        if table.schema.names != list(EpisodeResult._fields):
            raise CohelmError(
                f"{part}: has other columns than this version's; choose another --out"
            )
        for values in zip(*columns, strict=True):
            row = EpisodeResult(*values)
            rows.setdefault((row.law, row.episode), row)
    return rows


def _differing(there: dict[str, Any], requested: dict[str, Any]) -> list[str]:
    both = {**there, **requested}
    return [key for key in both if key not in _LABELS and there.get(key) != requested.get(key)]


def _difference(names: list[str], there: dict[str, Any], requested: dict[str, Any]) -> str:
    """How two plans differ, as one sentence."""
    if set(names) <= _VERSIONS.keys():
        return (
            f"was driven with another version of {_VERSIONS[names[0]]}, whose rows do not belong "
            "with new ones; choose another folder with --out"
        )
    differences = ", ".join(
        f"{name} {_brief(there.get(name))} (requested: {_brief(requested.get(name))})"
        for name in names
        if name not in _VERSIONS
    )
    return f"holds another campaign, with {differences}; choose another folder with --out"


def _brief(value: object) -> str:
    if isinstance(value, dict):  # a robot
        return str(value.get("name"))  # pyright: ignore[reportUnknownArgumentType, reportUnknownMemberType]
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)  # pyright: ignore[reportUnknownArgumentType]


def put(path: Path, data: bytes) -> None:
    """Write a file that is whole or not there, and on the disk when this returns."""
    try:
        with whole(path, sync=True) as new:
            new.write_bytes(data)
    except OSError as error:
        raise _unwritten(path, error) from error


def _unwritten(path: Path, error: OSError) -> CohelmError:
    return CohelmError(
        f"{path} can not be written ({error.strerror}); what was written before is whole: free "
        "some space and give the same command again, or choose another folder with --out"
    )
