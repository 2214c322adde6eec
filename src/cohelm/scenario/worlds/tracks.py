"""Recorded pedestrians (t, id, x, y) as discs that walk through a world."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.law.reference import Reference
from cohelm.scenario.worlds.file import contents
from cohelm.sim.world import Body

ELSEWHERE = 1e6
"""Where a pedestrian is before the first and after the last sample, x and y [m]: out of reach of
robot and sensor, at rest, and still a number."""

_COLUMNS = ("t", "id", "x", "y")
_LARGEST = 1e12  # time or coordinate: what is larger is of another unit
_AT_ONCE = 1e-6  # two samples as near to each other are of one time [s]


@dataclass(frozen=True)
class Track:
    """One person, from the first to the last sample."""

    name: str
    times: Floats
    """(m,), increasing [s]."""
    points: Floats
    """(m, 2), world frame [m]."""

    def path(self) -> Reference:
        """Straight from sample to sample, at constant speed in between; ELSEWHERE around them.

        Times run from one second before the first sample, where the first knot is 0.
        """
        if len(self.times) < 2:
            raise CohelmError(f"person {self.name} was seen only once and has no path; leave out")
        knots = np.concatenate(([self.times[0] - 1.0], self.times, [self.times[-1] + 1.0]))
        coeffs = np.zeros((len(knots) - 1, 8))
        coeffs[:, [3, 7]] = ELSEWHERE
        coeffs[1:-1, [3, 7]] = self.points[:-1]
        coeffs[1:-1, [2, 6]] = np.diff(self.points, axis=0) / np.diff(self.times)[:, None]
        length = np.hypot(*np.diff(self.points, axis=0).T).sum()
        mean = float(length / (self.times[-1] - self.times[0]))
        return Reference(knots - knots[0], coeffs, mean)


def read_tracks(path: Path | str) -> list[Track]:
    """Pedestrians from a CSV file with the columns t [s], id, x and y [m], in any order, rows too.

    In order of their first sample. Raises CohelmError where a column is missing, a value is not a
    finite number, or a pedestrian is at two places at once.
    """
    try:
        text = contents(path, "a CSV file of tracks").decode("utf-8-sig")
        table = csv.DictReader(io.StringIO(text), strict=True)
        header = [name.strip() for name in table.fieldnames or ()]
        table.fieldnames = header
        missing = [name for name in _COLUMNS if name not in header]
        if missing:
            raise CohelmError(
                f"{path}: has no column {', '.join(missing)}; the first line must name t,id,x,y"
            )
        samples: dict[str, list[tuple[float, float, float]]] = {}
        for row in table:
            name = (row["id"] or "").strip()
            where = f"{path}: line {table.line_num}"
            if not name:
                raise CohelmError(f"{where}: id is empty")
            t, x, y = (_number(row[key], f"{where}: {key}") for key in ("t", "x", "y"))
            samples.setdefault(name, []).append((t, x, y))
    except (UnicodeDecodeError, csv.Error) as error:
        raise CohelmError(f"{path}: is not a CSV text file ({error})") from error
    tracks: list[Track] = []
    for name, rows in samples.items():
        values = np.array(sorted(rows))
        twice = np.flatnonzero(np.diff(values[:, 0]) <= _AT_ONCE)
        if twice.size:
            raise CohelmError(
                f"{path}: person {name} is there twice at t = {values[twice[0], 0]:g} s; remove one"
            )
        tracks.append(Track(name, values[:, 0].copy(), values[:, 1:].copy()))
    return sorted(tracks, key=lambda track: float(track.times[0]))


def _number(text: str | None, what: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CohelmError(f"{what} must be a finite number, got {text!r}")
    if abs(value) > _LARGEST:
        raise CohelmError(f"{what} must be in seconds or metres, got {text!r}")
    return value


def bodies(
    tracks: Iterable[Track], radius: float, reach: float, begin: float, duration: float
) -> tuple[tuple[str, ...], list[Body]]:
    """Names and bodies of all that are there between `begin` and `begin + duration` [s].

    radius: of a pedestrian; reach: kept from the robot's centre to their surface, for the paper's
    r_i (19) [m]. Time 0 of the bodies is `begin`. Those seen only once are left out.
    """
    present = [
        track for track in tracks
        if len(track.times) > 1 and track.times[-1] >= begin and track.times[0] <= begin + duration
    ]  # fmt: skip
    row = (ELSEWHERE, ELSEWHERE, 0.0, 0.0, radius, radius + reach)
    made = [Body(row, track.path(), float(track.times[0]) - 1.0 - begin) for track in present]
    return tuple(track.name for track in present), made
