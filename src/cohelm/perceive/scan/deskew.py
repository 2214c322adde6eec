"""A scan deskewed to the time of its last beam, and what it saw free."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.frames import between, compose
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.odometry_buffer import pose_at
from cohelm.robot.sensors import Lidar


class DeskewedScan(NamedTuple):
    """One sweep of a LiDAR, at the time of its last beam.

    points: (m, 2) in the body frame of that time [m], in the order of the beams; only real
    returns. beams: (m,) which beam each came from. ranges: (n,) what the sensor would have
    measured with all beams at that time: inf and -inf as in the scan, NaN where the robot's
    turning left no beam. duration: of the sweep [s]; a mover is where it was at its own beam's
    time. pose, sensor: of the body and of the LiDAR then, in `odom`. stamp: that time [s].
    """

    points: Floats
    beams: Ints
    ranges: Floats
    duration: float
    pose: Pose
    sensor: Pose
    stamp: float
    lidar: Lidar

    def part(self, which: NDArray[np.bool_], ranges: Floats) -> DeskewedScan:
        """The same with these of its points only, and with these ranges."""
        return self._replace(points=self.points[which], beams=self.beams[which], ranges=ranges)


_ORIGIN = Pose(0.0, 0.0, 0.0)
NO_SWEEP = DeskewedScan(
    np.empty((0, 2)), np.empty(0, np.int64), np.empty(0), 0.0, _ORIGIN, _ORIGIN, -math.inf,
    Lidar(_ORIGIN, 0.0, 1.0, 0.0, 0.0, 0.0, -math.inf, np.empty((0, 2))),
)  # fmt: skip
"""Without any beam."""


FREE = 0.15
"""Space is free up to so far before a beam's end [m]."""


@jit_inline
def beam_at(lidar: Lidar, x: float, y: float) -> int:
    """The beam nearest in direction to a point of the sensor's frame; a number out of range where
    there is none. Each beam covers half a step to either side."""
    bearing = math.atan2(y, x) - lidar.first
    if bearing < -0.5 * lidar.step:
        bearing += 2.0 * math.pi
    return math.floor(bearing / lidar.step + 0.5)


@jit_inline
def all_round(lidar: Lidar) -> bool:
    """Whether the field of view is 360 degrees: its last beam and its first are neighbours."""
    return lidar.step * len(lidar.beams) > 2.0 * math.pi - 1.5 * lidar.step


@jit_inline
def in_sensor_frame(sensor: Pose, x: float, y: float) -> tuple[float, float]:
    """An `odom` point in the frame of a sensor at this pose."""
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    wx, wy = x - sensor.x, y - sensor.y
    return c * wx + s * wy, -s * wx + c * wy


@jit_inline
def in_view(lidar: Lidar, sensor: Pose, x: float, y: float) -> bool:
    """Whether a beam points at an `odom` point, occluded or not."""
    sx, sy = in_sensor_frame(sensor, x, y)
    return 0 <= beam_at(lidar, sx, sy) < len(lidar.beams)


@jit_inline
def within_view(lidar: Lidar, sensor: Pose, x: float, y: float) -> float:
    """Distance of an `odom` point from the edge of a LiDAR's view; 0 outside of it [m]."""
    if all_round(lidar):
        return math.inf
    if not in_view(lidar, sensor, x, y):
        return 0.0
    sx, sy = in_sensor_frame(sensor, x, y)
    bearing = math.atan2(sy, sx)
    if bearing < lidar.first - 0.5 * lidar.step:
        bearing += 2.0 * math.pi
    last = lidar.first + (len(lidar.beams) - 1) * lidar.step
    edge = min(bearing - lidar.first, last - bearing)
    return math.hypot(sx, sy) * math.sin(min(max(edge, 0.0), 0.5 * math.pi))


@jit
def was_free(sweep: DeskewedScan, x: float, y: float, beside: float) -> bool:
    """Whether a sweep saw past an `odom` point, and past `beside` [m] on either side of it, at
    least by a beam."""
    sx, sy = in_sensor_frame(sweep.sensor, x, y)
    far = math.hypot(sx, sy)
    beam = beam_at(sweep.lidar, sx, sy)
    aside = max(1, math.ceil(beside / (max(far, 0.1) * sweep.lidar.step)))
    if not aside <= beam < len(sweep.ranges) - aside or far > sweep.lidar.range_max - FREE:
        return False
    return sweep.ranges[beam - aside : beam + aside + 1].min() > far + FREE


@jit
def deskew(
    lidar: Lidar, ranges: Floats, stamp: float, duration: float, buffer: Floats
) -> DeskewedScan:
    """Motion compensation: beam i was measured at stamp + duration i / (n - 1) [s].

    The robot's motion is that of the odometry buffer. Ranges below the minimum (-inf) give no
    points, but stay in `ranges`.
    """
    n = len(ranges)
    mount = lidar.mount
    end = pose_at(buffer, stamp + duration)
    still = duration <= 0.0 or n < 2
    points, beams = np.empty((n, 2)), np.empty(n, np.int64)
    made = np.full(n, math.nan)
    mc, ms = math.cos(mount.psi), math.sin(mount.psi)
    m = 0
    for i in range(n):
        r = ranges[i]
        if math.isnan(r):
            continue
        far = r == math.inf
        near = r == -math.inf
        reach = lidar.range_max if far else (lidar.range_min if near else r)
        sx, sy = reach * lidar.beams[i, 0], reach * lidar.beams[i, 1]
        bx, by = mount.x + mc * sx - ms * sy, mount.y + ms * sx + mc * sy
        beam, seen = i, r
        if not still:
            then = pose_at(buffer, stamp + duration * i / (n - 1))
            moved = between(end, then)
            c, s = math.cos(moved.psi), math.sin(moved.psi)
            bx, by = moved.x + c * bx - s * by, moved.y + s * bx + c * by
            dx, dy = bx - mount.x, by - mount.y
            sx, sy = mc * dx + ms * dy, -ms * dx + mc * dy
            beam = beam_at(lidar, sx, sy)
            if not (far or near):
                seen = math.hypot(sx, sy)
        if 0 <= beam < n and not made[beam] < seen:
            made[beam] = seen
        if not (far or near):
            points[m, 0], points[m, 1] = bx, by
            beams[m] = i
            m += 1
    return DeskewedScan(
        points[:m].copy(), beams[:m].copy(), made, duration, end, compose(end, mount),
        stamp + duration, lidar,
    )  # fmt: skip
