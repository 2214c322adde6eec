"""A stick in an attacker's hand against the guard, on the twin and by its sensors alone.

As `sim.duel`, but the filter knows what odometry and LiDAR tell, and commands take their time.
Attacker and walkers know everything. Until the first scan is there, nothing is let through.
"""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.trace import ROW, Trace
from cohelm.core.types import SAFE, Pose, Stick, Twist, X, Y
from cohelm.law.guard.step import Rules, guard
from cohelm.perceive.seen import Perception
from cohelm.pilot.careful import SLOP, careful, noise
from cohelm.pilot.foresee import foreseen, moved_on, periods, stopping
from cohelm.pilot.told import told
from cohelm.sim.duel import Attack, deflection, note
from cohelm.sim.setup import Setup
from cohelm.sim.twin.drive import between, held
from cohelm.sim.twin.movers import Hunters
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import lag

_HERE = Pose(0.0, 0.0, 0.0)


def duel(setup: Setup, attack: Attack, hunters: Hunters, rules: Rules) -> Trace:
    """The whole drive; the setup has a twin whose robot has a LiDAR.

    rules: of the guard, on a robot that does exactly what it is told.
    """
    given, dt = setup.twin, setup.dt
    if given is None:
        raise CohelmError("this setup has no twin: there is nothing to drive")
    robot = Twin(
        given.robot, setup.start, setup.around, seed=setup.seed, settings=given.physics,
        camera="none", timeout=max(0.5, 3.0 * dt), hunters=hunters,
    )  # fmt: skip
    perception = Perception(robot.model)
    limits, rules = (
        held(robot.model.bounds(), given.physics),
        careful(rules, SLOP + noise(robot.model)),
    )
    delay = lag(given.robot, given.physics, dt)
    whole, rest = periods(delay, dt)
    sent = np.zeros((whole, 2))
    n, m = setup.steps, len(setup.around.discs)
    rows, h, discs = np.zeros(n, dtype=ROW), np.empty((n, m)), np.empty((n, m, 6))
    truth, stick = robot.truth(), Stick(0.0, 0.0)
    for k in range(n):
        pose, discs[k] = truth.pose, robot.things()
        stick = deflection(attack, stick, k, dt, pose, discs[k], setup.around.walls)
        wish = Twist(stick.x * limits.speed, stick.psi * limits.yaw_rate)
        seen = perception.take(k * dt, robot.read())
        asked = wish if math.isfinite(seen.scan_stamp) else Twist(0.0, 0.0)
        then, before = foreseen(seen.odometry, seen.twist, rest, sent, k, limits, dt)
        things = moved_on(told(seen, _HERE), delay, stopping(before, limits, dt))
        passed = guard(then, before, asked, things, setup.outline, limits, rules)
        command = Twist(passed.v, passed.omega)
        if whole > 0:
            sent[k % whole] = command
        robot.send(command)
        robot.wait((k + 1) * dt)
        after = robot.truth()
        applied = between(truth, after, dt)
        note(rows[k], k * dt, pose, stick, wish, command, applied, passed.verdict, passed.culprit)
        rows[k]["clearance"], rows[k]["gap"] = truth.clearance, passed.gap
        h[k] = (
            (pose.x - discs[k, :, X]) ** 2 + (pose.y - discs[k, :, Y]) ** 2 - discs[k, :, SAFE] ** 2
        )
        rows[k]["h"] = h[k].min(initial=math.inf)
        truth = after
    return Trace(rows, h, discs, setup.names, dt)
