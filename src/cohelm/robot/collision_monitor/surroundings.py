"""Returns in a fixed frame: those of the newest scan, and remembered ones out of its view."""

from __future__ import annotations

import math
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.robot.collision_monitor.odometry import PoseHistory, placed, seen_from
from cohelm.robot.collision_monitor.returns import SURE, Returns, Sensor
from cohelm.robot.port import Scan

REMEMBERED = 60.0
"""Time for which a return out of view counts as an obstacle [s]; then it is unknown, and the robot
crawls. The filter remembers it without limit, so this forbids nothing that the filter allows."""
BESIDE = 3.0
"""Distance from the outline within which it is remembered [m]: 3 s of backing at full speed."""
GRAIN = 0.02
"""Grid on which remembered returns are merged [m]."""

ENDS = 0.1
"""A beam that ends no farther than this behind a remembered return sees it anew [m]."""

LEVEL = 0.01
"""Largest difference of heights of sensors in one plane [m]: the height of a beam's spot."""


class MonitorSurroundings(NamedTuple):
    """Returns as points of a frame, with their errors."""

    points: Floats
    """(n, 2) [m]"""
    errors: Floats
    """Standard deviation of each, (n,) [m]; -inf where it is unknown whether there is anything: it
    stops nothing, but is not driven into faster than at a crawl."""
    margins: Floats
    """By how much the obstacle may be nearer, (n,) [m]."""
    seen: Floats
    """Time of each, (n,) [s]."""


NOTHING = MonitorSurroundings(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))


class ScanWithPoses(NamedTuple):
    """A scan, and the poses at which it was taken."""

    sensor: Sensor
    scan: Scan
    first: Pose
    """Of the robot at its first beam, in the odometry's frame..."""
    last: Pose
    """... and at its last."""


def of_scan(found: Returns, scan: Scan, poses: PoseHistory) -> MonitorSurroundings:
    """A scan's returns in the frame of the poses, each seen from where the robot was then."""
    stamps = scan.stamp + scan.duration * found.passed
    if not len(stamps):
        return NOTHING
    points = placed(found.points, *poses.during(stamps))
    return MonitorSurroundings(points, found.errors, found.margins, stamps)


def joined(new: MonitorSurroundings, old: MonitorSurroundings) -> MonitorSurroundings:
    """The returns of both."""
    if not len(old.points):
        return new
    return MonitorSurroundings(*(np.concatenate(both) for both in zip(new, old, strict=True)))


def all_of(parts: list[MonitorSurroundings]) -> MonitorSurroundings:
    """The returns of several LiDARs."""
    return reduce(joined, parts)


def seen_by(obstacles: MonitorSurroundings, pose: Pose, within: float) -> MonitorSurroundings:
    """In the body frame at a pose, returns within a distance of its origin, less margins [m]."""
    return seen_by_both(obstacles, pose, NOTHING, pose, within)


@jit
def seen_by_both(
    obstacles: MonitorSurroundings,
    pose: Pose,
    others: MonitorSurroundings,
    other_pose: Pose,
    within: float,
) -> MonitorSurroundings:
    """The same, and of others in the frame of another pose."""
    n, k = len(obstacles.points) + len(others.points), 0
    points, errors, margins, seen = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n)
    for of, at in ((obstacles, pose), (others, other_pose)):
        c, s = math.cos(at.psi), math.sin(at.psi)
        for i in range(len(of.points)):
            x, y, margin = of.points[i, 0] - at.x, of.points[i, 1] - at.y, of.margins[i]
            if x * x + y * y <= (within + margin) ** 2:
                points[k, 0], points[k, 1] = c * x + s * y, c * y - s * x
                errors[k], margins[k], seen[k] = of.errors[i], margin, of.seen[i]
                k += 1
    return MonitorSurroundings(points[:k], errors[:k], margins[:k], seen[:k])


def all_round(sensor: Sensor) -> bool:
    """Whether obstacles can leave its view only by distance."""
    return sensor.bearings[-1] - sensor.bearings[0] + 1.5 * sensor.step > 2.0 * math.pi


def out_of_sight(
    old: MonitorSurroundings, now: float, first: Pose, last: Pose, sensor: Sensor, reach: float,
    ranges: Floats | None = None,
) -> MonitorSurroundings:  # fmt: skip
    """Old returns that a scan could not see and that still count: beyond the end of the view, or so
    near that beams may pass above, unless they end there or before.

    ranges: of the scan; without them nothing is too near. first, last: poses of the robot at its
    first beam and at its last. A beam looks half a step to either side: what stands at the end of
    the view of a standing robot is in view, and a mover that leaves it there leaves no return.
    """
    low = sensor.whole_from > 0.0 and ranges is not None
    if (all_round(sensor) and not low) or not len(old.points):
        return NOTHING
    middle = 0.5 * (sensor.bearings[0] + sensor.bearings[-1])
    half = 0.5 * (sensor.bearings[-1] - sensor.bearings[0] + sensor.step)
    begin, (end, dist) = (_polar(old.points, pose, sensor, middle) for pose in (first, last))
    right = begin[0] < 0.0
    unseen = (right & (begin[0] < -half)) | (~right & (np.abs(end) > half))
    if all_round(sensor):
        unseen[:] = False
    if ranges is not None and low:
        beams = np.clip(np.rint((end + half) / sensor.step - 0.5), 0, len(ranges) - 1)
        unseen |= (dist < sensor.whole_from) & ~(ranges[beams.astype(np.intp)] < dist + ENDS)
    hidden = np.flatnonzero(unseen)
    here = seen_from(old.points[hidden], last)
    near = here[:, 0] ** 2 + here[:, 1] ** 2 < (reach + BESIDE) ** 2
    kept = hidden[near]
    grains = np.round(old.points[kept] / GRAIN).astype(np.int64)
    _, one = np.unique((grains[:, 0] << 32) + grains[:, 1], return_index=True)
    left = MonitorSurroundings(*(column[kept[one]] for column in old))
    left.errors[now - left.seen >= REMEMBERED] = -math.inf
    return left


def looked_past(old: MonitorSurroundings, look: ScanWithPoses) -> NDArray[np.bool_]:
    """Which old returns a scan clears, (n,): all beams that would meet its obstacle, anywhere
    within its margin, go past it, and do so since it was seen.

    The margin includes returns merged into this one. The beams are those from the robot's pose at
    the first beam, at the last, and everywhere between. Obstacles that may be between two beams, or
    at the end of the view or of the range, stay.
    """
    sensor, ranges = look.sensor, look.scan.ranges
    points, _, margins, seen = old
    half = 0.5 * (sensor.bearings[-1] - sensor.bearings[0])
    middle = sensor.bearings[0] + half
    wide = margins + math.sqrt(2.0) * GRAIN
    ends = [_polar(points, pose, sensor, middle) for pose in (look.first, look.last)]
    bearings, distances = (np.stack(both) for both in zip(*ends, strict=True))
    nearest, farthest = distances.min(axis=0), distances.max(axis=0)
    around = np.arcsin(np.minimum(wide / np.maximum(nearest, 1e-9), 1.0))
    right, left = bearings.min(axis=0) - around, bearings.max(axis=0) + around
    beyond = farthest + wide + SURE * sensor.noise
    can = (
        (right >= -half) & (left <= half) & (nearest > wide) & (beyond < sensor.range_max)
        & (farthest * sensor.step <= wide) & (seen < look.scan.stamp)
    )  # fmt: skip
    past = np.zeros(len(points), dtype=np.bool_)
    which = np.flatnonzero(can)
    begin = np.floor((right[which] + half) / sensor.step).astype(np.intp)
    end = np.ceil((left[which] + half) / sensor.step).astype(np.intp)
    between = np.column_stack((begin, np.minimum(end, len(ranges) - 1) + 1)).ravel()
    shortest = np.minimum.reduceat(np.append(ranges, math.inf), between)[::2]
    past[which] = shortest > beyond[which]  # not for NaN
    return past


def _polar(points: Floats, pose: Pose, sensor: Sensor, middle: float) -> tuple[Floats, Floats]:
    """Points in polar coordinates of the sensor of a robot at a pose: bearings from the middle of
    its view, (n,) [rad], and distances, (n,) [m]."""
    there = seen_from(seen_from(points, pose), sensor.mount._replace(psi=sensor.mount.psi + middle))
    return np.arctan2(there[:, 1], there[:, 0]), np.hypot(there[:, 0], there[:, 1])
