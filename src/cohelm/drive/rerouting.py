"""Gives a driving robot another path: requested, checked and built beside the loop, then used.

Meanwhile the robot stands in its mode (`Supervisor.pause`); what ends the mode ends it for good. A
path that can not be built ends in HOLD, with an alarm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from cohelm.core.types import Floats
from cohelm.drive.jobs import Jobs, told
from cohelm.drive.path_check import NONE, CheckedPath, PathChecker
from cohelm.drive.path_check_process import Checking
from cohelm.drive.session import Session, SessionConfig, driver_of
from cohelm.drive.shown import reference_lines
from cohelm.law.reference import Reference
from cohelm.link.bulk_messages import Checked, Polyline
from cohelm.link.messages import Answer, Mode
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.path_planner import Goal
from cohelm.plan.zones import Cells
from cohelm.robot.gate.gate import STANDING
from cohelm.robot.keep.gated_robot import standing
from cohelm.scenario.docks import occupied

WITHIN = 20.0
"""A path that is not built this long after it was accepted is given up [s]."""
_MAX_WAIT = 5.0
"""A request that was not checked for this long is refused [s]."""
_PAUSE = "way"
_NOT_DRIVER = "the driver has changed since it came"


class PathRequest(NamedTuple):
    """A request for a path."""

    client: int
    """Client number; negative: not a client of the link."""
    number: int
    where: Floats | Goal
    """Waypoints (n, 2) [m], or a goal."""
    only_check: bool


class PathRequests(Protocol):
    """A source of requests. Calls return at once."""

    def path_requests(self) -> Sequence[PathRequest]:
        """Requests since the last call."""
        ...

    def reply(self, client: int, answer: Checked) -> None:
        """Take the result of a request; ignored for other sources' clients."""
        ...


class _Waiting(NamedTuple):
    """A request that was not answered yet."""

    path: PathRequest
    lease: tuple[int, int]
    """The lease when it came."""
    since: float


class _AcceptedPath:
    """An accepted path that is not driven yet."""

    def __init__(self, request: _Waiting, now: float) -> None:
        self.request, self.since = request, now
        self.checking = False
        """Whether it is checked again, from where the robot stands now."""
        self.reference: Reference | None = None
        self.made: Driver | str | None = None
        """The driver built for it; or why there is none."""


class Rerouting:
    """Rerouting of one session. All calls but the jobs come from the loop's thread."""

    def __init__(
        self, session: Session, sources: Sequence[PathRequests], checking: Checking, jobs: Jobs,
        adopted: Callable[[tuple[Polyline, ...]], None],
    ) -> None:  # fmt: skip
        """adopted: called with a new path's lines once the robot uses it."""
        self._session, self._sources, self._checking = session, sources, checking
        self._jobs, self._adopted = jobs, adopted
        self._zones = session.zone_maps
        self._outline: Floats = session.loop.outline
        """What paths are checked against."""
        self._requests: dict[tuple[int, bool], _Waiting] = {}
        """The newest of each client, by (client, only_check); longest waiting first."""
        self._checked: _Waiting | _AcceptedPath | None = None
        """What is being checked."""
        self._accepted: _AcceptedPath | None = None
        self._building: _AcceptedPath | None = None

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        now, session = loop.gated.now(), self._session
        if session.zone_maps is not self._zones or loop.outline is not self._outline:
            self._zones, self._outline = session.zone_maps, loop.outline
            self._checking.set_checker(checker_of(session.plan, session.known, loop.outline))
        for source in self._sources:
            for one in source.path_requests():
                asked = _Waiting(one, loop.supervisor.lease, now)
                self._requests[one.client, one.only_check] = asked
        self._expire(now)
        checked_path = self._checking.result(now) if self._checked is not None else None
        if checked_path is not None:
            self._conclude(loop, checked_path, now)
        self._collect()
        if self._accepted is not None:
            self._continue(loop, self._accepted, now)
        if self._checked is None:
            self._check_next(loop, now)

    def close(self) -> None:
        """End checks, and a driver that was not used. After the jobs are done."""
        self._checking.close()
        for accepted in {self._accepted, self._building}:
            if accepted is not None and isinstance(accepted.made, Driver):
                accepted.made.close()

    # ---- proposals ----------------------------------------------------------------------

    def _expire(self, now: float) -> None:
        for key, request in list(self._requests.items()):
            if now - request.since > _MAX_WAIT:
                del self._requests[key]
                self._reply(request, False, "there was no time to check it: send it again")

    def _check_next(self, loop: Loop, now: float) -> None:
        """The accepted path first, then the driver's requests, then the others in turn."""
        if loop.seen is None or not self._checking.ready:
            return
        accepted = self._accepted
        if accepted is not None and accepted.checking:
            self._checked, where = accepted, accepted.request.path.where
        elif self._requests:
            driver = loop.supervisor.lease[0]
            own = sorted(key for key in self._requests if key[0] == driver)  # first: to go
            request = self._requests.pop(own[0] if own else next(iter(self._requests)))
            self._checked, where = request, request.path.where
        else:
            return
        self._checking.begin(now, where, loop.seen.pose)

    def _conclude(self, loop: Loop, checked_path: CheckedPath, now: float) -> None:
        what, self._checked = self._checked, None
        if isinstance(what, _AcceptedPath):
            if what is self._accepted:
                what.checking = False
                what.reference, what.made = checked_path.reference, checked_path.why or None
        elif what is not None:
            ok, why = checked_path.reference is not None, checked_path.why
            if ok and not what.path.only_check:
                if what.lease != loop.supervisor.lease:
                    ok = False
                    why = "you are not the driver" if what.path.client > 0 else _NOT_DRIVER
                elif loop.supervisor.docking.on:
                    ok, why = False, f"it is {loop.supervisor.docking.activity}: hold it first"
                else:
                    self._accepted = _AcceptedPath(what, now)  # one from before is dropped
                    loop.supervisor.pause(_PAUSE, "a new path is being planned")
            self._reply(what, ok, why, checked_path.worst)

    def _reply(self, request: _Waiting, ok: bool, why: str, worst: int = NONE) -> None:
        for source in self._sources:
            answer = Answer(request.path.number, ok, why)
            source.reply(request.path.client, Checked(answer, worst))

    # ---- the accepted path --------------------------------------------------------------

    def _continue(self, loop: Loop, accepted: _AcceptedPath, now: float) -> None:
        """Once the robot stands: check again from there, build a driver, and use it."""
        if loop.supervisor.lease != accepted.request.lease:
            self._give_up(loop, "the driver who requested it has changed")
        elif isinstance(accepted.made, str):
            self._give_up(loop, accepted.made)
        elif now - accepted.since > WITHIN:
            self._give_up(loop, f"it was not made within {WITHIN:.0f} s")
        elif accepted.made is not None and accepted.reference is not None:
            self._adopt(loop, accepted.made, accepted.reference)
        elif accepted.reference is not None and self._building is None:
            self._building = accepted
            self._jobs.do(lambda: self._make(accepted))
        elif accepted.reference is None and not accepted.checking and stands(loop):
            accepted.checking = True

    def _make(self, accepted: _AcceptedPath) -> None:
        """Build the driver, beside the loop."""
        try:
            if accepted.reference is not None:
                accepted.made = self._build(accepted.reference)
        except Exception as error:
            accepted.made = f"it could not be made: {told(error)}"

    def _build(self, reference: Reference) -> Driver:
        plan = self._session.plan
        return driver_of(plan, plan.robot.real_time, reference)

    def _collect(self) -> None:
        """Take a built driver; close it if its path was dropped."""
        built = self._building
        if built is None or built.made is None:
            return
        self._building = None
        if built is not self._accepted and isinstance(built.made, Driver):
            self._jobs.do(built.made.close)

    def _adopt(self, loop: Loop, driver: Driver, reference: Reference) -> None:
        old = loop.driver
        loop.set_driver(driver)
        self._accepted, self._session.driver = None, driver
        self._jobs.do(old.close)
        lines = reference_lines(reference)
        self._adopted(lines)
        for line in lines:
            loop.log.show(line)
        loop.supervisor.resume(_PAUSE)

    def _give_up(self, loop: Loop, why: str) -> None:
        self._accepted = None
        if loop.supervisor.mode != Mode.HOLD:
            loop.supervisor.choose(Mode.HOLD)
        loop.supervisor.resume(_PAUSE)
        loop.alarms.over_already("way", f"no new path, the robot holds: {why}")


def stands(loop: Loop) -> bool:
    """Whether the robot stands, and is commanded to."""
    seen = loop.seen
    return seen is not None and standing(seen.twist) and loop.gated.gate.applied == STANDING


def checker_of(
    plan: SessionConfig, known: LocalizationMap | None, outline: Floats | None = None
) -> PathChecker:
    """What paths of a robot at its site are checked against. outline: the robot's; None: its
    model's [m]."""
    surfaces, bounds = np.empty((0, 2)), np.empty((0, 2))
    if known is not None:
        surfaces = occupied(known)
        bounds = Cells(known.gap, known.resolution, known.origin).bounds()
    outline = plan.robot.model.outline if outline is None else outline
    keep_out = plan.zones.keep_out
    return PathChecker(plan.robot.scenario.reference.speed_mps, outline, surfaces, bounds, keep_out)
