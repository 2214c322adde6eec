"""Rolls out the tracking law along a path that begins beside the robot."""

from __future__ import annotations

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose, Twist
from cohelm.law.govern import CourseClock, govern, governed
from cohelm.law.guard.bounds import WHEEL_ROWS, wheel_rows
from cohelm.law.guard.project import project
from cohelm.law.track import track
from cohelm.pilot.step import Settings
from cohelm.plan.course import Course
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc

_DT = 0.05  # of the rollout [s]
_SPACING = 0.05  # between the poses returned [m, rad]
_SLOWEST = 0.1  # bounds the number of steps [m/s]


@jit
def roll_out(
    course: Course, clock: CourseClock, pose: Pose, twist: Twist, far: float, s: Settings
) -> Floats:
    """Poses of a robot that follows a path without obstacles, (n, 3) [m, rad].

    On its way back onto a path, a robot cuts corners or swings out, so the path's own clearance is
    not enough. clock: of the path, now. far: length of the rollout [m]. The first pose is about
    5 cm from here.
    """
    steps = int(far / _SLOWEST / _DT)
    poses, bounds = np.empty((steps, 3)), np.empty((WHEEL_ROWS, 4))
    n, way, since = 0, 0.0, 0.0
    for _ in range(steps):
        if way > far or clock.tau >= course.reference.knots[-1]:
            break
        clock = govern(clock, pose, course.reference, course.paced, False, s.pace, _DT)
        nominal = track(pose, governed(course.reference, clock, pose, s.pace), s.gains)
        last = wheel_rows(bounds, twist, s.limits, _DT)
        nearest = project(nominal, bounds, last, s.rules.steer_weight)  # as the guard does
        twist = achievable(nearest.twist, twist, s.limits, _DT)
        pose = arc(pose, twist, _DT)
        way += abs(twist.v) * _DT
        since += (abs(twist.v) + abs(twist.omega)) * _DT
        if since >= _SPACING:
            poses[n, 0], poses[n, 1], poses[n, 2] = pose.x, pose.y, pose.psi
            n, since = n + 1, 0.0
    return poses[:n]
