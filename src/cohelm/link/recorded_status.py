"""What a record keeps of the stations' display, for playback.

Numbers of every period are in `core.row`; these change now and then.
"""

from __future__ import annotations

from typing import NamedTuple

from cohelm.link.bulk_messages import Map, Polyline, ZoneMap
from cohelm.link.messages import Alarm, Discs, Mode


class StatusWords(NamedTuple):
    """The texts of a status; recorded where one of them changes."""

    driver: int
    """Client number; 0: nobody drives."""
    driver_name: str
    mode: Mode
    stopped: str
    """Why it is stopped; empty: it is not."""
    why: str
    """Why applied differs from nominal; empty where it does not."""
    speed_cap: float
    """[m/s]; infinite where there is none."""
    cap_reason: str
    alarms: tuple[Alarm, ...]
    """The worst first."""


class Displayed(NamedTuple):
    """Something displayed since a time."""

    stamp: float
    """The robot's clock [s]."""
    what: StatusWords | Map | ZoneMap | Polyline | Discs
