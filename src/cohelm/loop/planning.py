"""Runs the path planner in another process, where it can not delay the loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from cohelm.pilot.replanning import Plan, Planner, Task
from cohelm.robot.keep.child import Child

MAX_PLAN_AGE = 2.0
"""A plan that takes longer is not used [s]. Plans take 0.04 s, ten times that on a busy machine; in
this time the robot travels a metre, as far as plans look ahead."""
_POLL_GAP = 0.1  # a longer gap between two polls does not count as waiting [s]


class InProcessPlanner:
    """Plans at once, and returns the plan after a fixed time: deterministic."""

    def __init__(self, planner: Planner, takes: float = 0.04) -> None:
        """takes: time until the plan is returned [s]."""
        self._planner, self._takes = planner, takes
        self.broken = self.late = False
        self._made: deque[tuple[float, Plan]] = deque()

    @property
    def busy(self) -> bool:
        """Whether a plan has not been collected yet."""
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
            due, made = self._made.popleft()
            return None if now - due > MAX_PLAN_AGE else made
        return None

    def close(self) -> None:
        """Nothing to close."""


class RemotePlanner:
    """Plans in a process of its own.

    A plan whose task is older than `MAX_PLAN_AGE` is not used: the robot has moved on.
    """

    def __init__(self, planner: Planner, begin: Callable[[], None] | None = None) -> None:
        """begin: run there before the first plan."""
        self._child = Child("cohelm planner", planner, begin)
        self.busy = False
        self._offered = self._polled = 0.0
        self._waited = 0.0
        """How long the caller has polled for this plan [s]."""
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
        self._offered, self._polled, self._waited = now, now, 0.0
        self._child.send(task)
        return not self.broken

    def plan(self, now: float) -> Plan | None:
        """The plan, if it has come back whole."""
        if not self.busy or self.broken:
            return None
        made: Plan | None = self._child.received()
        gap = max(now - self._polled, 0.0)
        # After a long gap another drive has begun, which has not waited yet.
        self._waited = 0.0 if gap > MAX_PLAN_AGE else self._waited + min(gap, _POLL_GAP)
        self.late = self.late and self._waited > 0.0
        self._polled = now
        if made is None:
            self.late = self.late or self._waited > MAX_PLAN_AGE
            return None
        self.busy = False
        old = now - self._offered > MAX_PLAN_AGE
        self.late = self._waited > MAX_PLAN_AGE
        return None if old else made

    def close(self) -> None:
        """End the process."""
        self._child.end(1.0)


Planning = InProcessPlanner | RemotePlanner
"""Takes a task, and returns a plan some periods later."""
