"""Models of a Gazebo world that a plugin moves from key frame to key frame, as DynaBARN's.

The world names a compiled plugin; how it moves stands in the plugin's source, which is read here:
`PoseAnimation(name, length, repeat)`, then `CreateKeyFrame(t)` and `Translation(Vector3d(x, y, z))`
for each key frame.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.law.reference import Reference
from cohelm.scenario.worlds.file import contents

_MOST = 100_000  # pieces of a way
_FARTHEST = 1e6  # time or place of a key frame [s, m]
_AT_ONCE = 1e-9  # between two key frames [s]
_NUMBER = r"\s*([-+.\deE]+?)f?\s*"
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_PERIOD = re.compile(rf"PoseAnimation\(\s*\"[^\"]*\"\s*,{_NUMBER},\s*(true|false)\s*\)")
_FRAME = re.compile(
    rf"CreateKeyFrame\({_NUMBER}\)(?:(?!CreateKeyFrame).)*?Translation\([\w:\s]*Vector3d\({_NUMBER},{_NUMBER},",
    re.DOTALL,
)


class Animation(NamedTuple):
    """How a model moves: straight from key frame to key frame."""

    frames: Floats
    """(k, 3), times and places in the world frame [s, m, m], in the order of time."""
    length: float
    """Its period: it ends, or begins again, after so long [s]."""
    repeats: bool

    def moved(self, x: float, y: float) -> Animation:
        """Of what is fixed to the model, so far from its origin [m]."""
        return self._replace(frames=self.frames + np.array([0.0, x, y]))

    def way(self, duration: float) -> Reference:
        """For so long [s]. From the end of a period to the begin of the next one nothing is driven:
        what was at the one place is then at the other.

        Raises CohelmError where that is more pieces than can be.
        """
        times, places = self.frames[:, 0] - self.frames[0, 0], self.frames[:, 1:]
        length = max(self.length, float(times[-1]))
        if length > times[-1]:
            times, places = np.append(times, length), np.vstack((places, places[-1:]))
        if len(times) < 2:
            times, places = np.array([0.0, 1.0]), np.vstack((places, places))
            length = 1.0
        pieces = np.zeros((len(times) - 1, 8))
        pieces[:, [2, 6]] = np.diff(places, axis=0) / np.diff(times)[:, None]
        pieces[:, [3, 7]] = places[:-1]
        rounds = int(duration / length) + 1 if self.repeats else 1
        if rounds * len(pieces) > _MOST:
            raise CohelmError(
                f"what repeats every {length:g} s, in {len(pieces)} pieces, can not be followed "
                f"for {duration:g} s: at most {_MOST} pieces can be"
            )
        started = length * np.arange(rounds)[:, None]
        knots = np.append((started + times[:-1]).ravel(), rounds * length)
        return Reference(knots, np.tile(pieces, (rounds, 1)), 1.0)


def source(world: Path, plugin: str) -> Path | None:
    """The source of a compiled plugin: beside the world, or in a folder there or beside that."""
    stem = Path(plugin).stem
    names = [f"{one}{end}" for one in (stem, stem.removeprefix("lib")) for end in (".cc", ".cpp")]
    here = world.resolve().parent
    folders = [here, *_folders(here), *_folders(here.parent)]
    return next((f / name for f in folders for name in names if (f / name).is_file()), None)


def _folders(path: Path) -> list[Path]:
    try:
        return sorted(one for one in path.iterdir() if one.is_dir())
    except OSError:  # the folder may not be readable
        return []


def read_animation(path: Path) -> Animation:
    """From the source of a plugin. Raises CohelmError where it is not such a one."""
    text = _COMMENT.sub("", contents(path, "a plugin's source").decode("utf-8", "replace"))
    period, found = _PERIOD.search(text), _FRAME.findall(text)
    if period is None or not 0 < len(found) == text.count("CreateKeyFrame("):
        raise CohelmError(
            f"{path}: has no PoseAnimation with key frames in numbers, as DynaBARN's plugins have"
        )
    try:
        frames = np.array(found, dtype=np.float64)
        length = float(period[1])
    except ValueError as error:
        raise CohelmError(f"{path}: a key frame holds no number ({error})") from error
    if not (np.abs(frames) <= _FARTHEST).all() or not abs(length) <= _FARTHEST:  # nor for NaN
        raise CohelmError(f"{path}: key frames must be finite numbers, of seconds and metres")
    if not (np.diff(frames[:, 0]) > _AT_ONCE).all():
        raise CohelmError(f"{path}: the times of key frames must grow")
    return Animation(frames, length, period[2] == "true")
