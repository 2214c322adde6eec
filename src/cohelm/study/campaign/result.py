"""One row per episode: what is counted, in which unit. A table of rows is a campaign."""

from __future__ import annotations

import math
import textwrap
import traceback
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from cohelm.core.errors import CohelmError
from cohelm.core.others_code import others_frames
from cohelm.sim.judge import FAR


class EpisodeResult(NamedTuple):
    """What came of one episode under one law; NaN where there is nothing to measure."""

    suite: str
    plant: str
    """What was driven, see `episode.PLANTS`."""
    law: str
    episode: int
    kind: str
    fault: str
    """What went wrong in a law, or in our own code, if anything did; the numbers are then worth
    nothing."""
    arrived: bool
    duration_s: float
    """Until arrival, or the whole."""
    contacts_moving: int
    """Contacts that began while the robot moved of its own."""
    contacts_standing: int
    """Contacts that began while it stood: it was walked into."""
    contacts_departing: int
    """Those of them in which it then moved deeper into what had walked into it."""
    falls: int
    """Of `heights`: 1 where a wheel had no floor under it; the episode ends with that, or with the
    first contact."""
    no_goal: bool
    """Whether the episode has no goal."""
    untouched_share: float
    """Of all control steps, those in which nothing was touched."""
    min_clearance_m: float
    """Smallest clearance of the real outline, negative in overlap; at most `sim.judge.FAR`."""
    min_clearance_moving_m: float
    """The same while the robot moved, but for what had walked into it while it stood."""
    min_clearance_at_s: float
    """When it was smallest while the robot moved; at all, where nothing was near then."""
    closest_mover_m: float
    """Smallest clearance to anything that ever moves; at most `sim.judge.FAR`, NaN without
    movers."""
    near_movers_s: float
    """How long that gap was below `scoring.INTIMATE`, 0.45 m."""
    nearest: str
    """What was near then: a disc's name, or "wall"; empty where nothing came near."""
    limit_excess: float
    """Most by which a limit of speed, yaw rate, wheels or acceleration was exceeded."""
    score: float
    """The BARN challenge's, where the episode has an optimal time."""
    time_ratio: float
    """Duration by the reference's own, of those that arrived."""
    path_length_m: float
    tracking_rms: float
    """Of E_P (51), to the reference as it is at that moment [m, rad]."""
    human_share: float
    """Mean authority of the operator, in [0, 1]."""
    disagreement_mps: float
    """Mean distance of the wheels' motion from the operator's command, while there is one:
    sqrt(dv^2 + (0.5 m domega)^2)."""
    jerk_rms_mps3: float
    """Of the speed the wheels were given, by second differences."""
    recovery_s: float
    """Mean time from a release of the stick until E_P is below 0.03 again."""
    unrecovered: int
    """Releases after which it never was, though the operator did not lead again and the robot did
    not arrive."""
    filtered_share: float
    """Of all steps, those in which the law's filter changed the command; NaN of laws by others,
    which do not say."""
    gate_share: float
    """Those in which the gate did; NaN where there is none, as everywhere but on the twin."""
    monitor_share: float
    """Those in which the collision or the plausibility monitor slowed or stopped the robot."""
    stops: int
    """Stops and faults that the robot latched by itself; each is reset a second later."""
    stopped_by: str
    """Why, the first time."""
    contact_seen_s: float
    """Of the first contact on the twin's own sensors, a moving one before a standing one: for how
    long what was touched had been in the LiDAR's view without a break, at five beams a scan, when
    it came to it; NaN: none."""
    contact_needed_s: float
    """How long the robot takes at most to notice what comes into view, and to stop, as fast as it
    was when that did."""
    contact_seen_share: float
    """In which share of all scans before it had been in view."""
    contact_speed_mps: float
    """How fast that was itself going a control period before."""
    contact_driven_mps: float
    """And how fast the nearest corner or side of the robot at most."""
    stick: list[float]
    """The deflections that a search has found, fore-aft and left-right in turns, or nothing."""


def clearance_then(row: EpisodeResult) -> float:
    """The clearance at `min_clearance_at_s` [m]."""
    moving = row.min_clearance_moving_m
    return moving if moving < FAR else row.min_clearance_m


_NOTHING: dict[Any, Any] = {str: "", bool: False, int: 0, float: math.nan, list[float]: []}
NOT_DRIVEN = EpisodeResult(
    **{name: _NOTHING[kind] for name, kind in get_type_hints(EpisodeResult).items()}
)
"""What remains of an episode that could not be driven."""

FAILS = (Exception, SystemExit)
"""What a law may raise: one that calls sys.exit has failed, and no more."""
_PLACES, _TEXT = 6, 400
"""So many lines are named, and letters of an error cited, at most."""


def fault_of(error: BaseException) -> str:
    """What went wrong, for a row: a sentence of ours as it is, else the error and the lines that it
    came through, of others' code if there is any. Of many the first, which are the law's own, and
    the last; numba's errors alone have a hundred."""
    if isinstance(error, CohelmError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    others = others_frames(frames) or frames[-1:]
    places = [f"{Path(one.filename).name}:{one.lineno}" for one in others]
    if len(places) > _PLACES:
        places[_PLACES - 1 : -1] = ["..."]
    clean = "".join(c if c.isprintable() else " " for c in str(error))
    text = textwrap.shorten(clean, _TEXT, placeholder=" ...")
    return f"{type(error).__name__}: {text} ({', '.join(places)})"
