"""Detects that the robot was moved: its scan contradicts those from just before, on any map.

The odometry knows the way from a place a moment ago, the *keyframe*. What stands now where the
keyframe saw free ground, and what stood there and can be looked through now, contradicts it. A
map with errors does not: it is not asked.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between, compose
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import beam_at
from cohelm.robot.sensors import Lidar

_NEAR = 0.15  # what is nearer to each other than this is the same [m]
_TURNED = 0.01  # and the odometry's error in heading, seen from afar [rad]
_BESIDE, _APART = 2, 0.05  # so many beams to either side, or so wide, count as well [m]
_MOST = 12  # beams, however near
_RUN, _NARROW = 3, 0.06  # fewer neighbouring beams, or less wide, are an edge, not a thing [m]
_EDGE, _THING, _WIDE = -0.1, -1.5, -0.02  # log likelihoods, as of a map's errors


class Keyframe(NamedTuple):
    """odometry: pose of the body then. ranges: (n,) of its deskewed scan [m]."""

    odometry: Pose
    ranges: Floats


@jit
def agreement(lidar: Lidar, before: Floats, now: Floats, step: Pose) -> float:
    """Log likelihood of a scan `now`, whose body is at `step` seen from that of `before`."""
    mount = lidar.mount
    a = compose(step, mount)
    ahead = between(mount, a)
    back = between(a, mount)
    return _appeared(lidar, now, before, ahead) + _appeared(lidar, before, now, back)


@jit
def _appeared(lidar: Lidar, seen: Floats, free: Floats, step: Pose) -> float:
    """Things of a scan, whose sensor is at `step` from that of `free`, that stand where the latter
    saw nothing."""
    c, s = math.cos(step.psi), math.sin(step.psi)
    n = len(seen)
    log, run, wide = 0.0, 0, 0.0
    for i in range(n):
        r = seen[i]
        if not 0.0 < r < math.inf:
            continue
        px, py = r * lidar.beams[i, 0], r * lidar.beams[i, 1]
        x, y = step.x + c * px - s * py, step.y + s * px + c * py
        d = math.hypot(x, y)
        beam = beam_at(lidar, x, y)
        beside = min(_BESIDE + int(_APART / (max(d, 0.1) * lidar.step)), _MOST)
        if not beside <= beam < n - beside:
            continue
        least = math.inf
        first, last = n, -1
        for b in range(beam - beside, beam + beside + 1):
            if not math.isnan(free[b]):
                first, last = min(first, b), b
                least = min(least, free[b])
        # on either side: a wall along which the last beam looks goes on where none told
        told = first < beam < last
        new = told and d < 0.9 * lidar.range_max and least > d + _NEAR + _TURNED * d
        if new:
            run += 1
            wide += r * lidar.step
        else:
            log += _cost(run, wide)
            run, wide = 0, 0.0
    return log + _cost(run, wide)


@jit
def _cost(run: int, wide: float) -> float:
    if run == 0:
        return 0.0
    return _EDGE if run < _RUN or wide < _NARROW else _THING + _WIDE * run


def usable(lidar: Lidar, ranges: Floats) -> bool:
    """Whether a scan tells enough to be a keyframe."""
    return int(np.count_nonzero(np.isfinite(ranges))) >= 0.1 * len(lidar.beams)
