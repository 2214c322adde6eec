"""Checks the route that a drive begins with on its map, as edited routes are checked.

Until that is done the route is not followed. If its goal can not be reached the robot does not set
off on it: automatic mode is refused, shared is the stick alone, until there is another route.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager

import numpy as np

from cohelm.core.types import Floats
from cohelm.drive.jobs import in_thread
from cohelm.drive.path_check import NONE, CheckedPath
from cohelm.drive.path_check_process import Checking, InlineChecking, RemoteChecking
from cohelm.drive.rerouting import checker_of
from cohelm.drive.session import Session
from cohelm.link.messages import Mode
from cohelm.loop.loop import Loop
from cohelm.plan.path_planner import Goal

_READY = 20.0
"""If checking can not begin within this, the route is followed unchecked [s]."""
ALARM = "reach"


class RouteCheck:
    """The check of one drive; `turn` is called between two periods and takes no time."""

    def __init__(
        self, session: Session, checking: Checking, done: Callable[[], None] = lambda: None
    ) -> None:
        """checking: may be shared, each check is taken by who began it. done: called when it is no
        longer needed. Nothing is checked without a map, or a route."""
        self._session, self._checking, self._done = session, checking, done
        self._driver = session.loop.driver
        site = session.plan.robot.scenario
        self._over = not to_check(session)
        self._points: Floats = np.array(site.reference.waypoints_m, dtype=np.float64)
        self._asked = False
        """Whether a check is under way."""
        self._along: CheckedPath | None = None
        """Why it can not follow the route as it is; then the goal alone is checked."""
        self._since: float | None = None
        session.loop.supervisor.checking_route = not self._over

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        if loop.driver is not self._driver:  # another route, which was checked
            self._driver = loop.driver
            loop.alarms.off(ALARM)
            self._end(loop)
        now, seen = loop.gated.now(), loop.seen
        if not self._over and not self._asked and seen is not None and not seen.lost:
            self._since = now if self._since is None else self._since
            if self._checking.ready:
                self._checking.begin(
                    now, self._points if self._along is None else self._goal, seen.pose
                )
                self._asked = True
            elif now - self._since > _READY:
                self._unchecked(loop, f"no check began within {_READY:.0f} s")
        result = self._checking.result(now) if self._asked else None
        if result is not None:
            self._asked = False
            if not self._over:
                self._conclude(loop, result)

    @property
    def _goal(self) -> Goal:
        return Goal(*map(float, self._points[-1]))

    def _conclude(self, loop: Loop, result: CheckedPath) -> None:
        """Of the route as it is; then, if it can not be driven so, of its goal."""
        if result.reference is None and self._along is None:
            self._along = result
        elif self._along is None:
            self._end(loop)
        elif result.reference is None and result.worst != NONE:
            self._refuse(loop, result.why)
        elif self._along.worst == NONE:
            self._unchecked(loop, self._along.why)
        else:
            text = f"the route can not be driven as it is, {self._along.why}"
            text += ": the robot takes a detour if there is one"
            loop.alarms.over_already(ALARM, text)
            self._note(loop, text)

    def _refuse(self, loop: Loop, why: str) -> None:
        supervisor = loop.supervisor
        text = f"waypoint {len(self._points)}, the goal of the route, can not be reached: {why}"
        loop.alarms.on(ALARM, text)
        if supervisor.mode == Mode.AUTOMATIC and not supervisor.docking.on:
            supervisor.choose(Mode.HOLD)
            self._session.not_begun = text
        self._note(loop, text)
        supervisor.unreachable = text

    def _unchecked(self, loop: Loop, why: str) -> None:
        self._note(loop, f"the route could not be checked on the map: {why}")

    def _note(self, loop: Loop, text: str) -> None:
        self._session.route_problem = text
        loop.log.event(text, serious=True)
        self._end(loop)

    def _end(self, loop: Loop) -> None:
        loop.supervisor.checking_route = False
        if not self._over:
            self._over = True
            self._done()


def to_check(session: Session) -> bool:
    """Whether there is a route to check, and a map."""
    waits = session.loop.supervisor.awaits_route
    return session.known is not None and session.plan.robot.route is not None and not waits


@contextmanager
def checked_route(session: Session) -> Generator[RouteCheck]:
    """The check with a process of its own, which ends with it."""
    judge = checker_of(session.plan, session.known)
    real_time = session.plan.robot.real_time
    checking = RemoteChecking(judge) if real_time else InlineChecking(judge)
    ends: list[Callable[[], None]] = []
    try:
        yield RouteCheck(session, checking, lambda: ends.append(in_thread(checking.close)))
    finally:
        for end in ends or [checking.close]:
            end()
