"""Gives a driving robot another path: proposed, checked and made beside the loop, then taken up.

Meanwhile the robot stands in the mode it is in (`Loop.pause`). Nobody keeps that mode: what ends it
ends it. A way that can not be made ends in HOLD, and the driver is told.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from cohelm.core.types import Floats
from cohelm.drive.checking import Checking
from cohelm.drive.jobs import Jobs
from cohelm.drive.proposed import NONE, CheckedPath, PathChecker
from cohelm.law.reference import Reference
from cohelm.link.bulk_messages import Checked
from cohelm.link.messages import Answer, Mode, Severity
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop
from cohelm.plan.path_planner import Goal
from cohelm.robot.gate.gate import STANDING
from cohelm.robot.keep.gated_robot import standing

WITHIN = 20.0
"""A way that is not made so long after it was accepted is given up [s]."""
_WAITS = 5.0
"""A proposal that was not looked at for so long is answered with that [s]."""
_PAUSE = "way"
_DRIVES_NO_MORE = "who drove when it came drives no more"
_log = logging.getLogger("cohelm.drive")


class PathRequest(NamedTuple):
    """Where somebody wants the robot to go."""

    client: int
    """Of the link, or negative for who is no client of it."""
    number: int
    where: Floats | Goal
    """Way-points (n, 2) [m], or a goal."""
    only_check: bool


class PathRequests(Protocol):
    """Where wishes come from. Calls return at once."""

    def path_requests(self) -> Sequence[PathRequest]:
        """New since the last call."""
        ...

    def reply(self, client: int, said: Checked) -> None:
        """What is thought of one; for who is not known here, nothing."""
        ...


class _Waiting(NamedTuple):
    """A wish that has not been answered."""

    client: int
    number: int
    where: Floats | Goal
    only_check: bool
    lease: tuple[int, int]
    """When it came."""
    since: float


class _ProposedPath:
    """A way that was accepted, on its way to being driven."""

    def __init__(self, wish: _Waiting, now: float) -> None:
        self.wish, self.since = wish, now
        self.checking = False
        """Again, from where the robot stands now."""
        self.reference: Reference | None = None
        self.made: Driver | str | None = None
        """Or why there is none."""


class Rerouting:
    """Of one session. All calls but the jobs come from the loop's thread and take no time."""

    def __init__(
        self, sources: Sequence[PathRequests], checking: Checking, jobs: Jobs,
        build: Callable[[Reference], Driver], shown: Callable[[Loop, Reference], None],
    ) -> None:  # fmt: skip
        """build: makes a driver, beside the loop; raises what it likes. shown: told of a way that
        the robot has taken up."""
        self._sources, self._checking, self._jobs = sources, checking, jobs
        self._build, self._shown = build, shown
        self._wishes: dict[tuple[int, bool], _Waiting] = {}
        """Of each client the newest to check, and to go; longest waiting first."""
        self._checked: _Waiting | _ProposedPath | None = None
        """What is being checked."""
        self._way: _ProposedPath | None = None
        self._building: _ProposedPath | None = None

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        now = loop.gated.now()
        for source in self._sources:
            for one in source.path_requests():
                self._take(one, loop.supervisor.lease, now)
        self._expire(now)
        checked_path = self._checking.result(now) if self._checked is not None else None
        if checked_path is not None:
            self._conclude(loop, checked_path, now)
        self._collect()
        if self._way is not None:
            self._go_on(loop, self._way, now)
        if self._checked is None:
            self._check_next(loop, now)

    def judge_by(self, judge: PathChecker) -> None:
        """Hold ways against something else from now on."""
        self._checking.judge_by(judge)

    def close(self) -> None:
        """No more checks; a driver nobody took is ended. After the jobs are done."""
        self._checking.close()
        for way in {self._way, self._building}:
            if way is not None and isinstance(way.made, Driver):
                way.made.close()

    # ---- proposals ----------------------------------------------------------------------

    def _take(self, one: PathRequest, lease: tuple[int, int], now: float) -> None:
        self._wishes[one.client, one.only_check] = _Waiting(*one, lease, now)

    def _expire(self, now: float) -> None:
        for key, wish in list(self._wishes.items()):
            if now - wish.since > _WAITS:
                del self._wishes[key]
                self._reply(wish, False, "there was no time to check it: send it again")

    def _check_next(self, loop: Loop, now: float) -> None:
        """The way that the robot waits for first, then the driver's proposals, then in turn."""
        if loop.seen is None or not self._checking.ready:
            return
        way = self._way
        if way is not None and way.checking:
            self._checked, where = way, way.wish.where
        elif self._wishes:
            own = sorted(
                key for key in self._wishes if key[0] == loop.supervisor.lease[0]
            )  # first: to go
            wish = self._wishes.pop(own[0] if own else next(iter(self._wishes)))
            self._checked, where = wish, wish.where
        else:
            return
        self._checking.begin(now, where, loop.seen.pose)

    def _conclude(self, loop: Loop, checked_path: CheckedPath, now: float) -> None:
        what, self._checked = self._checked, None
        if isinstance(what, _ProposedPath):
            if what is self._way:
                what.checking = False
                what.reference, what.made = checked_path.reference, checked_path.why or None
        elif what is not None:
            ok, why = checked_path.reference is not None, checked_path.why
            if ok and not what.only_check and what.lease != loop.supervisor.lease:
                ok = False
                why = "you do not drive" if what.client > 0 else _DRIVES_NO_MORE
            if ok and not what.only_check and loop.supervisor.docking.on:
                ok, why = False, f"it is {loop.supervisor.docking.activity}: hold it first"
            if ok and not what.only_check:
                self._accept(loop, what, now)
            self._reply(what, ok, why, checked_path.worst)

    def _reply(self, wish: _Waiting, ok: bool, why: str, worst: int = NONE) -> None:
        for source in self._sources:
            source.reply(wish.client, Checked(Answer(wish.number, ok, why), worst))

    # ---- the way that was accepted ------------------------------------------------------

    def _accept(self, loop: Loop, wish: _Waiting, now: float) -> None:
        """Stand, whatever the mode; one that was accepted before is forgotten."""
        self._way = _ProposedPath(wish, now)
        loop.supervisor.pause(_PAUSE, "a new way is being made")

    def _go_on(self, loop: Loop, way: _ProposedPath, now: float) -> None:
        """Once it stands: check again from there, have a driver made, and go."""
        if loop.supervisor.lease != way.wish.lease:
            self._give_up(loop, "who asked for it drives no more")
        elif isinstance(way.made, str):
            self._give_up(loop, way.made)
        elif now - way.since > WITHIN:
            self._give_up(loop, f"it was not made within {WITHIN:.0f} s")
        elif way.made is not None and way.reference is not None:
            self._take_up(loop, way.made, way.reference)
        elif way.reference is not None and self._building is None:
            self._building = way
            self._jobs.do(lambda: self._make(way))
        elif way.reference is None and not way.checking and stands(loop):
            way.checking = True

    def _make(self, way: _ProposedPath) -> None:
        """Beside the loop."""
        try:
            if way.reference is not None:
                way.made = self._build(way.reference)
        except Exception as error:
            _log.exception("no driver for the new way")
            way.made = f"it could not be made: {error}"

    def _collect(self) -> None:
        """What was made, be it that nobody waits for it any more."""
        built = self._building
        if built is None or built.made is None:
            return
        self._building = None
        if built is not self._way and isinstance(built.made, Driver):
            self._jobs.do(built.made.close)

    def _take_up(self, loop: Loop, driver: Driver, reference: Reference) -> None:
        old = loop.driver
        loop.set_driver(driver)
        self._way = None
        self._jobs.do(old.close)
        self._shown(loop, reference)
        loop.supervisor.resume(_PAUSE)

    def _give_up(self, loop: Loop, why: str) -> None:
        self._way = None
        if loop.supervisor.mode != Mode.HOLD:
            loop.supervisor.choose(Mode.HOLD)
        loop.supervisor.resume(_PAUSE)
        loop.alarms.on("way", f"no new way, the robot holds: {why}", Severity.WARNING)
        loop.alarms.off("way")  # to be acknowledged; there is nothing that goes on


def stands(loop: Loop) -> bool:
    """Whether the robot does, and is not told otherwise."""
    seen = loop.seen
    return seen is not None and standing(seen.twist) and loop.gated.gate.out == STANDING
