"""Monitor of bumpers and cliff sensors: while one is on, only motion away from it passes. Where the
robot was driven against it, the gate latches a fault."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Twist
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import UNRESTRICTED, Restriction
from cohelm.robot.port import Contact, Readings

AHEAD = 0.02
"""A stamp may be this far ahead of the clock [s]; more, and a clock has jumped."""
ALONG = 1e-9
"""Slower outward motion counts as along the surface [m/s]."""


class _Side(NamedTuple):
    """Where a sensor is, in the body frame."""

    model: ContactModel
    normal: tuple[float, float]
    """Outwards."""
    points: tuple[tuple[float, float], ...]
    """None of them may go outwards while it is on [m]."""


class ContactMonitor:
    """Of one robot. See `robot.monitor.Monitor`."""

    def __init__(self, model: RobotModel) -> None:
        self._sides = [_side(one, model.track_m) for one in model.contacts]
        self._newest: dict[str, Contact] = {}

    def observe(
        self, now: float, readings: Readings, applied: Twist, stopped: bool = False
    ) -> Restriction:
        """Take their readings; a fault where the robot is driven against one that is newly on."""
        newly: list[_Side] = []
        known = {one.sensor: one for one in readings.contacts}
        for side in self._sides:
            name = side.model.name
            new, old = known.get(name), self._newest.get(name)
            if new is None:
                self._newest.pop(name, None)
                continue
            if new.on and not (old is not None and old.on) and _outwards(side, applied):
                newly.append(side)
            self._newest[name] = new
        if newly:
            return Restriction(0.0, f"contact monitor: {newly[0].model.on}", fault=True)
        return UNRESTRICTED

    def restrict(self, now: float, twist: Twist) -> Restriction:
        """Share 0 for a motion towards one that is on, and for any motion while one is silent."""
        if twist == Twist(0.0, 0.0) or not math.isfinite(twist.v + twist.omega):
            return UNRESTRICTED  # nothing to take from; the gate knows what to do with no number
        for side in self._sides:
            wrong = overdue(side.model, self._newest.get(side.model.name), now)
            if wrong:
                return Restriction(0.0, f"contact monitor: {wrong}")
        for side in self._sides:
            if self._newest[side.model.name].on and _outwards(side, twist):
                return Restriction(
                    0.0, f"contact monitor: {side.model.on}: the robot can only drive away from it"
                )
        return UNRESTRICTED


def overdue(model: ContactModel, newest: Contact | None, now: float) -> str:
    """What is wrong with the age of its last reading, or ""."""
    if newest is None:
        return f"no message from the {model.label}"
    if not math.isfinite(newest.stamp):
        return f"the time of the {model.label} is not a number"
    age = now - newest.stamp
    if age < -AHEAD:
        return f"the {model.label} comes from the future: a clock jumped"
    if age > model.timeout_s:
        return f"no message from the {model.label} for more than {1e3 * model.timeout_s:.0f} ms"
    return ""


def _side(model: ContactModel, track: float) -> _Side:
    yaw, points = math.radians(model.mount_yaw_deg), model.ends()
    if isinstance(model, CliffModel):  # what falls are the wheels
        points = (*points, (0.0, 0.5 * track), (0.0, -0.5 * track))
    return _Side(model, (math.cos(yaw), math.sin(yaw)), points)


def _outwards(side: _Side, twist: Twist) -> bool:
    """Whether a twist moves any of its points the way it faces."""
    v, omega = twist
    nx, ny = side.normal
    return any((v - omega * y) * nx + omega * x * ny > ALONG for x, y in side.points)
