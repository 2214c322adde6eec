"""Forces of a stick whose spring is computed here, not in the device. Pure functions.

The spring of (35), some damping, and the guard's cue. The sum is bounded, begins at zero, can not
jump, and fades when the position of the stick is no longer known: without it a spring is a shove.
"""

from __future__ import annotations

from typing import NamedTuple

from cohelm.core.types import CENTRED, Stick
from cohelm.link.sticks.feel import bounded
from cohelm.link.sticks.port import Feel

_MOST_SWINGS, _WIDTH, _PAUSE = 10, 0.3, 0.5
"""So many changes of side are an oscillation, each beyond this deflection, and none after a longer
pause [s]."""


class ForceRules(NamedTuple):
    """Parameters of the force."""

    damping: float = 0.05
    """Share of the full force against a full deflection a second [s]."""
    rise: float = 2.0
    """Time from no force to the whole, after the start or a gap [s]."""
    steepest: float = 20.0
    """Largest change of the force [1/s]."""
    fresh: float = 0.1
    """Age of the deflection up to which the force is undiminished [s]."""
    gone: float = 0.25
    """Age from which there is no force [s]."""
    gap: float = 0.1
    """Longest time between two forces without a restart from zero [s]."""


class Force(NamedTuple):
    """A force on both axes, and its share of the rise."""

    share: Stick
    """In [-1, 1] of the full force; forward and left positive."""
    risen: float
    """In [0, 1]."""


NO_FORCE = Force(CENTRED, 0.0)


def wanted(stick: Stick, rate: Stick, feel: Feel, damping: float) -> Stick:
    """The force of spring, damping and cue, in [-1, 1].

    (35) f = k_s x, towards the centre; `feel.spring` is k_s in parts of the stiffest.
    rate: of the deflection [1/s]. NaN and inf give no force.
    """
    return Stick(
        _axis(stick.x, rate.x, feel.spring, feel.push.x, damping),
        _axis(stick.psi, rate.psi, feel.spring, feel.push.psi, damping),
    )


def changed(before: Force, target: Stick, age: float, dt: float, rules: ForceRules) -> Force:
    """The force `dt` later. age: of the deflection that `target` was made from [s]."""
    if not 0.0 <= dt <= rules.gap:
        return NO_FORCE
    known = 1.0 if age <= rules.fresh else (rules.gone - age) / (rules.gone - rules.fresh)
    if not known > 0.0:
        return NO_FORCE
    risen = min(1.0, before.risen + dt / rules.rise)
    most = rules.steepest * dt
    return Force(
        Stick(
            before.share.x + bounded(risen * known * target.x - before.share.x, most),
            before.share.psi + bounded(risen * known * target.psi - before.share.psi, most),
        ),
        risen,
    )


class Swings:
    """Detects oscillation: counts how often a stick swings through its centre.

    A spring with a delay returns more energy than was put in.
    """

    def __init__(self) -> None:
        self._sides, self._counts, self._last = [0, 0], [0, 0], [-1e9, -1e9]

    def too_many(self, stick: Stick, now: float) -> bool:
        """Whether the stick oscillates now."""
        for axis, deflection in enumerate(stick):
            side = (deflection > _WIDTH) - (deflection < -_WIDTH)
            if side and side != self._sides[axis]:
                on = now - self._last[axis] <= _PAUSE
                self._counts[axis] = self._counts[axis] + 1 if on else 0
                self._sides[axis], self._last[axis] = side, now
        return max(self._counts) >= _MOST_SWINGS


def _axis(deflection: float, rate: float, spring: float, push: float, damping: float) -> float:
    return bounded(push - spring * deflection - damping * rate, 1.0)
