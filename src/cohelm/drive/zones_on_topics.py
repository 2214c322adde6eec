"""Takes up the zones of masks on topics that change while the robot drives.

They are read and made beside the loop, and count as soon as the robot can stop clear of them; until
then those before count, and it brakes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.drive.jobs import Jobs
from cohelm.drive.session import Session
from cohelm.drive.shown import all_zone_messages
from cohelm.link.bulk_messages import ZoneMap
from cohelm.link.messages import Severity
from cohelm.loop.loop import Loop
from cohelm.plan.zones import Zoned, Zones
from cohelm.ros.masks import FilterMask, Masks
from cohelm.ros.port import Transport
from cohelm.scenario.zones import check, given_first, masked

_PAUSE = "zones"
_BRAKES = "the zones have changed, and it brakes for them"


class _Newer(NamedTuple):
    """Zones that are not in use yet."""

    zones: Zones
    maps: tuple[ZoneMap, ...]
    zoned: Zoned
    topics: str
    """Of the masks that have changed."""


class ZonesOnTopics:
    """Of one drive. All but `attend` and `turn` happens beside the loop."""

    def __init__(
        self, transport: Transport, used: Sequence[FilterMask], frame: str, namespace: str,
        jobs: Jobs, say: Callable[[str], None],
    ) -> None:  # fmt: skip
        """used: those whose zones the robot begins with. frame: of the map. say: hears a sentence
        for a person."""
        self._used, self._jobs, self._say = tuple(used), jobs, say
        self._session: Session | None = None
        self._made: SimpleQueue[_Newer] = SimpleQueue()
        self._next: _Newer | None = None
        self._wrong = self._told = ""
        self._asked = False
        topics = [one.info for one in used]
        self._masks = Masks(transport, topics, frame, namespace, self._look_soon)

    def attend(self, session: Session) -> None:
        """Its robot takes them up from now on."""
        self._session = session
        self._look_soon()

    def turn(self, loop: Loop) -> None:
        """Between two periods: takes no time."""
        wrong = self._wrong
        if wrong != self._told:
            self._told = wrong
            loop.alarms.off(_PAUSE)
            if wrong:
                loop.alarms.on(_PAUSE, wrong, Severity.WARNING)
                loop.log.event(wrong)
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
        loop.log.event(f"{newer.topics} has changed: its zones count from now on")
        loop.supervisor.resume(_PAUSE)

    def close(self) -> None:
        """Take up no more."""
        self._jobs.close(1.0)
        self._masks.close()

    def _look_soon(self) -> None:
        if self._session is not None and not self._asked:
            self._asked = True
            self._jobs.do(self._look)

    def _look(self) -> None:
        self._asked = False  # what comes from here on is looked at again
        session = self._session
        if session is None:
            return
        wrong = ""
        try:
            newer = self._masks.changed(self._used)
            topics = [
                one.topic for one, used in zip(newer, self._used, strict=True) if one is not used
            ]
            if topics:
                self._take(session, newer, " and ".join(topics))
        except CohelmError as error:
            wrong = f"{error}; the zones from before count on"
        if wrong != self._wrong:
            self._wrong = wrong
            if wrong:
                self._say(wrong)

    def _take(self, session: Session, masks: tuple[FilterMask, ...], topics: str) -> None:
        plan = session.plan
        zones = given_first(masked(masks, lifted=True), plan.zones) or Zones()
        check(zones, session.known)
        settings, u_d = session.loop.driver.settings, plan.robot.scenario.reference.speed_mps
        zoned = Zoned(zones, settings.outline, settings.gains.u_d)
        self._made.put(_Newer(zones, all_zone_messages(zones, u_d), zoned, topics))
        self._used = masks
        self._say(f"{topics} has changed: its zones are taken up")
