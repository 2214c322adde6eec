"""Updates the zones when filter masks on topics change while the robot drives.

New zones are built beside the loop, and apply as soon as the robot can stop clear of them; until
then the former zones apply, and the robot brakes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import NamedTuple

from cohelm.drive.jobs import Jobs, told
from cohelm.drive.session import Session
from cohelm.drive.shown import all_zone_messages
from cohelm.link.bulk_messages import ZoneMap
from cohelm.link.messages import Severity
from cohelm.loop.loop import Loop
from cohelm.plan.zones import Zoned, Zones
from cohelm.ros.masks import FilterMask, Masks
from cohelm.ros.port import Transport
from cohelm.scenario.zones import check, masked

_PAUSE = "zones"
_BRAKES = "the zones have changed: braking for them"


class _NewZones(NamedTuple):
    """New zones that are not in use yet."""

    zones: Zones
    maps: tuple[ZoneMap, ...]
    zoned: Zoned
    topics: str
    """Topics of the masks that have changed."""


class ZonesOnTopics:
    """The zones of one drive. All but `attend` and `turn` runs beside the loop."""

    def __init__(
        self, transport: Transport, used: Sequence[FilterMask], frame: str, namespace: str,
        jobs: Jobs, say: Callable[[str], None],
    ) -> None:  # fmt: skip
        """used: masks whose zones the robot starts with. frame: of the map. say: shows a sentence
        to a person."""
        self._used, self._jobs, self._say = tuple(used), jobs, say
        self._session: Session | None = None
        self._made: SimpleQueue[_NewZones] = SimpleQueue()
        self._next: _NewZones | None = None
        self._problem = self._reported = ""
        self._queued = False
        topics = [one.info for one in used]
        self._masks = Masks(transport, topics, frame, namespace, self._queue_update)

    def attend(self, session: Session) -> None:
        """Update this session's zones from now on."""
        self._session = session
        self._queue_update()

    def turn(self, loop: Loop) -> None:
        """Between two periods: takes no time."""
        problem = self._problem
        if problem != self._reported:
            self._reported = problem
            loop.alarms.off(_PAUSE)
            if problem:
                loop.alarms.on(_PAUSE, problem, Severity.WARNING)
                loop.log.event(problem)
        with suppress(Empty):
            while True:
                self._next = self._made.get_nowait()
        newer, seen, session = self._next, loop.seen, self._session
        if newer is None or seen is None or session is None:
            return
        if not loop.driver.set_zones(newer.zoned, None if seen.lost else seen.pose):
            loop.supervisor.pause(_PAUSE, _BRAKES)
            return
        self._next = None
        session.set_zones(newer.zones, newer.maps)
        loop.log.event(f"{newer.topics} has changed: its zones apply from now on")
        loop.supervisor.resume(_PAUSE)

    def close(self) -> None:
        """Update no more zones."""
        self._jobs.close(1.0)
        self._masks.close()

    def _queue_update(self) -> None:
        if self._session is not None and not self._queued:
            self._queued = True
            self._jobs.do(self._update)

    def _update(self) -> None:
        self._queued = False  # a change from here on starts another job
        session = self._session
        if session is None:
            return
        problem = ""
        try:
            newer = self._masks.changed(self._used)
            topics = [
                one.topic for one, used in zip(newer, self._used, strict=True) if one is not used
            ]
            if topics:
                self._take(session, newer, " and ".join(topics))
        except Exception as error:
            problem = f"{told(error)}; the earlier zones still apply"
        if problem != self._problem:
            self._problem = problem
            if problem:
                self._say(problem)

    def _take(self, session: Session, masks: tuple[FilterMask, ...], topics: str) -> None:
        plan = session.plan
        zones = masked(masks, lifted=True).over(plan.zones)
        check(zones, session.known)
        settings, u_d = session.loop.driver.settings, plan.robot.scenario.reference.speed_mps
        zoned = Zoned(zones, settings.outline, settings.gains.u_d, settings.limits)
        self._made.put(_NewZones(zones, all_zone_messages(zones, u_d), zoned, topics))
        self._used = masks
        self._say(f"{topics} has changed: its zones are being loaded")
