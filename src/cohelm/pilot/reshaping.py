"""Changes the outline of the robot while it drives, once it can stop safely with both outlines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cohelm.core.types import Floats
from cohelm.law.verdict import Verdict
from cohelm.robot.footprint import hull

_CERTIFIED = (Verdict.UNTOUCHED, Verdict.SHAPED)


class Shape:
    """The outline that the filter uses."""

    def __init__(self, outline: Floats, reshape: Callable[[Floats], None]) -> None:
        """reshape: sets the filter's outline."""
        self._now, self._next, self._reshape = outline, outline, reshape

    @property
    def outline(self) -> Floats:
        """The outline in use."""
        return self._now

    @property
    def reported(self) -> Floats:
        """The outline that the robot reported last, which will be used alone."""
        return self._next

    def take(self, outline: Floats | None) -> bool:
        """Take the outline that the robot reports; None: none. A new one is used at once, together
        with the one before. Returns whether it is new."""
        if outline is None or np.array_equal(outline, self._next):
            return False
        self._now = hull(np.vstack((self._now, outline)))
        self._next = outline
        self._reshape(self._now)
        return True

    def settle(self, verdict: Verdict, stands: bool) -> bool:
        """After a period: whether both outlines are still in use.

        The new one alone is used as soon as the filter has certified a motion, and the braking
        after it, for both; else when the robot stands.
        """
        if self._next is self._now:
            return False
        if verdict in _CERTIFIED or stands:
            self._now = self._next
            self._reshape(self._now)
            return False
        return True
