"""What a campaign came to: tables for the terminal, one JSON object, one self-contained page."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from cohelm.core.files import json_text
from cohelm.core.types import Progress
from cohelm.sim.judge import FAR
from cohelm.study.campaign.about import about, html
from cohelm.study.campaign.replay_episode import drive
from cohelm.study.campaign.result import FAILS, EpisodeResult, clearance_then, fault_of
from cohelm.study.campaign.stats import Share, Spread, Summary, summary
from cohelm.study.campaign.store import ROWS, put
from cohelm.study.campaign.suites import Suite

PAGE_NAME, SUMMARY = "report.html", "summary.json"

_PICTURES = 6
"""Episodes shown of the first law; of each other law a third of it."""


class Outcome(NamedTuple):
    """A whole campaign."""

    suite: Suite
    laws: tuple[str, ...]
    rows: dict[str, list[EpisodeResult]]
    """By law, in order of their numbers."""
    summaries: list[Summary]
    origin: dict[str, Any]
    """By which code it was driven, and since when: `store.origin`."""

    def as_dict(self) -> dict[str, Any]:
        """One object: the first law's numbers, and all laws under `compare` if there are more."""
        first = self.summaries[0].as_dict()
        made: dict[str, Any] = {
            "suite": self.suite.name, "plant": self.suite.plant,
            "robot": self.suite.robot and self.suite.robot.name, "seed": self.suite.seed,
            **self.origin, **first,
        }  # fmt: skip
        if len(self.laws) > 1:
            made["compare"] = [s.as_dict() for s in self.summaries]
        made["left_out"] = list(self.suite.notes)
        return made


def outcome(
    made: Suite, laws: Sequence[str], rows: Sequence[EpisodeResult], origin: dict[str, Any]
) -> Outcome:
    """All rows of a campaign, counted."""
    by_law = {law: [row for row in rows if row.law == law] for law in laws}
    summaries = [summary(law, by_law[law], goals=made.goals) for law in laws]
    return Outcome(made, tuple(laws), by_law, summaries, origin)


def worst(rows: Sequence[EpisodeResult], count: int) -> list[EpisodeResult]:
    """The worst episodes: faults, then contacts, the deepest first, non-arrivals, near misses."""

    def badness(row: EpisodeResult) -> tuple[bool, bool, bool, bool, float]:
        clearance = row.min_clearance_moving_m
        missed = not row.arrived and math.isfinite(row.tracking_rms)
        return (
            not row.fault,
            row.falls == 0,
            row.contacts_moving == 0,
            not missed,
            clearance if math.isfinite(clearance) else math.inf,
        )

    return sorted(rows, key=badness)[:count]


# ---------------------------------------------------------------------------- tables


def table(found: Outcome) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows: one column for each law."""
    lines: list[tuple[str, Callable[[Summary], str]]] = [
        ("episodes", lambda s: f"{s.episodes}" + (f" ({s.faults} failed)" if s.faults else "")),
        ("arrived without a moving contact", lambda s: _share(s.success)),
        ("arrived", lambda s: _share(s.arrived)),
        ("fallen", lambda s: _share(s.fell)),
        ("stuck: no fall, no contact, not arrived", lambda s: _share(s.stuck)),
        ("with a moving contact", lambda s: _share(s.moving)),
        ("... with what was out of view at that moment", lambda s: _share(s.unseen)),
        ("... with what came into view too late to stop", lambda s: _share(s.late)),
        ("with a standing contact: walked into", lambda s: _share(s.standing)),
        ("with a departing contact: moved on into it", lambda s: _share(s.departing)),
        ("touched, of any kind", lambda s: _share(s.touched)),
        ("... first by what was out of view at that moment", lambda s: _share(s.touched_unseen)),
        ("share of steps untouched", lambda s: _number(s.untouched_share, 5)),
        ("smallest clearance while moving [m]", lambda s: _least(s.spreads, "moving_")),
        ("closest: smallest clearance of all [m]", lambda s: _least(s.spreads, "")),
        ("closest to a mover [m]", lambda s: _spread(s.spreads["closest_mover_m"], 2)),
        ("within 0.45 m of a mover [s]", lambda s: _spread(s.spreads["near_movers_s"], 1)),
        ("limits exceeded by, in SI", lambda s: f"{s.limit_excess:g}"),
        ("BARN score (0.5 at most)", lambda s: _number(s.score, 4)),
        ("time to arrive [s]", lambda s: _spread(s.spreads["duration_s"], 1)),
        ("time ratio to the reference", lambda s: _spread(s.spreads["time_ratio"], 2)),
        ("path length [m]", lambda s: _spread(s.spreads["path_length_m"], 1)),
        ("tracking error, rms of E_P", lambda s: _spread(s.spreads["tracking_rms"], 3)),
        ("authority of the operator", lambda s: _spread(s.spreads["human_share"], 2)),
        ("operator against command [m/s]", lambda s: _spread(s.spreads["disagreement_mps"], 2)),
        ("jerk, rms [m/s³]", lambda s: _spread(s.spreads["jerk_rms_mps3"], 1)),
        ("release to recovery [s]", lambda s: _recovery(s)),
        ("share of steps the filter changed", lambda s: _spread(s.spreads["filtered_share"], 2)),
        ("... the gate changed", lambda s: _spread(s.spreads["gate_share"], 4)),
        ("... a monitor slowed the robot in", lambda s: _spread(s.spreads["monitor_share"], 4)),
        ("stops and faults latched", lambda s: _spread(s.spreads["stops"], 0)),
    ]
    shown = [
        (name, *(cell(s) for s in found.summaries))
        for name, cell in lines
        if any(cell(s) != "–" for s in found.summaries)
    ]
    return ("quantity", *found.laws), shown


def made_on(found: Outcome) -> str:
    """The suite, and on what and by which robot it was driven where that is not the usual."""
    suite = found.suite
    plant = "" if suite.plant == "kinematic" else f", {suite.plant}"
    return f"{suite.name}{plant}" + ("" if suite.robot is None else f", by {suite.robot.name}")


def driven_by(found: Outcome) -> str:
    """By which code, and since when, as a sentence; empty where that is not known."""
    if not found.origin:
        return ""
    commit = found.origin["commit"]
    code = f"code {found.origin['code']}" + (f", commit {commit}" if commit else "")
    own = "".join(f"; {law}: code {digest}" for law, digest in found.origin["own"].items())
    return f"Begun at {found.origin['began']} with cohelm {found.origin['version']} ({code}){own}."


def by_kind(found: Outcome) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The first law's episodes by their kind."""
    rows = found.rows[found.laws[0]]
    kinds = sorted({row.kind for row in rows})
    lines: list[tuple[str, ...]] = []
    for kind in kinds:
        s = summary("", [row for row in rows if row.kind == kind], goals=found.suite.goals)
        arrived = "–" if s.arrived is None else str(s.arrived.count)
        clearance = _least(s.spreads, "moving_")
        lines.append(
            (kind or "not driven", str(s.episodes), arrived, str(s.touched.of - s.touched.count),
             str(s.moving.count), str(s.standing.count), clearance)
        )  # fmt: skip
    headings = (
        "kind",
        "episodes",
        "arrived",
        "untouched",
        "moving contacts",
        "standing contacts",
        "least clearance, moving [m]",
    )
    return headings, lines


def _share(s: Share | None) -> str:
    if s is None:
        return "–"
    return f"{s.count} of {s.of} ({100 * s.low:.2f}–{100 * s.high:.2f} %)"


def _spread(s: Spread, digits: int) -> str:
    if s.of == 0:
        return "–"
    return f"{s.median:.{digits}f} ({s.least:.{digits}f} to {s.most:.{digits}f})"


def _least(spreads: dict[str, Spread], kind: str) -> str:
    least = spreads[f"min_clearance_{kind}m"].least
    return f"{FAR:g} or more" if least >= FAR else _number(least, 4)


def _recovery(s: Summary) -> str:
    spread = _spread(s.spreads["recovery_s"], 1)
    return f"{spread}, {s.unrecovered} never" if s.unrecovered else spread


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


# ------------------------------------------------------------------------------ page


_FIGURES = """<h2>Worst episodes</h2>
<p>From above, and the outline's clearance and the speed over time. A <em>moving</em> contact is
one in which the robot drove; in a <em>standing</em> one it stood and was walked into. Each
episode can be driven again alone and recorded: <code>cohelm campaign FOLDER --replay
LAW/NUMBER</code>.</p>
<div class="figures">
{}
</div>"""


def written(folder: Path) -> Path | None:
    """The page of a folder whose rows are those it was made of; None where one is newer."""
    try:
        made = min((folder / name).stat().st_mtime for name in (SUMMARY, PAGE_NAME))
        rows = max(part.stat().st_mtime for part in (folder / ROWS).iterdir())
    except (OSError, ValueError):
        return None
    return folder / PAGE_NAME if made >= rows else None


def write(found: Outcome, folder: Path, progress: Progress) -> Path:
    """Leave summary.json and report.html, with pictures of the worst episodes, in a folder.

    Raises CohelmError where that can not be written; one that was there stays whole.
    """
    shown = [
        (law, row)
        for i, law in enumerate(found.laws)
        for row in worst(found.rows[law], _PICTURES if i == 0 else _PICTURES // 3)
        if not row.fault
    ]
    figures: list[str] = []
    for k, (law, row) in enumerate(shown):
        progress(f"drawing the worst episodes: {law}/{row.episode}", k / len(shown))
        figures.append(_figure(found.suite, row))
    template = Template(
        (files("cohelm.study.campaign") / "report.html").read_text(encoding="utf-8")
    )
    page = template.substitute(
        title=escape(f"cohelm campaign: {made_on(found)}, seed {found.suite.seed}"),
        origin=escape(driven_by(found)),
        about=html(about(found.suite.name, found.laws, found.suite.robot)),
        laws=_html(*table(found)),
        kinds=_html(*by_kind(found)),
        first=escape(found.laws[0]),
        figures=_FIGURES.format("\n".join(figures)) if figures else "",
        notes=_list("Left out", found.suite.notes)
        + _list("Not driven: a mistake in your law, or in cohelm: please report it", faults(found)),
    )  # fmt: skip
    for name, whole in ((SUMMARY, json_text(found.as_dict())), (PAGE_NAME, page)):
        put(folder / name, whole.encode())
    return folder / PAGE_NAME


def _figure(made: Suite, row: EpisodeResult) -> str:
    from cohelm.study.campaign.pictures import picture  # matplotlib takes a second to import

    text = caption(row)
    try:
        again = drive(made.case(row.episode), row)
    except FAILS as error:  # of a law of the user's own
        text += f"; driven again for this picture it failed: {fault_of(error)}"
        return f"<figure><figcaption>{escape(text)}</figcaption></figure>"
    png = base64.b64encode(picture(again.case, again.trace, row)).decode()
    if not again.same:
        text += "; driven again for this picture it came out otherwise"
    return (
        f'<figure><img alt="{escape(text)}" src="data:image/png;base64,{png}">'
        f"<figcaption>{escape(text)}</figcaption></figure>"
    )


def caption(row: EpisodeResult) -> str:
    """The outcome of an episode, for the picture's caption."""
    contacts = [
        f"{count} {name} contact{'s' if count > 1 else ''}"
        for name, count in (("moving", row.contacts_moving), ("standing", row.contacts_standing))
        if count
    ]
    text = [", ".join(contacts) or "no contact"]
    if not math.isnan(row.tracking_rms):
        text.append("arrived" if row.arrived else "not arrived")
    text.append(f"{row.duration_s:.1f} s")
    least = f"least clearance {'while moving ' if row.min_clearance_moving_m < FAR else ''}"
    least += f"{clearance_then(row):.4f} m"
    at = f" at {row.min_clearance_at_s:.1f} s" + (f" ({row.nearest})" if row.nearest else "")
    kind = f" ({row.kind})" if row.kind else ""
    return f"{row.law}/{row.episode}{kind}: {', '.join(text)}; {least}{at}"


def _html(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(h)}</th>" for h in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def faults(found: Outcome) -> tuple[str, ...]:
    """Episodes that could not be driven, and why."""
    return tuple(
        f"{law}/{row.episode}: {row.fault}"
        for law in found.laws
        for row in found.rows[law]
        if row.fault
    )


def _list(title: str, text: Sequence[str]) -> str:
    if not text:
        return ""
    items = "".join(f"<li>{escape(one)}</li>" for one in text)
    return f"<details><summary>{escape(title)} ({len(text)})</summary><ul>{items}</ul></details>"
