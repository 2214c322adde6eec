"""The paper's figures 6-11, the sweep over k_CBF and the overview, from finished runs.

Figures are made object by object, without pyplot: no global state, no window, any thread.
"""

# pyright: reportUnknownMemberType=false
from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cohelm.core.types import Progress
from cohelm.study import draw, panels
from cohelm.study.controlled import RunResult
from cohelm.study.draw import CONE, DANGER, INK, MOVER, PALE, PERSON, REFERENCE, ROBOT, SHARED
from cohelm.study.experiments import SETTLED, Experiments
from cohelm.study.metrics import BACK_ON_PATH

PAPER_WINDOWS_S = ((2.5, 6.3), (43.2, 46.6))
"""When the paper's person led (its Fig. 11) [s]."""

_CLOSE_UPS = (("cone_2", "cone_1"), ("cone_3",), ("mover",))
"""What is looked at from near, in the order it is met."""


def draw_figures(ex: Experiments, folder: Path, progress: Progress) -> None:
    """Write every figure as PNG and SVG into a folder that exists."""
    makers = {
        "fig06_track_path": figure_6,
        "fig07_track_error": figure_7,
        "fig08_avoid_path": figure_8,
        "fig09_avoid_h": figure_9,
        "fig10_shared_path": figure_10,
        "fig11_shared_authority": figure_11,
        "k_cbf_sweep": figure_sweep,
        "overview": overview,
    }
    with draw.styled():
        for k, (name, maker) in enumerate(makers.items()):
            progress(f"figure {name}", k / len(makers))
            draw.save(maker(ex), folder, name)


def draw_run(run: RunResult, folder: Path, name: str) -> list[Path]:
    """Write the picture of any one run as PNG and SVG; the files written."""
    with draw.styled():
        return draw.save(figure_run(run), folder, name)


def figure_run(run: RunResult) -> Figure:
    """Any run: its path, and below E_P, the smallest h and who led."""
    m = run.metrics
    near = f"h ≥ {panels.rounded_down(m.min_h)} m²" if m.discs else "no obstacles"
    figure = draw.sheet(
        f"{near}, outline {panels.clear(run)}; "
        + f"{'ends' if m.reached else 'DOES NOT END'} where its reference ends",
        f"E_P at most {panels.rounded_up(m.max_pose_error)} and {m.final_pose_error:.3f} at the "
        f"end · the person leads {panels.led(run)} · outline every {panels.outline_every(run):g} s",
        8.4,
    )  # fmt: skip
    # The sheet is as high as the plan needs: laid out in inches, from the top.
    axes = figure.add_axes((0.07, 0.5, 0.91, 0.4))
    panels.whole_lab(axes, run)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    plan = min(9.1 * (high - low) / (right - left), 6.5)
    height = 0.95 + plan + 0.85 + 1.9 + 0.5
    figure.set_figheight(height)
    for text, below_top in zip(figure.texts, (0.14, 0.42), strict=True):
        text.set_y(1.0 - below_top / height)
    axes.set_position((0.07, (0.5 + 1.9 + 0.85) / height, 0.91, plan / height))
    draw.key(axes, *_lines(run))
    below = [
        figure.add_axes((0.075 + 0.325 * c, 0.5 / height, 0.255, 1.9 / height)) for c in range(3)
    ]
    panels.error(below[0], run, turns=False)
    below[0].set_ylim(bottom=0.0)
    if m.discs:
        draw.in_time(below[1], run, np.clip(run.trace.h.min(axis=1), -0.3, 3.0), ROBOT)
        below[1].set_ylim(-0.3 if m.min_h < -0.1 else -0.1, 1.2)
    below[1].axhline(0.0, color=DANGER, lw=0.8)
    below[1].set_ylabel("smallest h [m²]")
    panels.authority(below[2], run)
    below[2].set_ylim(0.0, 1.06)
    return figure


def figure_6(ex: Experiments) -> Figure:
    """Path, tracking alone."""
    run = ex.track
    m = run.metrics
    away = np.hypot(
        run.trace.rows["x"] - run.trace.rows["x_d"], run.trace.rows["y"] - run.trace.rows["y_d"]
    )
    figure = draw.sheet(
        f"Tracking alone: never more than {100 * away.max():.1f} cm beside the reference",
        f"Paper's Fig. 6 · tracking law (14)–(17), no barrier, {m.duration_s:.1f} s, "
        f"{m.path_length_m:.1f} m · robot outline every 5 s",
        5.6,
    )  # fmt: skip
    axes = figure.add_axes((0.06, 0.09, 0.92, 0.76))
    panels.whole_lab(axes, run, width=4.0)
    draw.key(axes, ("reference", REFERENCE, "--"), ("driven", ROBOT, "-"))
    return figure


def figure_7(ex: Experiments) -> Figure:
    """E_P, tracking alone; and after a sudden heading error."""
    m = ex.track.metrics
    figure = draw.sheet(
        f"Tracking alone: E_P stays below {panels.rounded_up(m.max_pose_error)}, "
        f"and ends at {m.final_pose_error:.4f}",
        "Paper's Fig. 7 · pose error E_P (51), position and heading together",
        4.2,
    )  # fmt: skip
    axes = figure.add_axes((0.075, 0.13, 0.56, 0.66))
    panels.error(axes, ex.track)
    axes.set_ylim(0.0, 0.036)
    axes.axhline(0.03, color=DANGER, lw=1.0, ls="--")
    axes.text(0.5, 0.0304, "paper: below 0.03 but for its jumps", color=DANGER, fontsize=8.5)

    axes = figure.add_axes((0.715, 0.13, 0.27, 0.66))
    run = ex.recovery
    axes.set_yscale("log")
    draw.in_time(axes, run, run.trace.rows["e_p"], ROBOT)
    axes.set_xlim(0.0, 15.0)
    axes.set_ylim(0.008, 4.0)
    axes.axhline(SETTLED, color=PALE, lw=0.8, ls="--")
    axes.set_title("after a sudden 90° heading error", fontsize=9.5, loc="left", color=INK)
    axes.text(
        0.98, 0.97, f"heading alone, k_ψ = {run.setup.gains.k_psi:g}/s:\n"
        f"{ex.least_settle_s:.1f} s", transform=axes.transAxes, ha="right", va="top",
        fontsize=8.5, color=PALE,
    )  # fmt: skip
    if math.isfinite(ex.settle_s):
        draw.annotate(
            axes, f"{SETTLED} after\n{ex.settle_s:.1f} s", (ex.settle_s, SETTLED), (-8, 42), ROBOT
        )
    axes.plot([2.0], [SETTLED], marker="v", color=DANGER, ms=7, clip_on=False)
    draw.annotate(axes, "paper: 2 s", (2.0, SETTLED), (4, -14), DANGER, left=True)
    return figure


def figure_8(ex: Experiments) -> Figure:
    """Path, tracking with the barrier."""
    m = ex.avoid.metrics
    return _path_figure(
        ex.avoid,
        f"The robot goes round {panels.passed(ex.avoid)}: h ≥ {panels.rounded_down(m.min_h)} m², "
        f"outline {panels.clear(ex.avoid)}",
        f"Paper's Fig. 8 · tracking with the barrier (33), k_CBF = {ex.avoid.setup.gains.k_cbf:g}",
    )


def figure_9(ex: Experiments) -> Figure:
    """Smallest h over time, with and without the barrier."""
    with_it, without = ex.avoid.metrics, ex.without.metrics
    through = sum(d.min_h < 0.0 for d in without.discs.values())
    figure = draw.sheet(
        f"With the barrier h never falls below {panels.rounded_down(with_it.min_h)} m²; "
        f"without it the robot drives into {panels.counted(through, len(without.discs))}",
        "Paper's Fig. 9 · smallest h_i, the denominator of the barrier (22): safe while above 0",
        4.4,
    )  # fmt: skip
    axes = figure.add_axes((0.075, 0.12, 0.91, 0.68))
    top = 1.0
    axes.set_ylim(-0.16, top)
    axes.axhspan(-0.16, 0.0, color=DANGER, alpha=0.12, lw=0)
    axes.axhline(0.0, color=DANGER, lw=1.0)
    axes.text(
        58.4, -0.075, "closer than the safe distance", color=DANGER, va="center", ha="right",
        fontsize=9,
    )  # fmt: skip
    for run, color in ((ex.without, DANGER), (ex.avoid, ROBOT)):
        draw.in_time(axes, run, np.minimum(run.trace.h.min(axis=1), 2.0 * top), color)
    for i, name in enumerate(ex.avoid.trace.names):
        run = ex.avoid
        k = int(np.argmin(run.trace.h[:, i]))
        h, t = float(run.trace.h[k, i]), float(run.trace.rows["t"][k])
        aside = {"cone_1": (78, 24), "cone_2": (100, 78)}.get(name, (70, 30))
        draw.annotate(axes, f"{name}: {h:.2f} m²", (t, h), aside, ROBOT)
    axes.set_ylabel("smallest h [m²]")
    draw.key(axes, ("with the barrier", ROBOT, "-"), ("without", DANGER, "-"))
    return figure


def figure_10(ex: Experiments) -> Figure:
    """Path with a simulated operator."""
    m = ex.shared.metrics
    back = "returns to the path" if panels.returns(ex.shared) else "DOES NOT RETURN to the path"
    return _path_figure(
        ex.shared,
        f"The person leads {panels.led(ex.shared)} (orange); afterwards the robot {back}",
        f"Paper's Fig. 10 · tracking, barrier and a simulated person · "
        f"smallest h {m.min_h:.2f} m², outline {panels.clear(ex.shared)}",
    )


def figure_11(ex: Experiments) -> Figure:
    """Automatic authority over time, and E_P below it."""
    run, m = ex.shared, ex.shared.metrics
    figure = draw.sheet(
        f"The person takes over {panels.often(len(m.human_windows_s))}; "
        + panels.returned(m.return_s),
        "Paper's Fig. 11 · automatic authority (48): 1 the robot alone, 0 the person alone",
        5.2,
    )  # fmt: skip
    axes = figure.add_axes((0.075, 0.46, 0.91, 0.40))
    panels.authority(axes, run)
    axes.set_ylim(-0.14, 1.08)
    axes.set_yticks([0.0, 0.5, 1.0])
    axes.set_xlabel("")
    axes.tick_params(labelbottom=False)
    for a, b in m.human_windows_s:
        axes.text(
            b + 0.5, 0.6, f"the person leads\n{a:.1f}–{b:.1f} s", fontsize=9.5, va="center",
            color="#8A5A00",
        )  # fmt: skip
    for a, b in PAPER_WINDOWS_S:
        axes.plot([a, b], [-0.08, -0.08], color=DANGER, lw=5, solid_capstyle="butt")
        axes.text(b + 0.5, -0.08, f"paper {a}–{b} s", fontsize=8.5, va="center", color=DANGER)

    below = figure.add_axes((0.075, 0.11, 0.91, 0.28))
    panels.error(below, run, turns=False)
    for a, b in m.human_windows_s:
        below.axvspan(a, b, color=PERSON, alpha=0.3, lw=0)
    below.axhline(BACK_ON_PATH, color=PALE, lw=0.8, ls="--")
    below.set_ylim(0.0, 1.15 * m.max_pose_error)
    for (_, b), after in zip(m.human_windows_s, m.return_s, strict=True):
        if math.isfinite(after):
            below.plot([b + after], [BACK_ON_PATH], "o", color=ROBOT, ms=5, zorder=6)
            draw.annotate(
                below, f"back after {after:.1f} s", (b + after, BACK_ON_PATH), (30, 30), ROBOT,
            )  # fmt: skip
    return figure


def figure_sweep(ex: Experiments) -> Figure:
    """What k_CBF does: how near, how fast, how long held up."""
    default = ex.avoid.setup.gains.k_cbf
    good = [k_cbf for k_cbf, m in ex.sweep.items() if m.min_h > 0.1]
    figure = draw.sheet(
        f"Below k_CBF = {min(good):g} the robot is held up, comes too near, and asks for speeds "
        "it can not have" if good else "No k_CBF keeps the robot clear",
        f"Tracking with the barrier over k_CBF, which the paper does not give (E3) · "
        f"default {default:g}",
        6.6,
    )  # fmt: skip
    k, found = list(ex.sweep), ex.sweep.values()
    panels = figure.subplots(3, 1, sharex=True)
    figure.subplots_adjust(0.09, 0.08, 0.86, 0.88, hspace=0.22)
    near, fast, held = panels
    ends: list[tuple[float, str, str]] = []
    for name, color in zip(ex.avoid.trace.names, (CONE, ROBOT, "#009E73", MOVER), strict=False):
        h = [m.discs[name].min_h for m in found]
        near.plot(k, h, "o-", color=color, lw=1.5, ms=4)
        ends.append((math.log(max(h[-1], 1e-6)), name, color))
    near.set_yscale("log")
    near.set_ylabel("smallest h [m²]")
    lowest = -math.inf
    for height, name, color in sorted(ends):  # labels at the line ends, pushed apart
        lowest = max(height, lowest + 0.75)
        near.text(k[-1] + 0.03, math.exp(lowest), name, color=color, va="center", fontsize=9.5)
    fast.plot(k, [m.max_speed_mps for m in found], "o-", color=DANGER, ms=4)
    fast.axhline(ex.wheels.speed, color=PALE, lw=0.8, ls="--")
    fast.text(k[-1] + 0.03, ex.wheels.speed, f"robot's limit\n{ex.wheels.speed:g} m/s",
              color=PALE, va="center", fontsize=9)  # fmt: skip
    fast.set_ylabel("largest |v| requested [m/s]")
    fast.set_ylim(bottom=0.0)
    held.plot(k, [m.longest_stall_s for m in found], "o-", color=PERSON, ms=4)
    held.set_ylabel("longest stall [s]")
    held.set_xlabel("k_CBF [rad/s]")
    for axes in panels:
        axes.axvline(default, color=ROBOT, lw=6, alpha=0.15)
    return figure


def overview(ex: Experiments) -> Figure:
    """The three experiments in one picture, with the number that judges each below."""
    figure = Figure(figsize=(10.0, 7.4))
    axes = figure.add_axes((0.02, 0.37, 0.96, 0.59))
    draw.plan(axes, ex.track, reference=False)
    draw.doors(axes, ex.track.setup.obstacles.walls)
    draw.driven(axes, ex.track, REFERENCE, 1.6)
    draw.driven(axes, ex.avoid, ROBOT, 2.4)
    draw.driven(axes, ex.shared, SHARED, 2.0, (0, (2.5, 2.0)))
    draw.obstacles(axes, ex.avoid)
    draw.movers(axes, ex.avoid, 10.0)
    for t in np.arange(0.0, float(ex.avoid.trace.rows["t"][-1]), 5.0):
        draw.robot(axes, ex.avoid, float(t))
    draw.key(
        axes, ("tracking alone", REFERENCE, "-"), ("with the barrier", ROBOT, "-"),
        ("with a person at the stick", SHARED, ":"), ("where the person leads", PERSON, "-"),
    )  # fmt: skip
    axes.set_axis_off()

    a = ex.avoid.metrics
    error, distance, authority = (
        figure.add_axes((0.075 + 0.325 * c, 0.07, 0.255, 0.2)) for c in range(3)
    )
    panels.error(error, ex.track)
    error.set_ylim(0.0, 0.036)
    _headed(
        error, "Tracking alone", f"E_P below {panels.rounded_up(ex.track.metrics.max_pose_error)}"
    )
    for run, color in ((ex.without, DANGER), (ex.avoid, ROBOT)):
        draw.in_time(distance, run, np.minimum(run.trace.h.min(axis=1), 3.0), color)
    distance.axhline(0.0, color=DANGER, lw=0.8)
    distance.set_ylim(-0.12, 1.2)
    distance.set_ylabel("smallest h [m²]")
    distance.text(9.5, 0.75, "with barrier", color=ROBOT, fontsize=9)
    distance.text(9.5, 0.5, "without", color=DANGER, fontsize=9)
    kept = f"h ≥ {panels.rounded_down(a.min_h)} m², outline {panels.clear(ex.avoid)}"
    _headed(distance, "With the barrier", kept)
    panels.authority(authority, ex.shared)
    authority.set_ylim(0.0, 1.06)
    _headed(authority, "A person helps", f"leads {panels.led(ex.shared)}")
    return figure


def _headed(axes: Axes, title: str, finding: str) -> None:
    axes.text(0.0, 1.22, title, transform=axes.transAxes, fontsize=11.5, weight="bold")
    axes.text(0.0, 1.07, finding, transform=axes.transAxes, fontsize=9, color=PALE)


def _lines(run: RunResult) -> list[tuple[str, str, str]]:
    """The entries of a key to its path."""
    led = [("the person leads", PERSON, "-")] if run.metrics.human_windows_s else []
    return [("reference", REFERENCE, "--"), ("driven", ROBOT, "-"), *led]


def _path_figure(run: RunResult, finding: str, about: str) -> Figure:
    """The whole lab, and below it what happened at each obstacle."""
    figure = draw.sheet(finding, about, 9.0)
    axes = figure.add_axes((0.06, 0.45, 0.92, 0.46))
    panels.whole_lab(axes, run)
    draw.key(axes, *_lines(run), ("moving obstacle", MOVER, "-"))
    for column, names in enumerate(_CLOSE_UPS):
        panels.close_up(figure.add_axes((0.06 + 0.325 * column, 0.06, 0.27, 0.32)), run, names)
    return figure
