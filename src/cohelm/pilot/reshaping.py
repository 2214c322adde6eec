"""Takes up another outline of the robot while it drives, where it can stop with both of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cohelm.core.types import Floats
from cohelm.law.verdict import Verdict
from cohelm.robot.footprint import hull

_CERTIFIED = (Verdict.UNTOUCHED, Verdict.SHAPED)


class Shape:
    """The outline that the filter counts with."""

    def __init__(self, outline: Floats, reshape: Callable[[Floats], None]) -> None:
        """reshape: tells the filter."""
        self._now, self._next, self._reshape = outline, outline, reshape

    @property
    def outline(self) -> Floats:
        """What counts."""
        return self._now

    @property
    def told(self) -> Floats:
        """What the robot said last: it alone will count."""
        return self._next

    def take(self, outline: Floats | None) -> bool:
        """What the robot says its outline is; None: nothing. Another one counts at once, and the
        one before too. Returns whether it is another one."""
        if outline is None or np.array_equal(outline, self._next):
            return False
        self._now = hull(np.vstack((self._now, outline)))
        self._next = outline
        self._reshape(self._now)
        return True

    def settle(self, verdict: Verdict, stands: bool) -> bool:
        """After a period with it: whether both still count.

        The new one alone does as soon as the filter has certified a motion, and the braking after
        it, for both; else when the robot stands.
        """
        if self._next is self._now:
            return False
        if verdict in _CERTIFIED or stands:
            self._now = self._next
            self._reshape(self._now)
            return False
        return True
