"""A mapping that can be continued: what `cohelm map` keeps with a map, and the user's
corrections."""

from __future__ import annotations

import json
import math
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular, whole, writing
from cohelm.perceive.map.mapper import Mapper
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import LidarModel

NAME = "survey.npz"
_FORMAT = 1
_DRAWN = 2500  # scans that go into the grid, at most

_NONE = np.empty((0, 2), np.float32)

Kind = Literal["remove-loop", "cut", "crop"]


class Mark(NamedTuple):
    """One correction. values: of *remove-loop* pairs of scans that did not meet; of *cut* one row,
    from and to which second after the first scan nothing is drawn or linked; of *crop* one row, the
    corners x, y, x, y of the part of the map that is kept [m]."""

    kind: Kind
    values: list[list[float]]


@dataclass
class MappingSession:
    """A survey before its loops are closed, so that it can be continued, and corrections undone."""

    lidar: LidarModel
    survey: Mapper
    resolution: float
    whole: bool = True
    """Whether the records were finished, and not damaged."""
    stamps: list[float] = field(default_factory=list[float])
    """Of all scans [s]."""
    last: float = -math.inf
    """Of the drive that goes on."""
    empty: int = 0
    """Scans without a single return."""
    points: dict[int, NDArray[np.float32]] = field(default_factory=dict[int, NDArray[np.float32]])
    """(m, 2), of those that are drawn [m]."""
    marks: list[Mark] = field(default_factory=list[Mark])

    def add(self, sweep: DeskewedScan) -> None:
        """The next scan."""
        self.survey.add(sweep)
        k = len(self.stamps)
        self.stamps.append(sweep.stamp)
        self.last = sweep.stamp
        self.empty += not len(sweep.points)
        if k % self._every == 0:
            self.points[k] = sweep.points.astype(np.float32)
        if k == _DRAWN * self._every:
            self.points = {i: p for i, p in self.points.items() if i % self._every == 0}

    @property
    def blank(self) -> bool:
        """Whether not one scan has a return in it."""
        return self.empty == len(self.stamps)

    @property
    def _every(self) -> int:
        """Of so many scans one is drawn: a power of two, so that a longer drive draws some of those
        that a shorter one did."""
        return 2 ** max(0, math.ceil(math.log2(max(len(self.stamps), 1) / _DRAWN)))

    @property
    def complete(self) -> bool:
        """Whether there is a scan, and none of them was left half done."""
        return 0 < len(self.stamps) == self.survey.scans

    def cut(self) -> NDArray[np.bool_]:
        """Which scans were marked to be left out."""
        since = np.array(self.stamps) - self.stamps[0]
        out = np.zeros(len(since), dtype=bool)
        for mark in self.marks:
            if mark.kind == "cut":
                out |= (since >= mark.values[0][0]) & (since <= mark.values[0][1])
        return out

    def save(self, folder: Path) -> None:
        """Into a folder, which is made; what was there is replaced once all is written. CohelmError
        where that can not be."""
        numbers = sorted(self.points)
        about = {
            "format": _FORMAT, "lidar": self.lidar.model_dump(mode="json"), "whole": self.whole,
            "resolution": self.resolution, "last": self.last, "empty": self.empty,
            "marks": [mark._asdict() for mark in self.marks],
        }  # fmt: skip
        arrays = {
            "about": np.array(json.dumps(about)), "stamps": np.array(self.stamps),
            "drawn": np.array(numbers, dtype=np.int64),
            "size": np.array([len(self.points[k]) for k in numbers], dtype=np.int64),
            "points": np.vstack([_NONE, *(self.points[k] for k in numbers)]),
            **{f"survey_{name}": values for name, values in self.survey.state().items()},
        }  # fmt: skip
        with writing(folder), whole(folder / NAME) as new, new.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

    @classmethod
    def read(cls, folder: Path) -> Self:
        """What `save` left in a folder. CohelmError where nothing did, or it is damaged."""
        path = folder / NAME
        check_regular(path)
        try:
            with path.open("rb") as stored, np.load(stored, allow_pickle=False) as file:
                arrays: dict[str, NDArray[Any]] = dict(file)
            about = json.loads(str(arrays["about"]))
            if about["format"] != _FORMAT:
                raise CohelmError(f"{path}: is of another cohelm: map the record again")
            lidar = LidarModel.model_validate(about["lidar"])
            state = {
                name.removeprefix("survey_"): values
                for name, values in arrays.items() if name.startswith("survey_")
            }  # fmt: skip
            points = np.split(arrays["points"], np.cumsum(arrays["size"])[:-1])
            return cls(
                lidar, Mapper.restored(lidar.lidar(), state), about["resolution"], about["whole"],
                arrays["stamps"].tolist(), about["last"], about["empty"],
                dict(zip(arrays["drawn"].tolist(), points, strict=True)),
                [Mark(mark["kind"], mark["values"]) for mark in about["marks"]],
            )  # fmt: skip
        except FileNotFoundError as error:
            raise CohelmError(
                f"{path.parent}: holds no {NAME}: name the folder of a mapping by `cohelm map`, or "
                "the record of a drive to map (--out is the folder that it writes into)"
            ) from error
        except (
            OSError, EOFError, ValueError, KeyError, IndexError, TypeError, zipfile.BadZipFile,
            ValidationError,
        ) as error:  # fmt: skip
            raise CohelmError(f"{path}: is damaged: map the record again") from error
