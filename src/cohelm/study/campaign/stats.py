"""What many rows come to: shares with exact bounds, and the middle and the ends of the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import betaincinv

from cohelm.study.campaign.result import EpisodeResult
from cohelm.study.metrics import plain

_TAIL = 0.025  # of the probability, on either side of the bounds


@dataclass(frozen=True)
class Share:
    """How many of how many, with exact two-sided bounds on the probability behind it."""

    count: int
    of: int
    low: float
    high: float


def share(count: int, of: int) -> Share:
    """A share with its Clopper-Pearson bounds (1934): exact, whatever the numbers.

    The bounds are quantiles of beta distributions; with none counted the upper one is
    1 - 0.025^(1 / of). Of nothing, anything is possible.
    """
    if of == 0:
        return Share(0, 0, 0.0, 1.0)
    low = float(betaincinv(count, of - count + 1, _TAIL)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - _TAIL)) if count < of else 1.0
    return Share(count, of, low, high)


class Spread(NamedTuple):
    """Median, both ends and the number of values that were finite."""

    median: float
    least: float
    most: float
    of: int


def spread(values: Sequence[float]) -> Spread:
    """The spread of what is finite; NaN where nothing is."""
    finite = np.array([v for v in values if math.isfinite(v)])
    if not finite.size:
        return Spread(math.nan, math.nan, math.nan, 0)
    return Spread(float(np.median(finite)), float(finite.min()), float(finite.max()), len(finite))


SPREADS = (
    "min_clearance_m", "min_clearance_moving_m", "closest_mover_m", "near_movers_s", "duration_s",
    "time_ratio", "path_length_m", "tracking_rms", "human_share", "disagreement_mps",
    "jerk_rms_mps3", "recovery_s", "filtered_share", "gate_share", "monitor_share", "stops",
)  # fmt: skip
"""What is summarized over all episodes: columns of `EpisodeResult`."""


def _counts(row: EpisodeResult, name: str) -> bool:
    """Whether a value does: a duration until arrival, stops where there is a gate."""
    return {"duration_s": row.arrived, "stops": math.isfinite(row.gate_share)}.get(name, True)


class Summary(NamedTuple):
    """One law over one suite."""

    law: str
    episodes: int
    faults: int
    arrived: Share | None
    """None without goals."""
    success: Share | None
    """Of all, those that arrived and had no moving contact, and no fall."""
    moving: Share
    """Episodes with a contact in which the robot moved."""
    unseen: Share | None
    """Those of them whose first one was with something that no LiDAR had in view at that moment;
    None without a LiDAR, or where there is none."""
    late: Share | None
    """Those whose first one was with something that came into view too late to notice it and
    stop."""
    standing: Share
    """Episodes in which it was walked into."""
    departing: Share
    """Episodes in which it moved into what had walked into it."""
    touched: Share
    """Episodes with a contact of any kind."""
    touched_unseen: Share | None
    """Those of them whose first one, a moving one before a standing one, was with something out of
    view."""
    fell: Share | None
    """Episodes with a fall; None where there are no heights."""
    stuck: Share | None
    """Episodes that wanted to get somewhere and came to nothing: no fall, no contact, no arrival.
    Of heights only."""
    untouched_share: float
    """Of all steps of all episodes, those without a contact."""
    limit_excess: float
    score: float
    """Mean BARN score; NaN where there is none."""
    unrecovered: int
    spreads: dict[str, Spread]

    def as_dict(self) -> dict[str, Any]:
        """As plain values for JSON; what there is not is None."""
        least = {name: s.least for name, s in self.spreads.items()}
        return plain(
            {
                "law": self.law,
                "episodes": self.episodes,
                **_counted("arrived", self.arrived),
                **_counted("success", self.success),
                **_counted("contacts_moving", self.moving),
                "contacts_moving_unseen": self.unseen and self.unseen.count,
                "contacts_moving_late": self.late and self.late.count,
                **_counted("contacts_standing", self.standing),
                **_counted("contacts_departing", self.departing),
                **_counted("falls", self.fell),
                "stuck": self.stuck and self.stuck.count,
                **_counted("touched", self.touched),
                "touched_unseen": self.touched_unseen and self.touched_unseen.count,
                "untouched_share": self.untouched_share,
                "closest_m": least["min_clearance_m"],
                "min_clearance_m": least["min_clearance_m"],
                "min_clearance_moving_m": least["min_clearance_moving_m"],
                "score": self.score,
                "limit_excess": self.limit_excess,
                "faults": self.faults,
                "unrecovered": self.unrecovered,
                "medians": {name: s.median for name, s in self.spreads.items()},
            }
        )


def _counted(name: str, s: Share | None) -> dict[str, Any]:
    """A share's count and, beside it, its bounds; None where there is none."""
    if s is None:
        return {name: None, f"{name}_share": None}
    share = s.count / s.of if s.of else math.nan
    return {name: s.count, f"{name}_share": {"share": share, "low": s.low, "high": s.high}}


def _untouched(rows: Sequence[EpisodeResult]) -> float:
    """The share of steps without a contact, over episodes of any length."""
    measured = [row for row in rows if math.isfinite(row.untouched_share + row.duration_s)]
    whole = sum(row.duration_s for row in measured)
    return (
        sum(row.untouched_share * row.duration_s for row in measured) / whole if whole else math.nan
    )


def _succeeded(row: EpisodeResult) -> bool:
    return row.arrived and row.contacts_moving == 0 and row.falls == 0


def summary(law: str, rows: Sequence[EpisodeResult], *, goals: bool) -> Summary:
    """The rows of one law; those that could not be driven count as episodes and as not arrived.

    goals: whether the suite's episodes want to get anywhere.
    """
    sound = [row for row in rows if not row.fault]
    n, driven = len(rows), len(sound)  # of contacts, what was not driven says nothing
    uneven = any(row.suite == "heights" for row in rows)
    wanting = [row for row in sound if not row.no_goal]
    of = n - driven + len(wanting)  # what could not be driven did not arrive
    stuck = sum(
        not (row.arrived or row.falls or row.contacts_moving + row.contacts_standing)
        for row in wanting
    )
    touched = [row for row in sound if row.contacts_moving + row.contacts_standing > 0]
    known = [row for row in touched if math.isfinite(row.contact_seen_s)]  # when it was in view
    moved = [row for row in known if row.contacts_moving > 0]
    scored = any(math.isfinite(row.score) for row in sound)
    scores = [0.0 if row.fault else row.score for row in rows]
    return Summary(
        law=law,
        episodes=n,
        faults=n - driven,
        arrived=share(sum(row.arrived for row in sound), of) if goals else None,
        success=share(sum(_succeeded(row) for row in sound), of) if goals else None,
        moving=share(sum(row.contacts_moving > 0 for row in sound), driven),
        unseen=share(sum(row.contact_seen_s == 0.0 for row in moved), driven) if moved else None,
        late=share(sum(0.0 < row.contact_seen_s < row.contact_needed_s for row in moved), driven)
        if moved
        else None,
        standing=share(sum(row.contacts_standing > 0 for row in sound), driven),
        departing=share(sum(row.contacts_departing > 0 for row in sound), driven),
        touched=share(len(touched), driven),
        touched_unseen=share(sum(row.contact_seen_s == 0.0 for row in known), driven)
        if known
        else None,
        fell=share(sum(row.falls > 0 for row in sound), driven) if uneven else None,
        stuck=share(stuck, of) if uneven else None,
        untouched_share=_untouched(sound),
        limit_excess=max((row.limit_excess for row in sound), default=0.0),
        score=float(np.mean(scores)) if scored else math.nan,
        unrecovered=sum(row.unrecovered for row in sound),
        spreads={
            name: spread([getattr(row, name) for row in sound if _counts(row, name)])
            for name in SPREADS
        },
    )
