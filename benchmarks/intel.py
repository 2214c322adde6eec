"""Errors of the map of the Intel log, by the relations of its publication.

A relation names two scans of the whole log by their times. The log has one scan in fifteen, but a
line of odometry for each of them: its pose is interpolated from the scans before and after. Times
are written with six digits, later a hundredth of a second, and lines came in bunches: where several
have the time of a relation, it is unknown which is meant.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.mapper import Mapper, MappingResult
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.scenario.worlds.carmen import read_log

LOG = Path(__file__).resolve().parents[2] / "shared" / "data" / "lidar" / "intel.gfs.log"
_TURN = 0.5  # a turn makes odometry as unsure as so much way does [m/rad]


class RelationErrors(NamedTuple):
    """Error of each relation: off [m], heading [rad], (n,). alone: (n,), whether each of its times
    belongs to a single line."""

    off: Floats
    heading: Floats
    alone: NDArray[np.bool_]


class _Line(NamedTuple):
    stamp: float
    pose: Pose


def surveyed(raw: bool = False) -> MappingResult:
    """The log mapped from the poses in its scans, which are a published solution, or only from the
    raw odometry between its scans."""
    drive = read_log(LOG)
    seen = mapping_scans(drive.lidar.lidar(), drive.odometry, drive.scans)
    survey, odometry = Mapper(drive.lidar.lidar()), seen[0].pose
    for sweep, segment in zip(seen, [None, *_segments()], strict=False):
        if segment is not None:
            odometry = compose(odometry, between(segment[0].pose, segment[-1].pose))
        survey.add(sweep._replace(pose=odometry) if raw else sweep)
    return survey.finished()


def errors(poses: list[Pose]) -> RelationErrors:
    """Errors of `poses`, those of the log's scans."""
    segments = _segments()
    lines = _placed(segments, poses)
    rows = np.loadtxt(LOG.with_name("intel.relations")).tolist()
    relations = [(a, b, Pose(x, y, yaw)) for a, b, x, y, _, _, _, yaw in rows]
    times = np.unique([t for a, b, _ in relations for t in (a, b)])
    zero = _clock(times, np.array([segment[0].stamp for segment in segments]))
    stamps = np.array([line.stamp for line in lines])
    nearest = {t: stamps[np.abs(stamps - (t - zero)).argmin()] for t in times.tolist()}
    which = {t: np.flatnonzero(stamps == stamp).tolist() for t, stamp in nearest.items()}
    off, heading, alone = [], [], []
    for a, b, true in relations:
        one = between(true, between(lines[which[a][0]].pose, lines[which[b][0]].pose))
        off.append(math.hypot(one.x, one.y))
        heading.append(abs(one.psi))
        alone.append(len(which[a]) == len(which[b]) == 1)
    return RelationErrors(np.array(off), np.array(heading), np.array(alone))


def _segments() -> list[list[_Line]]:
    """Each scan with the odometry from it to the next: after a scan, the log's odometry continues
    from the pose that its author's mapping gave that scan."""
    found: list[list[_Line]] = []
    for text in LOG.read_text().splitlines():
        words = text.split()
        if words[0] == "FLASER":
            n = int(words[1])
            found.append([_Line(float(words[-1]), Pose(*map(float, words[5 + n : 8 + n])))])
        elif words[0] == "ODOM" and found and float(words[-1]) > 0.0:
            found[-1].append(_Line(float(words[-1]), Pose(*map(float, words[1:4]))))
    return found


def _placed(segments: list[list[_Line]], poses: list[Pose]) -> list[_Line]:
    """Pose of each line, interpolated from the poses of the scan before and of the one after, to
    which the last line of a segment belongs; the nearer has more weight."""
    found: list[_Line] = []
    for segment, (here, there) in zip(segments[:-1], pairwise(poses), strict=True):
        seen = [between(segment[0].pose, line.pose) for line in segment]
        steps = [between(a, b) for a, b in pairwise(seen)]
        way = np.cumsum([0.0, *(math.hypot(s.x, s.y) + _TURN * abs(s.psi) for s in steps)])
        back = compose(between(here, there), between(seen[-1], Pose(0.0, 0.0, 0.0)))
        for line, step, share in zip(segment[:-1], seen, way / max(way[-1], 1e-9), strict=False):
            off = between(step, compose(back, step))
            part = Pose(share * off.x, share * off.y, share * off.psi)
            found.append(_Line(line.stamp, compose(here, compose(step, part))))
    return [*found, _Line(segments[-1][0].stamp, poses[-1])]


def _clock(times: Floats, scans: Floats) -> float:
    """Offset of the relations' clock from the log's: for most relations a scan has that time."""
    gaps = (times[:, None] - scans).ravel()
    bins = np.round(gaps / 0.02).astype(np.int64)
    values, counts = np.unique(bins, return_counts=True)
    rough = 0.02 * float(values[counts.argmax()])
    return float(np.median(gaps[np.abs(gaps - rough) < 0.02]))
