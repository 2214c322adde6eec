"""Parts shared by figures: the whole lab, one encounter from near, E_P, authority, texts."""

# pyright: reportUnknownMemberType=false
from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, MultipleLocator

from cohelm.core.types import X, Y
from cohelm.study import draw
from cohelm.study.controlled import RunResult
from cohelm.study.draw import CONE, INK, MOVER, PALE, PERSON, REFERENCE, ROBOT
from cohelm.study.metrics import spans


def whole_lab(axes: Axes, run: RunResult, width: float = 2.0) -> None:
    """Everything from above: lab, obstacles, path, the robot's outline every few seconds."""
    end = float(run.trace.rows["t"][-1])
    every = outline_every(run)
    draw.plan(axes, run)
    draw.doors(axes, run.setup.obstacles.walls)
    draw.obstacles(axes, run)
    draw.movers(axes, run, every)
    draw.driven(axes, run, ROBOT, width)
    for t in np.arange(0.0, end, every):
        draw.robot(axes, run, float(t))
    draw.clock(axes, run, [float(t) for t in np.arange(0.0, end, 2.0 * every)])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(11, steps=[1, 2, 5, 10]))


def outline_every(run: RunResult) -> float:
    """How often the robot's outline is drawn: a round time, some dozen times in a run [s]."""
    least = float(run.trace.rows["t"][-1]) / 15.0
    return next((t for t in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0) if t > least), least)


def close_up(axes: Axes, run: RunResult, names: tuple[str, ...]) -> None:
    """One meeting: the robot at its nearest moment to each disc, and how near that was."""
    draw.plan(axes, run)
    draw.driven(axes, run)
    draw.movers(axes, run, math.inf)
    draw.obstacles(axes, run, named=False)
    centre = np.zeros(2)
    for name in names:
        i = run.trace.names.index(name)
        met = run.metrics.discs[name]
        k = draw.step(run, met.at_s)
        disc, row = run.trace.discs[k, i], run.trace.rows[k]
        color = MOVER if draw.moves(run, i) else CONE
        draw.robot(axes, run, met.at_s, filled=True)
        draw.body(axes, disc, color)
        away = np.array([disc[X] - row["x"], disc[Y] - row["y"]])
        axes.plot([row["x"], disc[X]], [row["y"], disc[Y]], color=INK, lw=1.0, zorder=7)
        axes.plot([row["x"]], [row["y"]], "o", color=INK, ms=3, zorder=7)
        x, y = disc[[X, Y]] + 0.27 * away / np.hypot(*away)
        axes.text(
            x, y, f"{name}\nh {met.min_h:.2f} m²\n{met.at_s:.1f} s", color=color, fontsize=8.5,
            ha="right" if away[0] < -0.2 else "left" if away[0] > 0.2 else "center",
            va="center" if abs(away[0]) > 0.2 else "bottom", zorder=9,
        )  # fmt: skip
        centre += 0.5 * (disc[[X, Y]] + (row["x"], row["y"])) / len(names)
    sides = {_WORDS[run.metrics.discs[name].side] for name in names}
    axes.set_title(" and ".join(names) + ": " + ", ".join(sorted(sides)), fontsize=9.5, loc="left")
    axes.set_xlim(centre[0] - 1.5, centre[0] + 1.5)
    axes.set_ylim(centre[1] - 1.5, centre[1] + 1.5)
    axes.xaxis.set_major_locator(MultipleLocator(1.0))
    axes.yaxis.set_major_locator(MultipleLocator(1.0))
    axes.set_ylabel("")


_WORDS = {
    "left": "passed on the left",
    "right": "passed on the right",
    "through": "driven into",
    None: "not met",
}


def error(axes: Axes, run: RunResult, *, turns: bool = True) -> None:
    """E_P over time; where the reference turns sharply is shaded and labelled."""
    rows = run.trace.rows
    draw.in_time(axes, run, rows["e_p"], ROBOT)
    axes.set_ylabel("E_P [m, rad]")
    if not turns:
        return
    for a, b in spans(np.abs(rows["r_d"]) > 0.15):
        angle = math.degrees(float(rows["r_d"][a:b].sum()) * run.trace.dt)
        if abs(angle) < 45.0:
            continue
        start, end = float(rows["t"][a]), float(rows["t"][b - 1])
        peak = a + int(np.argmax(rows["e_p"][a:b]))
        axes.annotate(
            f"{rows['e_p'][peak]:.3f}", (rows["t"][peak], rows["e_p"][peak]), (0, 3),
            textcoords="offset points", ha="center", va="bottom", fontsize=8, color=ROBOT,
        )  # fmt: skip
        axes.axvspan(start, end, color=REFERENCE, alpha=0.18, lw=0)
        axes.text(
            0.5 * (start + end), 0.97, "right\nturn" if angle < 0.0 else "left\nturn",
            transform=axes.get_xaxis_transform(), ha="center", va="top", fontsize=8, color=PALE,
        )  # fmt: skip


def authority(axes: Axes, run: RunResult) -> None:
    """Automatic authority over time; what the person has of it is filled."""
    rows = run.trace.rows
    share = np.minimum(rows["authority_x"], rows["authority_psi"])
    draw.in_time(axes, run, share, ROBOT)
    axes.fill_between(rows["t"], share, 1.0, share < 1.0, color=PERSON, alpha=0.45, lw=0)
    axes.set_ylabel("$e^{-V_h}$")


def rounded_up(value: float) -> str:
    """Rounded up to three decimals, so that "below" stays true."""
    return f"{math.ceil(value * 1e3) / 1e3:.3f}"


def rounded_down(value: float) -> str:
    """Rounded down to three decimals, so that "at least" stays true."""
    return f"{math.floor(value * 1e3) / 1e3:.3f}"


def clear(run: RunResult) -> str:
    """How far the real outline stayed off everything."""
    m = run.metrics
    if math.isinf(m.min_clearance_m):
        return "with nothing to touch"
    return "IN CONTACT" if m.contact else f"{rounded_down(m.min_clearance_m)} m clear"


def counted(count: int, total: int) -> str:
    """All, or so many, of the obstacles."""
    return f"all {total} obstacles" if count == total else f"{count} of {total} obstacles"


def returned(times: list[float]) -> str:
    """When the person had let go, how long until the robot was back."""
    if not times or not all(math.isfinite(t) for t in times):
        return "the robot DOES NOT RETURN to its path" if times else "the robot drives alone"
    return f"back on the path {' and '.join(f'{t:.1f}' for t in times)} s after letting go"


def led(run: RunResult) -> str:
    """When the person led."""
    windows = run.metrics.human_windows_s
    if len(windows) > 3:
        return f"{len(windows)} times, {sum(b - a for a, b in windows):.1f} s in all"
    return " and ".join(f"{a:.1f}–{b:.1f} s" for a, b in windows) or "never"


def often(count: int) -> str:
    """How often, in words."""
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")


def passed(run: RunResult) -> str:
    """Which obstacles the robot kept its safe distance to."""
    hit = [name for name, disc in run.metrics.discs.items() if disc.min_h < 0.0]
    return f"all but {', '.join(hit)}" if hit else "every obstacle"


def returns(run: RunResult) -> bool:
    """Whether the robot came back on its path every time."""
    return all(math.isfinite(t) for t in run.metrics.return_s)
