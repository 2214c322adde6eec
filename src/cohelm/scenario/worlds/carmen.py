"""CARMEN logs, the format of the classical LiDAR data sets: odometry and scans of a drive.

One message a line, its numbers separated by spaces. Read are `FLASER` (n, n ranges, pose of the
laser, pose of the robot, time), `RAWLASER1` and `ROBOTLASER1` (with the laser's own description),
`ODOM` (pose, speed, yaw rate, acceleration, time) and `PARAM`; all else is skipped. The last number
of a line is its time, and the word before it the host's name.
"""

from __future__ import annotations

import io
import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.ndimage import median_filter

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between
from cohelm.core.types import Floats, Pose, Twist
from cohelm.robot.port import Odometry, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.worlds.file import contents_as_far, faults

_KINDS = ("ODOM", "FLASER", "ROBOTLASER1", "RAWLASER1")
_LARGEST = 500_000_000  # bytes: an hour of 180 beams ten times a second is 70 MB
_APART = 0.95  # share of the scans that must have a time of their own: few loggers write one twice
_LATER = 0.6  # ... and that must be later than the one before: of times at random half are
_FAR = 80.0  # SICK scanners report 81.83 m or so where nothing came back [m]
_FARTHEST = 100.0  # no scanner of these logs measures farther [m]
_FEW = 10  # values that a scanner has at most for no return
_TURN = 2.0 * math.pi * 1.01  # a full turn, with the rounding of the step [rad]
_ASTRAY = 60.0  # a time farther from those of the lines around it is none [s]
_AROUND = 11  # lines
_SELDOM = 20.0  # no log has its scans so far apart, and milliseconds of 40 scans a second are [s]
_STEP = 0.1  # of the robot's way, in which its heading shows [m]
_ALONG, _ASKEW = 0.75, 0.5  # mean cosine of twice its angle to the heading: that is right; not
_FINEST = 1e-5  # between two beams [rad]
_MOST_BEAMS = 100_000


class RecordedDrive(NamedTuple):
    """What mapping needs of a record of any kind."""

    odometry: list[Odometry]
    """In the order of time."""
    scans: list[Scan]
    """Whose `number`s count from 0."""
    lidar: LidarModel
    """As the record, or the convention of its kind, describes it."""
    whole: bool = True
    """Whether the record was finished, and is not damaged."""
    left_out: str = ""
    """What of it could not be used, and how much; empty: nothing."""


class _Line(NamedTuple):
    """What one line holds; NaN or None for what it does not."""

    number: int
    """From 1 on."""
    logged: float
    """When it was written down, its last number [s]."""
    sent: float
    """When it was sent, two fields before [s]."""
    pose: Floats | None = None
    """Of the robot."""
    scan: tuple[Floats, float, float] | None = None
    """Ranges, first bearing, step."""
    laser: Floats | None = None


class _StampedScan(NamedTuple):
    stamp: float
    number: int
    """Of its line."""
    ranges: Floats
    first: float
    step: float


def read_log(path: Path | str) -> RecordedDrive:
    """A drive from a CARMEN log, plain or gzip.

    Scans of another number of beams than most, and lines that are cut short or hold no numbers,
    or have a time a minute from those around them, are left out, and so said. A log that ends in
    the middle of a line, or its archive before its end, is read as far as it goes, and not whole.
    Time is when a line was written down, or when it was sent; where neither goes on from scan to
    scan, but each scan has its pose in its line, they count as ten a second, in their order. Raises
    CohelmError where there is no such file, no scan with a pose in it, no time, or where times are
    in milliseconds or the like, ranges in millimetres or centimetres, or headings in degrees.
    """
    unpacked, whole = contents_as_far(path, "a CARMEN log", _LARGEST)
    lines: list[_Line] = []
    left_out: dict[str, list[int]] = defaultdict(list)  # numbers of lines, by what they are
    last, damaged = "", False
    text = io.TextIOWrapper(io.BytesIO(unpacked), "utf-8-sig", errors="replace")
    for number, line in enumerate(text, 1):
        words = line.split()
        if words:
            last, damaged = line, False
        try:
            found = _read(number, words) if words else None
        except (ValueError, IndexError, OverflowError):
            left_out["lines damaged or cut short"].append(number)
            damaged = True
            continue
        if found is not None:
            lines.append(found)
    scans = [one for one in lines if one.scan is not None]
    if not scans or all(one.pose is None for one in lines):
        raise CohelmError(
            f"{path}: holds no scan of a CARMEN log with its odometry (FLASER, or ROBOTLASER1, or "
            "RAWLASER1 beside ODOM): give such a log, an MCAP record or a bag"
        )
    _check_in_radians(path, np.array([one.pose[:3] for one in lines if one.pose is not None]))
    _check_in_metres(path, np.concatenate([one.scan[0] for one in scans if one.scan is not None]))
    stamps = _stamps(path, lines)
    if stamps is None:
        raise CohelmError(
            f"{path}: the times of its {len(scans)} scans do not go on from one to the next, and "
            "not every scan has its pose beside it: give a log with whole times"
        )
    odometry: dict[float, Odometry] = {}
    with_scans: dict[float, Odometry] = {}  # these are where their scans were taken
    found_scans: list[_StampedScan] = []
    mount = Pose(0.0, 0.0, 0.0)
    for one, stamp in zip(lines, stamps, strict=True):
        if not math.isfinite(stamp):
            if one.scan is not None:
                left_out["scans with a time far from those around them"].append(one.number)
            continue
        if one.pose is not None:
            # its speeds are not reliable: some drivers write 0, others deg/s
            x, y, psi = one.pose[:3].tolist()
            among = odometry if one.scan is None else with_scans
            among.setdefault(stamp, Odometry(stamp, Pose(x, y, psi), Twist(0.0, 0.0)))
        if one.scan is not None:
            if not found_scans and one.pose is not None and one.laser is not None:
                mount = _mount(one.laser, one.pose)
            found_scans.append(_StampedScan(stamp, one.number, *one.scan))
    lidar, scans = _scans(path, found_scans, mount, left_out)
    odometry |= with_scans
    told = (f"{what}: {len(at)}, the first in line {at[0]}" for what, at in left_out.items())
    return RecordedDrive(
        [odometry[t] for t in sorted(odometry)], scans, lidar,
        whole and not damaged and not _cut(last), "; ".join(told),
    )  # fmt: skip


def _cut(last: str) -> bool:
    """Whether a log ends in the middle of this line, though what there is of it can be read: in
    the name of its message, or before that of its host."""
    words = last.split()
    if last.endswith("\n") or not words:
        return False
    if len(words) == 1:
        return any(kind.startswith(words[0]) for kind in _KINDS)
    if words[0] not in _KINDS:
        return False
    try:
        float(words[-2])
    except ValueError:
        return False
    return True


def _read(number: int, words: list[str]) -> _Line | None:
    """What a line holds; None: nothing of concern. ValueError, IndexError: it is damaged."""
    kind = words[0]
    if kind not in _KINDS:
        return None
    logged = float(words[-1])
    try:
        sent = float(words[-3])
    except ValueError:
        sent = math.nan
    if kind == "ODOM":
        return _Line(number, logged, sent, _pose(_numbers(words[1:6])))
    if kind == "FLASER":
        n = _beams(words[1])
        after = _numbers(words[2 + n : 8 + n])
        scan = (_numbers(words[2 : 2 + n]), *_convention(n))
        return _Line(number, logged, sent, _pose(after[3:6]), scan, _pose(after[:3]))
    first, step, n = float(words[2]), float(words[4]), _beams(words[8])
    scan = (_numbers(words[9 : 9 + n]), first, step)
    if kind == "RAWLASER1":
        return _Line(number, logged, sent, None, scan)
    rest = words[9 + n :]
    poses = _numbers(rest[1 + int(rest[0]) :][:6])
    return _Line(number, logged, sent, _pose(poses[3:6]), scan, _pose(poses[:3]))


def _stamps(path: Path | str, lines: list[_Line]) -> list[float] | None:
    """The time of each line [s], by the clock that goes on from scan to scan; None: there is none.

    Few may be wrong: some loggers write a scan down twice. CohelmError where they are no seconds.
    """
    scans = [one for one in lines if one.scan is not None]
    for clock in ([one.logged for one in lines], [one.sent for one in lines]):
        of_scans = [t for t, one in zip(clock, lines, strict=True) if one.scan is not None]
        if _goes_on(of_scans):
            _check_in_seconds(path, np.array(of_scans))
            times = np.array(clock)
            known = np.flatnonzero(np.isfinite(times))
            usual = median_filter(times[known], _AROUND, mode="mirror")
            times[known[np.abs(times[known] - usual) > _ASTRAY]] = math.nan
            return times.tolist()
    if any(one.pose is None for one in scans):
        return None
    count = 0
    stamps: list[float] = []
    for one in lines:
        stamps.append(math.nan if one.scan is None else 0.1 * count)
        count += one.scan is not None
    return stamps


def _goes_on(times: list[float]) -> bool:
    """Whether these can be the times of scans in a row: hardly two alike, most after the last."""
    finite = np.array([t for t in times if math.isfinite(t)])
    if len(np.unique(finite)) < _APART * len(times):
        return False
    return len(times) < 2 or float(np.mean(np.diff(finite) > 0.0)) >= _LATER


def _scans(
    path: Path | str, found: list[_StampedScan], mount: Pose, left_out: dict[str, list[int]]
) -> tuple[LidarModel, list[Scan]]:
    """In the order of time, with the laser that took them."""
    beams = Counter(len(f.ranges) for f in found).most_common(1)[0][0]
    alike = sorted((f for f in found if len(f.ranges) == beams), key=lambda f: f.stamp)
    if others := [f.number for f in found if len(f.ranges) != beams]:
        left_out["scans with another number of beams than most"] = others
    (first, step), _ = Counter(f[3:] for f in alike).most_common(1)[0]
    if not (abs(first) <= 2.0 * _TURN and _FINEST <= step <= _TURN / (beams - 1)):  # nor for NaN
        raise CohelmError(
            f"{path}: its laser has {beams} beams {step:g} apart from {first:g} on, and a scan "
            "goes round once at most: give a log with its angles in radians"
        )
    scans: list[Scan] = []
    for stamp, number, ranges, *_ in alike:
        if scans and stamp <= scans[-1].stamp:
            left_out["scans with the time of another"].append(number)
            continue
        seen = np.where(np.isfinite(ranges) & (ranges < _FAR) & (ranges > 0.0), ranges, math.inf)
        scans.append(Scan(stamp, len(scans), seen, 0.0))
    middle = first + 0.5 * step * (beams - 1)
    try:
        lidar = LidarModel(
            beams=beams,
            field_of_view_deg=min(math.degrees(step) * (beams - 1), 360.0),
            range_min_m=0.02,
            range_max_m=_FAR,
            rate_hz=10.0,
            mount_x_m=mount.x,
            mount_y_m=mount.y,
            mount_yaw_deg=math.degrees(mount.psi + middle),
        )
    except ValidationError as error:
        raise faults(path, error) from error
    return lidar, scans


def _check_in_seconds(path: Path | str, times: Floats) -> None:
    """CohelmError where scans are so far apart that these are milli-, micro- or nanoseconds."""
    between_scans = np.abs(np.diff(times[np.isfinite(times)]))
    apart = float(np.median(between_scans)) if len(between_scans) else 0.0
    if apart <= _SELDOM:
        return
    unit, factor = next(
        (unit, factor)
        for unit, factor, most in (
            ("milliseconds", "1000", 2e4), ("microseconds", "1e6", 2e7),
            ("nanoseconds", "1e9", math.inf),
        )
        if apart < most
    )  # fmt: skip
    raise CohelmError(
        f"{path}: times are in seconds, got {apart:g} from one scan to the next in the median: "
        f"divide {unit} by {factor}"
    )


def _check_in_metres(path: Path | str, ranges: Floats) -> None:
    """CohelmError where most ranges are farther than a scanner sees, and not what it has for no
    return."""
    measured = ranges[np.isfinite(ranges) & (ranges > 0.0)]
    beyond = measured[measured > _FARTHEST]
    if 2 * len(beyond) > len(measured) and len(np.unique(beyond)) > _FEW:
        raise CohelmError(
            f"{path}: ranges are in metres, got {np.median(measured):g} in the median: divide "
            "centimetres by 100, millimetres by 1000"
        )


def _check_in_radians(path: Path | str, poses: Floats) -> None:
    """CohelmError where the robot drives along its headings only if they are degrees."""
    largest = float(np.abs(poses[:, 2]).max())
    if largest <= _TURN:
        return
    kept = [0]
    for k, (x, y) in enumerate(poses[:, :2]):
        if math.hypot(x - poses[kept[-1], 0], y - poses[kept[-1], 1]) >= _STEP:
            kept.append(k)
    course = np.arctan2(*np.diff(poses[kept, :2], axis=0).T[::-1])
    heading = poses[kept[1:], 2]

    def along(heading: Floats) -> float:
        """1: forwards or backwards along it; 0: any way."""
        return float(np.cos(2.0 * (course - heading)).mean())

    if len(course) and along(np.radians(heading)) > _ALONG and along(heading) < _ASKEW:
        raise CohelmError(
            f"{path}: headings are in radians, got up to {largest:g}: multiply degrees by 0.0174533"
        )


def _beams(word: str) -> int:
    n = int(word)
    if not 1 < n <= _MOST_BEAMS:
        raise ValueError("not a scan's number of beams")
    return n


def _numbers(words: Sequence[str]) -> Floats:
    return np.array([float(word) for word in words], dtype=np.float64)


def _pose(numbers: Floats) -> Floats:
    if len(numbers) < 3 or not np.isfinite(numbers).all():
        raise ValueError("not a pose")
    return numbers


def _mount(laser: Floats, robot: Floats) -> Pose:
    """The laser on the robot, from the first scan's poses of both; at most a robot's size."""
    found = between(Pose(*robot[:3].tolist()), Pose(*laser[:3].tolist()))
    return Pose(0.0, 0.0, 0.0) if math.hypot(found.x, found.y) > 2.0 else found


def _convention(n: int) -> tuple[float, float]:
    """First bearing and step of a front laser by its number of beams [rad]: half a turn, from the
    right, in steps of 1 or 0.5 degrees; with an even number the last is a step short of it."""
    if n in (180, 360):
        return -0.5 * math.pi, math.pi / n
    return -0.5 * math.pi, math.pi / (n - 1)
