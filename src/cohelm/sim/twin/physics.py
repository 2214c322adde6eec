"""Physics in compiled steps: drives, MuJoCo, movers, and what is kept of the truth.

MuJoCo's own `mj_step` is called from compiled code, so that a step costs what physics costs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose, Twist, X, Y
from cohelm.robot.achievable import achievable
from cohelm.robot.limits import Limits
from cohelm.sim.twin.engine import address, mj_step
from cohelm.sim.twin.movers import MovingDiscs, walk
from cohelm.sim.world import NOWHERE, outline_clearance

_ADDING = 2.0  # how fast the servos' integral part adds up a steady error [1/s]
_STANDS = 0.01  # slower than this, a robot whose drives rest is standing [m/s]
_DUST = 1e-4  # commands below this are rounding [m/s]

STATE = np.dtype(
    [
        ("step", "i8"),  # steps made
        ("x", "f8"), ("y", "f8"), ("psi", "f8"),  # true pose, heading not wrapped
        ("v", "f8"), ("omega", "f8"),  # true twist, body frame
        ("side", "f8"),  # true speed to the left: slip [m/s]
        ("command_v", "f8"), ("command_omega", "f8"),  # what arrived at the drives
        ("driven_v", "f8"), ("driven_omega", "f8"),  # what the drives aim at now
        ("hold_left", "f8"), ("hold_right", "f8"),  # what the servos have added up [rad/s]
        ("left", "f8"), ("right", "f8"), ("yaw", "f8"),  # since the last odometry [m, m, rad]
        ("energy", "f8"),  # put in by the drives, none given back [J]
        ("clearance", "f8"), ("since", "f8"),  # clearance when last looked, and motion since [m]
        ("least", "f8"), ("least_moving", "f8"),  # smallest clearance, and while moving [m]
        ("touched", "i8"),  # contacts begun
        ("standing", "?"),  # it came to rest and its drives rest since
        ("touching", "?"), ("force", "f8"),  # now, and the largest force so far [N]
        ("tilt", "f8"),  # of the body's axis from the vertical [rad]
    ],
    align=True,
)  # fmt: skip
"""The twin between two steps."""


class Views(NamedTuple):
    """MuJoCo's own arrays, by reference, and where its structs lie."""

    model: int
    data: int
    qpos: Floats
    qvel: Floats
    ctrl: Floats
    mocap: Floats
    sensors: Floats


def views(model: Any, data: Any) -> Views:
    """The arrays of a simulation; both arguments must outlive them."""
    return Views(
        address(model), address(data), data.qpos, data.qvel, data.ctrl,
        np.asarray(data.mocap_pos).reshape(-1, 3), data.sensordata,
    )  # fmt: skip


class PhysicsHistory(NamedTuple):
    """Where robot and movers were in the last steps; step k is in row k % len."""

    poses: Floats
    """(n, 3)"""
    places: Floats
    """(n, m, 2)"""


class WheelDrives(NamedTuple):
    """The drives as numbers."""

    radius: float
    """[m]"""
    rolling: float
    """Speed error at which the servo gives the torque that rolling takes [rad/s]."""
    gain: float
    """Of the servo [N m s]."""
    torque: float
    """Largest [N m]."""


@jit
def advance(
    last: int, deadline: int, step: float, views: Views, state: NDArray[np.void], orders: Floats,
    limits: Limits, wheels: WheelDrives, outline: Floats, reach: float, discs: Floats,
    walls: Floats, movers: MovingDiscs, trail: PhysicsHistory,
) -> None:  # fmt: skip
    """Physics up to step `last`.

    orders: (k, 3), commands (step of arrival, v, omega) in order. From `deadline` on the robot
    brakes: the last command is too old. state: (1,) of STATE, written to, as are discs, movers and
    trail.
    """
    s = state[0]
    head = 0
    while s.step < last:
        while head < len(orders) and orders[head, 0] <= s.step:
            s.command_v, s.command_omega = orders[head, 1], orders[head, 2]
            head += 1
        if s.step >= deadline:
            s.command_v, s.command_omega = 0.0, 0.0
        _drive(step, views, s, limits, wheels)
        mj_step(views.model, views.data)
        s.step += 1
        moved = _observe(step, views, s, wheels, reach)
        pose = Pose(s.x, s.y, s.psi)
        shift = walk(step, s.step * step, pose, outline, discs, walls, movers, views.mocap)
        row = s.step % len(trail.poses)
        trail.poses[row, 0], trail.poses[row, 1], trail.poses[row, 2] = s.x, s.y, s.psi
        for m in range(len(movers.which)):
            trail.places[row, m, 0] = discs[movers.which[m], X]
            trail.places[row, m, 1] = discs[movers.which[m], Y]
        _score(s, views, moved + shift, outline, reach, discs, walls)


@jit
def _drive(step: float, views: Views, s: Any, limits: Limits, wheels: WheelDrives) -> None:
    """The drives' ramp within the limits, and the servos' set points [rad/s]."""
    driven = achievable(
        Twist(s.command_v, s.command_omega), Twist(s.driven_v, s.driven_omega), limits, step
    )
    steady = driven.v == s.driven_v and driven.omega == s.driven_omega
    s.driven_v, s.driven_omega = driven.v, driven.omega
    turn = 0.5 * limits.track * driven.omega
    left, right = (driven.v - turn) / wheels.radius, (driven.v + turn) / wheels.radius
    if driven.v == 0.0 and driven.omega == 0.0:
        s.hold_left = s.hold_right = 0.0  # friction holds a robot that stands
    elif steady:  # in a ramp the lag would be added up too, and make it longer
        s.hold_left += _ADDING * step * (left - views.qvel[6])
        s.hold_right += _ADDING * step * (right - views.qvel[7])
    # what rolling takes is known, and given beforehand: without it slow speeds are not reached
    views.ctrl[0] = left + s.hold_left + (math.copysign(wheels.rolling, left) if left else 0.0)
    views.ctrl[1] = right + s.hold_right + (math.copysign(wheels.rolling, right) if right else 0.0)


@jit
def _observe(step: float, views: Views, s: Any, wheels: WheelDrives, reach: float) -> float:
    """The true state after a step; how far any point of the outline has moved at most [m]."""
    q = views.qpos
    psi = math.atan2(2.0 * (q[3] * q[6] + q[4] * q[5]), 1.0 - 2.0 * (q[5] * q[5] + q[6] * q[6]))
    turned = wrap(psi - s.psi)
    moved = math.hypot(q[0] - s.x, q[1] - s.y) + reach * abs(turned)
    s.x, s.y, s.psi = q[0], q[1], s.psi + turned
    c, sn = math.cos(psi), math.sin(psi)
    s.v = c * views.qvel[0] + sn * views.qvel[1]
    s.side = -sn * views.qvel[0] + c * views.qvel[1]
    s.omega = views.qvel[5]
    s.left += views.qvel[6] * wheels.radius * step
    s.right += views.qvel[7] * wheels.radius * step
    s.yaw += turned
    s.tilt = math.acos(min(max(1.0 - 2.0 * (q[4] * q[4] + q[5] * q[5]), -1.0), 1.0))
    for i in range(2):
        # the torque at the end of the step, as the integrator takes it
        torque = wheels.gain * (views.ctrl[i] - views.qvel[6 + i])
        torque = min(max(torque, -wheels.torque), wheels.torque)
        s.energy += max(torque * views.qvel[6 + i], 0.0) * step
    return moved


@jit
def _score(
    s: Any, views: Views, moved: float, outline: Floats, reach: float, discs: Floats,
    walls: Floats,
) -> None:  # fmt: skip
    """Clearance where a new smallest one is possible, and contacts as physics felt them."""
    if abs(s.driven_v) + reach * abs(s.driven_omega) > _DUST:
        s.standing = False
    elif math.hypot(s.v, s.side) + reach * abs(s.omega) < _STANDS:
        s.standing = True  # and stays so, even if something nudges it
    moving = not s.standing
    s.since += moved
    if s.clearance - s.since < (s.least_moving if moving else s.least):
        s.clearance = outline_clearance(
            Pose(s.x, s.y, s.psi), outline, reach, discs, walls, NOWHERE
        )
        s.since = 0.0
        s.least = min(s.least, s.clearance)
        if moving:
            s.least_moving = min(s.least_moving, s.clearance)
    felt = views.sensors[0] > 0.0
    if felt:
        force = 0.0
        for i in range(1, 4):
            force += views.sensors[i] * views.sensors[i]
        s.force = max(s.force, math.sqrt(force))
        if not s.touching:
            s.touched += 1
    s.touching = felt
