"""Force feedback to the operator: the spring of (35), and a cue from the guard. Pure functions.

The cue pushes the stick towards the applied command, where the guard restricts it. It is bounded,
so that a hand always wins and a released stick returns; damped and limited in its rate of change,
so that hand, network and guard do not oscillate; and it fades with the age of the status it is made
from.
"""

from __future__ import annotations

import math

from cohelm.core.types import CENTRED, Stick, Twist
from cohelm.link.sticks.port import Feel

STIFFEST = 10.0
"""The spring constant k_s for which the device gives all the stiffness it has (Table II: 5)."""
STRONGEST = 0.4
"""Share of the device's force that the cue may use, on each axis."""
_GAIN = 0.8  # push for a command reduced by the robot's largest speed
SLOWNESS = 0.08
"""Time constant of the damping [s]."""
STEEPEST = 3.0
"""Largest change of the push [1/s]."""
FRESH, GONE = 0.1, 0.4
"""Age of the status up to which the cue is undiminished, and from which there is none [s]."""


def spring(k_s: float) -> float:
    """The spring f = k_s x (35) as a share of the stiffest; k_s >= 0."""
    return min(max(k_s / STIFFEST, 0.0), 1.0)


def wanted(nominal: Twist, applied: Twist, speed: float, yaw_rate: float) -> Stick:
    """The push for the present restriction: from the nominal to the applied command.

    speed, yaw_rate: the robot's largest, > 0 [m/s, rad/s].
    """
    return Stick(
        bounded(_GAIN * (applied.v - nominal.v) / speed, STRONGEST),
        bounded(_GAIN * (applied.omega - nominal.omega) / yaw_rate, STRONGEST),
    )


def faded(push: Stick, age: float) -> Stick:
    """The push faded by the age of its status [s]; NaN counts as older than all."""
    left = (GONE - age) / (GONE - FRESH)
    share = min(max(left, 0.0), 1.0) if math.isfinite(left) else 0.0
    return Stick(push.x * share, push.psi * share)


def damped(before: Stick, push: Stick, dt: float) -> Stick:
    """The push `dt` later, on its way from `before` to `push`."""
    share = 1.0 - math.exp(-dt / SLOWNESS)
    most = STEEPEST * dt
    return Stick(
        before.x + bounded(share * (push.x - before.x), most),
        before.psi + bounded(share * (push.psi - before.psi), most),
    )


def returning(push: Stick, stick: Stick, stiffness: float) -> Stick:
    """The push, limited so that a released stick still returns to its centre.

    A deflection is the operator's command, and the cue must not make one: outwards and across it is
    at most half of the spring's force there, towards the centre at most twice that.
    stiffness: share of the stiffest spring.
    """
    out = math.hypot(*stick)
    if not out > 0.0:
        return CENTRED
    x, psi = stick.x / out, stick.psi / out
    along = min(push.x * x + push.psi * psi, 0.0)
    rest = Stick(push.x - along * x, push.psi - along * psi)
    along = max(along, -2.0 * stiffness * out)
    size = math.hypot(*rest)
    share = min(1.0, 0.5 * stiffness * out / size) if size > 0.0 else 0.0
    return Stick(along * x + share * rest.x, along * psi + share * rest.psi)


def shake(feel: Feel) -> float:
    """Strength of the vibration of a device without force, in [0, 1]."""
    return min(1.0, math.hypot(*feel.push))


def bounded(value: float, most: float) -> float:
    """The value in [-most, most]; 0 where it is not finite."""
    return min(max(value, -most), most) if math.isfinite(value) else 0.0
