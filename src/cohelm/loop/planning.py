"""Runs the pilot's slow part in another process, where it can not make the loop late."""

from __future__ import annotations

from collections import deque
from typing import Protocol

from cohelm.pilot.pilot import Planner
from cohelm.pilot.replanning import Plan, Task
from cohelm.robot.keep.child import Child

ANSWER = 2.0
"""A plan that takes longer is not used [s]. They take 0.04 s, and ten times that on a busy machine;
meanwhile the robot goes a metre, as far as its plans look ahead around things."""
_ASKED = 0.1  # who asks more seldom for a plan does not wait for it [s]


class Planning(Protocol):
    """Takes a snapshot, and has a plan some periods later."""

    @property
    def broken(self) -> bool:
        """Whether there will be no more plans: the course stays as it is."""
        ...

    late: bool
    """Whether there was no plan in time, so that none is used, though there may be some again."""

    @property
    def busy(self) -> bool:
        """Whether a plan is being made, or has not been asked for since."""
        ...

    def offer(self, now: float, task: Task) -> bool:
        """Plan from this; False where the last one is not done yet."""
        ...

    def plan(self, now: float) -> Plan | None:
        """The plan, once, when it is there."""
        ...

    def close(self) -> None:
        """No more plans."""
        ...


class InProcessPlanner:
    """Plans at once, and hands the plan out after a set time: the same in every run."""

    def __init__(self, planner: Planner, takes: float = 0.04) -> None:
        """takes: as long as it would take elsewhere [s]."""
        self._planner, self._takes = planner, takes
        self.broken = self.late = False
        self._made: deque[tuple[float, Plan]] = deque()

    @property
    def busy(self) -> bool:
        """Whether a plan has not been handed out yet."""
        return bool(self._made)

    def offer(self, now: float, task: Task) -> bool:
        """Plan now."""
        if self._made:
            return False
        self._made.append((now + self._takes, self._planner(task)))
        return True

    def plan(self, now: float) -> Plan | None:
        """The plan, when its time has come."""
        if self._made and now >= self._made[0][0] - 1e-6:  # times add up with rounding
            return self._made.popleft()[1]
        return None

    def close(self) -> None:
        """Nothing to close."""


class RemotePlanner:
    """Plans in a process of its own.

    A plan whose task is older than `ANSWER` is not used: the robot is no longer where it is for.
    """

    def __init__(self, planner: Planner) -> None:
        self._child = Child("cohelm planner", planner)
        self.busy = False
        self._offered = self._asked = 0.0
        self._waited = 0.0
        """For this plan, as long as somebody asked for it [s]."""
        self.late = False

    @property
    def broken(self) -> bool:
        """Whether there will be no more plans."""
        return self._child.gone

    def offer(self, now: float, task: Task) -> bool:
        """Send it over, unless one is there."""
        if self.busy or self.broken:
            return False
        self.busy = True
        self._offered, self._asked, self._waited = now, now, 0.0
        self._child.send(task)
        return not self.broken

    def plan(self, now: float) -> Plan | None:
        """The plan, if all of it has come back."""
        if not self.busy or self.broken:
            return None
        made: Plan | None = self._child.received()
        gap = max(now - self._asked, 0.0)
        # After a long gap another drive has begun, that has not waited yet.
        self._waited = 0.0 if gap > ANSWER else self._waited + min(gap, _ASKED)
        self.late = self.late and self._waited > 0.0
        self._asked = now
        if made is None:
            self.late = self.late or self._waited > ANSWER
            return None
        self.busy = False
        old = now - self._offered > ANSWER
        self.late = self._waited > ANSWER  # who did not ask did not wait
        return None if old else made

    def close(self) -> None:
        """End the process."""
        self._child.end(1.0)
