"""Short drives with the pilot: the loop of a real robot in a few lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cohelm.core.types import CENTRED, Pose, Stick, Twist, disc
from cohelm.law.gains import Gains
from cohelm.law.guard.rules import Rules
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.replanning import ReplanParams
from cohelm.pilot.step import Settings
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.scenario.load import robot
from cohelm.sim.world import outline_clearance

SALLY = robot("sally")
DT = 0.02
GAINS = Gains(k_x=0.9, k_psi=2.0)
SETTINGS = Settings(SALLY.outline, SALLY.bounds(), GAINS, Rules(dt=DT))


class Drive(NamedTuple):
    """What happened, a row per step."""

    poses: np.ndarray
    decisions: list
    twists: np.ndarray
    clearances: np.ndarray
    arrived: bool


def drive(
    waypoints,
    discs=(),
    walls=(),
    *,
    seconds=40.0,
    hand=None,
    delay=0.0,
    start=None,
    speed=0.5,
    settings=SETTINGS,
    max_acceleration=0.5,
    replan_params: ReplanParams | None = None,
) -> Drive:
    """Until arrival or for `seconds`. discs: rows of `disc`, those with a velocity drift."""
    pilot = Pilot(through(waypoints, speed), settings, delay=delay, replan_params=replan_params)
    rows = np.array([disc(*d) for d in discs]).reshape(-1, 6)
    walls = np.array(walls, dtype=float).reshape(-1, 4)
    moving = np.hypot(rows[:, 2], rows[:, 3]) > 0.0
    pose, twist = Pose(*(start or (*waypoints[0], 0.0))), Twist(0.0, 0.0)
    under_way = [Twist(0.0, 0.0)] * round(delay / DT)
    poses, decisions, twists, clearances = [], [], [], []
    for k in range(round(seconds / DT)):
        now = rows.copy()
        now[:, :2] += k * DT * rows[:, 2:4]
        seen = surroundings(now, max_acceleration * moving, walls)
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, seen), pose, twist)
        stick = hand(k * DT, pose) if hand else None
        decision = pilot.step(k * DT, pose, twist, Stick(*stick) if stick else CENTRED, seen)
        under_way.append(decision.safe)
        twist = achievable(under_way.pop(0), twist, settings.limits, DT)
        poses.append(pose)
        decisions.append(decision)
        twists.append(twist)
        clearances.append(outline_clearance(pose, settings.outline, 0.5, now, walls, 1e9))
        pose = arc(pose, twist, DT)
        if pilot.arrived:
            break
    return Drive(np.array(poses), decisions, np.array(twists), np.array(clearances), pilot.arrived)
