"""What a record keeps of what the stations were told, so that a drive can be shown again.

Numbers of every period are in `core.period`; this is what changes now and then.
"""

from __future__ import annotations

from typing import NamedTuple

from cohelm.link.bulk_messages import Map, Polyline, ZoneMap
from cohelm.link.messages import Alarm, Discs, Mode


class StatusWords(NamedTuple):
    """Words beside the numbers of a period; kept where one of them changes."""

    driver: int
    """Client number; 0: nobody drives."""
    name: str
    """The driver's."""
    mode: Mode
    stopped: str
    """Why it is stopped; empty: it is not."""
    why: str
    """Why applied differs from nominal; empty where it does not."""
    cap: float
    """On the speed [m/s]; infinite where there is none."""
    cap_reason: str
    alarms: tuple[Alarm, ...]
    """The worst first."""


class Displayed(NamedTuple):
    """Something on the map, or words, since a time."""

    stamp: float
    """The robot's clock [s]."""
    what: StatusWords | Map | ZoneMap | Polyline | Discs
