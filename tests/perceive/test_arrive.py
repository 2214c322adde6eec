"""The whole chain on what a LiDAR sees: remember, find a way, govern, track, guard."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist, disc, discs
from cohelm.law.gains import Gains
from cohelm.law.govern import CourseClock, PaceParams, govern, governed, profile
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.law.track import track
from cohelm.perceive.space.scan_memory import KEEP, renew
from cohelm.plan.path_planner import plan_path
from cohelm.plan.recovery import RecoveryMove, RecoveryParams, recovery_move, recovery_twist, rest
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.kinematics import arc
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.load import robot
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan
from tests.law.guard.scenes import guard_step
from tests.perceive.scenes import NOTHING, line

DT = 0.02
ROBOT = robot("jackal")
LIDAR = LidarModel(noise_m=0.01, mount_x_m=0.12).lidar()
PACE = PaceParams()
GAINS = Gains(k_x=1.0, k_psi=4.0)
CRUISE = 1.0
NO_MOVE = RecoveryMove(0.0, 0.0, 0.0)


def fence(ax, ay, bx, by):
    """A row of posts without gaps between them."""
    n = int(math.hypot(bx - ax, by - ay) / 0.1) + 1
    return [
        disc(x, y, 0.06)
        for x, y in zip(np.linspace(ax, bx, n), np.linspace(ay, by, n), strict=True)
    ]


def drive(pose, world, goal_line, seconds, seen=NOTHING):
    """Where the robot ended, and its least gap to the truth; a new way every 0.4 s."""
    points, twist, clock = seen, Twist(0.0, 0.0), CourseClock()
    ranges = np.empty(len(LIDAR.beams))
    outline, limits = ROBOT.outline, ROBOT.bounds()
    reference = paced = None
    left, before, least = NO_MOVE, NO_MOVE, math.inf
    for k in range(round(seconds / DT)):
        if k % 2 == 0:
            scan(pose, LIDAR, world, np.empty((0, 4)), NO_GRID, 3, k, ranges)
            points = renew(points, pose, LIDAR, ranges, KEEP)
        if k % 20 == 0:
            left = NO_MOVE if left == before else left  # held up
            before = left
        if k % 20 == 0 and left == NO_MOVE:
            here = int(np.argmin(np.hypot(*(goal_line - pose[:2]).T)))
            found = plan_path(pose, points, goal_line, outline, here=here)
            if found is not None and len(found.points) > 2:
                reference = through(found.points, CRUISE)
                paced = profile(reference, np.full(200, math.inf), PACE)
                clock = CourseClock(0.0, min(max(twist.v / CRUISE, 0.0), 1.0))
                x, y = found.points[2] - pose[:2]
                heading = math.atan2(y, x)
                if abs(math.remainder(heading - pose.psi, 2.0 * math.pi)) > 1.2:
                    left = recovery_move(pose, heading, points, outline, RecoveryParams()) or left
        if left != NO_MOVE:
            wanted = recovery_twist(left, 0.4, 1.5, DT)
        elif reference is None:
            wanted = Twist(0.0, 0.0)
        else:
            clock = govern(clock, pose, reference, paced, False, PACE, DT)
            wanted = track(pose, governed(reference, clock, pose, PACE), GAINS)
        passed = guard_step(
            pose, twist, wanted, surroundings(points=points), outline, limits, Rules()
        )
        twist = passed.twist
        if left != NO_MOVE:
            left = rest(left, twist, DT)
            left = left if left.distance or left.turn else NO_MOVE
        pose = arc(pose, twist, DT)
        for row in world:
            least = min(least, disc_clearance(pose, outline, row[0], row[1], row[4]))
        if math.hypot(pose.x - goal_line[-1, 0], pose.y - goal_line[-1, 1]) < 0.2:
            break
    return pose, least


def distance_left(pose, goal_line):
    return math.hypot(pose.x - goal_line[-1, 0], pose.y - goal_line[-1, 1])


def test_the_robot_goes_around_a_fence_across_its_reference():
    ahead = line(0, 0, 5, 0)
    world = discs(*fence(2.5, -1.0, 2.5, 1.5))
    pose, least = drive(Pose(0.0, 0.0, 0.0), world, ahead, 30.0)
    assert distance_left(pose, ahead) < 0.2
    assert least > 0.0


def test_the_robot_leaves_a_dead_end_that_the_reference_leads_into():
    ahead = line(0, 0, 6, 0)
    world = discs(
        *fence(1.0, 0.8, 3.5, 0.8), *fence(1.0, -0.8, 3.5, -0.8), *fence(3.5, -0.8, 3.5, 0.8)
    )
    pose, least = drive(Pose(2.2, 0.0, 0.0), world, ahead, 50.0)
    assert distance_left(pose, ahead) < 0.2
    assert least > 0.0


@pytest.mark.parametrize("mouth", [0.27, 0.3])
def test_the_robot_backs_out_of_a_pocket_too_narrow_to_turn_in(mouth):
    behind = line(0, 0, -4, 0)
    world = discs(
        *fence(-0.2, mouth, 0.5, mouth),
        *fence(0.55, -mouth, 0.55, mouth),
        *fence(-0.2, -mouth, 0.5, -mouth),
    )
    pose, least = drive(Pose(0.0, 0.0, 0.0), world, behind, 40.0)
    assert distance_left(pose, behind) < 0.2
    assert least > 0.0


def test_the_robot_stands_where_no_path_is_known():
    world = discs(
        *fence(-1, -1, 1, -1), *fence(-1, 1, 1, 1), *fence(-1, -1, -1, 1), *fence(1, -1, 1, 1)
    )
    pose, least = drive(Pose(0.0, 0.0, 0.0), world, line(0, 0, 5, 0), 5.0)
    assert math.hypot(pose.x, pose.y) < 1.0
    assert least > 0.0
