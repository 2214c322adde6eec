"""Warns where a robot with a changed outline no longer fits: at docks, and on its route.

The filter stops it there in any case; the operator should know before it drives there.
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
"""Spacing of the poses of the route that are checked against the map [m]."""
_PIECE = 40
"""Poses checked in one period: the check must not delay it."""
DOCKS, ROUTE = "docks", "route"
"""Names of the alarms."""


class OutlineCheck:
    """The check of one drive on a map; `turn` is called between two periods and is short."""

    def __init__(self, loop: Loop, known: LocalizationMap) -> None:
        """The first outline is not checked: docks were, and the operator chose the route."""
        self._surfaces, self._resolution = occupied(known), known.resolution
        self._outline = loop.outline
        self._check: Iterator[None] | None = None

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        if loop.outline is not self._outline:
            self._outline = loop.outline
            self._check = self._check_all(loop, np.array(loop.outline))
        if self._check is not None and next(self._check, self) is self:
            self._check = None

    def _check_all(self, loop: Loop, outline: Floats) -> Iterator[None]:
        """Check docks and route, a piece at a time."""
        docking, surfaces = loop.supervisor.docking, self._surfaces
        unfit: dict[int, str] = {}
        for number, dock in enumerate(docking.docks, 1):
            yield
            if why := no_room(dock, outline, surfaces, self._resolution):
                unfit[number] = f"with its present outline, {why}"
        docking.unfit = unfit
        text = "; ".join(f"{docking.docks[i - 1].name}: {why}" for i, why in unfit.items())
        _notice(loop, DOCKS, text and f"no docking at {text}")
        pilot = loop.driver.pilot
        if pilot is None:
            return
        least = loop.driver.settings.rules.hard_margin - OFF * self._resolution
        route = pilot.planner.route  # not the present detour
        poses = poses_along(route.reference, _SPACING)
        done = float(route.times[pilot.state.row]) / route.reference.duration
        poses = poses[min(int(done * len(poses)), len(poses) - 1) :]
        worst, at = math.inf, poses[0]
        for piece in np.array_split(poses, math.ceil(len(poses) / _PIECE)):
            yield
            gaps = swept_clearances(surfaces, outline, piece)
            if float(gaps.min()) < worst:
                worst, at = float(gaps.min()), piece[int(gaps.argmin())]
        text = ""
        if worst < least or worst == 0.0:
            room = f"{100.0 * worst:.0f} cm of clearance" if worst > 0.0 else "no clearance"
            text = (
                f"with its present outline the route has {room} at {at[0]:.1f}, "
                f"{at[1]:.1f}: it takes a detour if there is one, else it stops"
            )
        _notice(loop, ROUTE, text)


def _notice(loop: Loop, name: str, text: str) -> None:
    """Raise or clear an alarm; empty text: clear."""
    loop.alarms.off(name)
    if text:
        loop.alarms.on(name, text, Severity.WARNING)
        loop.log.event(text)
