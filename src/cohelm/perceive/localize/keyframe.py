"""Detects that the robot was moved, without a map: its scan contradicts a keyframe.

The *keyframe* is a deskewed scan from a moment ago, at a known odometry step. A return where it saw
free space, and a beam that passes where it had a return, contradict it.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.frames import between, compose
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import DeskewedScan, beam_at
from cohelm.robot.sensors import Lidar

_NEAR = 0.15  # tolerance of a range [m]
_TURNED = 0.01  # and of the odometry's heading [rad]
_BESIDE, _APART = 2, 0.05  # beams to either side that are checked too, or width [m]
_MOST = 12  # beams at most
_RUN, _NARROW = 3, 0.06  # fewer beams, or a smaller width, are an edge, not an object [m]
_EDGE, _THING, _WIDE = -0.1, -1.5, -0.02  # log likelihoods: an edge, an object, each of its beams


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
    """Log likelihood of the returns of a scan, whose sensor is at `step` from that of `free`, where
    the latter saw free space."""
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
        # on both sides: a wall along the last beam continues beyond the view
        bracketed = first < beam < last
        new = bracketed and d < 0.9 * lidar.range_max and least > d + _NEAR + _TURNED * d
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


def usable(sweep: DeskewedScan) -> bool:
    """Whether a scan has enough returns to be a keyframe."""
    return int(np.count_nonzero(np.isfinite(sweep.ranges))) >= 0.1 * len(sweep.ranges)
