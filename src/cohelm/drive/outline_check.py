"""Says where a robot that has got another outline does not fit any more: docks, and its route.

The filter holds it there in any case; a person should know before it drives there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cohelm.core.types import Floats
from cohelm.link.messages import Severity
from cohelm.loop.loop import Loop
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.course import poses_along
from cohelm.plan.distance_field import swept_clearances
from cohelm.scenario.docks import OFF, no_room, occupied

_SPACING = 0.05
"""Between poses of the route that are held against the map [m]."""
_PIECE = 40
"""So many of them in one period: what is looked at must not make that late."""
DOCKS, ROUTE = "docks", "route"
"""What the alarms are called."""


class OutlineCheck:
    """Of one drive on a map; `turn` is called between two periods and takes little time."""

    def __init__(self, loop: Loop, known: LocalizationMap) -> None:
        """With its first outline docks were checked already, and routes are a person's choice."""
        self._surfaces, self._resolution = occupied(known), known.resolution
        self._outline = loop.outline
        self._looking: Iterator[None] | None = None

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        if loop.outline is not self._outline:
            self._outline = loop.outline
            self._looking = self._look(loop, np.array(loop.outline))
        if self._looking is not None and next(self._looking, self) is self:
            self._looking = None

    def _look(self, loop: Loop, outline: Floats) -> Iterator[None]:
        """At all of it, a piece at a time."""
        docking, surfaces = loop.supervisor.docking, self._surfaces
        unfit: dict[int, str] = {}
        for number, dock in enumerate(docking.docks, 1):
            yield
            if why := no_room(dock, outline, surfaces, self._resolution):
                unfit[number] = f"with the outline that it has now, {why}"
        docking.unfit = unfit
        text = "; ".join(f"{docking.docks[i - 1].name}: {why}" for i, why in unfit.items())
        _notice(loop, DOCKS, text and f"no docking at {text}")
        pilot = loop.driver.pilot
        if pilot is None:
            return
        least = loop.driver.settings.rules.hard_margin - OFF * self._resolution
        route = pilot.planner.route  # not the way round that is driven just now
        poses = poses_along(route.reference, _SPACING)
        done = float(route.times[pilot.state.row]) / route.reference.duration
        poses = poses[min(int(done * len(poses)), len(poses) - 1) :]
        reach = float(np.hypot(*outline.T).max()) + 1.0
        worst, at = math.inf, poses[0]
        for piece in np.array_split(poses, math.ceil(len(poses) / _PIECE)):
            yield
            low, high = piece[:, :2].min(axis=0) - reach, piece[:, :2].max(axis=0) + reach
            near = ((surfaces > low) & (surfaces < high)).all(axis=1)
            gaps = swept_clearances(surfaces[near], outline, piece)
            if float(gaps.min()) < worst:
                worst, at = float(gaps.min()), piece[int(gaps.argmin())]
        text = ""
        if worst < least or worst == 0.0:
            room = f"{100.0 * worst:.0f} cm of room" if worst > 0.0 else "no room"
            text = (
                f"with the outline that it has now its route has {room} at {at[0]:.1f}, "
                f"{at[1]:.1f}: it goes round there if there is a way, else it stands"
            )
        _notice(loop, ROUTE, text)


def _notice(loop: Loop, name: str, text: str) -> None:
    """Told as long as it is so; empty: it is not any more."""
    loop.alarms.off(name)
    if text:
        loop.alarms.on(name, text, Severity.WARNING)
        loop.log.event(text)
