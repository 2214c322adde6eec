"""Tells the operator of a robot that follows its route and gets no farther.

It tries to get by for as long as it may, and nothing is wrong with it: only a person sees whether
what is in its way will go.
"""

from __future__ import annotations

from cohelm.link.messages import Mode, Severity, is_centred
from cohelm.loop.loop import Loop
from cohelm.pilot.pilot import Pilot

WITHIN = 20.0
"""Without another row of the route for so long it is told [s]."""
_ALARM = "progress"
_TEXT = (
    f"no farther on the route for {WITHIN:.0f} s: if its way is blocked, clear it, drive round by "
    "hand, or send another route"
)


class ProgressWatch:
    """Of one drive; `turn` is called between two periods and takes no time."""

    def __init__(self) -> None:
        self._pilot: Pilot | None = None
        self._row = 0
        self._since = 0.0

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        pilot, now = loop.driver.pilot, loop.gated.now()
        if pilot is None or not _follows(loop):
            self._pilot = None
        elif pilot is not self._pilot or pilot.state.row > self._row:
            self._pilot, self._row, self._since = pilot, pilot.state.row, now
        elif now - self._since > WITHIN:
            if loop.alarms.on(_ALARM, _TEXT, Severity.WARNING):
                loop.log.event(_TEXT)
            return
        loop.alarms.off(_ALARM)


def _follows(loop: Loop) -> bool:
    """Whether the controller alone leads the robot along its route."""
    supervisor, seen = loop.supervisor, loop.seen
    return (
        supervisor.may_drive
        and (supervisor.mode == Mode.AUTOMATIC or _released(loop))
        and not supervisor.docking.on
        and not supervisor.unfollowed
        and seen is not None
        and not seen.lost
        and not loop.driver.arrived
    )


def _released(loop: Loop) -> bool:
    """Whether it is shared, and the stick is released."""
    supervisor = loop.supervisor
    return supervisor.mode == Mode.SHARED and is_centred(supervisor.stick_state.deflection)
