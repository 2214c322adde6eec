"""How fast, and whether at all, the robot goes on for a driver who is far away, slow or silent."""

from __future__ import annotations

import math

from cohelm.link.latency_speed_limit import Cap, speed_cap
from cohelm.link.messages import Arming
from cohelm.link.operator_input import OperatorInput
from cohelm.loop.stick_arming import StickState
from cohelm.pilot.step import Settings

FREE = Cap(math.inf, "")
"""No cap."""
LOST = 0.2
"""A robot that has lost its place is never driven faster [m/s]."""
_FREES = 0.05  # nor is it slowed below this: it can leave what it stands against [m/s]
_DECELERATION = 1.0  # of a robot that has no limit [m/s^2]


def silent(received: OperatorInput, patience: float) -> str:
    """Why the driver counts as lost; empty: not. With any stick, and with none."""
    if received.driver == 0:
        return "nobody drives any more"
    if received.command is None and not received.age <= patience:
        told = f"for {1000.0 * received.age:.0f} ms" if math.isfinite(received.age) else "yet"
        return f"no command {told}"
    return ""


def allowed(received: OperatorInput, scale: float) -> float:
    """The share of the usual speed that the driver allows: the newest word counts."""
    return received.command.speed_scale if received.command is not None else scale


def far(received: OperatorInput, stick_state: StickState) -> float:
    """The delay over which a person steers [s]; NaN: nobody does, or it is not known."""
    return received.round_trip if stick_state.arming == Arming.ARMED else math.nan


def cap(delay: float, clear: float, settings: Settings) -> Cap:
    """How fast a person may go who sees the past. clear: smallest gap to anything [m]."""
    return speed_cap(delay, clear, _braking(settings), settings.gains.u_d)


def crawl(clear: float, delay: float, settings: Settings) -> Cap:
    """How fast a robot may go that has lost its place, and has its scan alone to go by.

    It stands within half of what is clear [m], its own delay [s] included, and is never faster
    than LOST:

        v delay + v^2 / (2 a) = clear / 2   =>   v = a (sqrt(delay^2 + clear / a) - delay)
    """
    a = _braking(settings)
    room = a * (math.sqrt(delay * delay + max(clear, 0.0) / a) - delay)
    speed = min(max(room, _FREES), LOST)
    seen = f"{clear:.1f} m clear" if math.isfinite(clear) else "nothing in sight"
    return Cap(speed, f"lost, with {seen}")


def _braking(settings: Settings) -> float:
    braking = min(settings.limits.acceleration, settings.limits.wheel_acceleration)
    return braking if math.isfinite(braking) and braking > 0.0 else _DECELERATION
