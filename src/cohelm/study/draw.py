"""Parts of figures: the lab from above, lines in time, files."""

# matplotlib's methods take untyped **kwargs; everything of ours is still checked.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Polygon

from cohelm.core.frames import placed
from cohelm.core.types import RADIUS, SAFE, VX, VY, Floats, Pose, X, Y
from cohelm.study.controlled import RunResult
from cohelm.study.metrics import leads, spans

# Okabe and Ito's colours, distinct with any kind of colour vision.
ROBOT = "#0072B2"
SHARED = "#009E73"
PERSON = "#E69F00"
DANGER = "#D55E00"
MOVER = "#AA4499"
CONE = "#333333"
REFERENCE = "#777777"
WALL = "#222222"
INK = "#222222"
PALE = "#6B6B6B"

_STYLE: dict[str, Any] = {
    "font.size": 10.0,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": PALE,
    "ytick.color": PALE,
    "text.color": INK,
    "lines.solid_capstyle": "round",
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "cohelm",  # the same ids, and so the same bytes, every time
    "path.simplify_threshold": 0.3,
}

_EVERY = 4
"""One step in so many is drawn: 0.04 s, or 2 cm of path."""

_NAMED = 12
"""More obstacles than this are not named one by one."""

PAPER: dict[str, Any] = {"fc": "white", "ec": "none", "pad": 0.8, "alpha": 0.8}
"""Behind labels that lie on lines."""


def styled() -> AbstractContextManager[None]:
    """Within this, figures are made and written in our style; outside nothing has changed."""
    chosen: Any = matplotlib
    return chosen.rc_context(_STYLE)


def sheet(finding: str, about: str, height: float) -> Figure:
    """An empty figure with a title and, as subtitle, what was run."""
    figure = Figure(figsize=(10.0, height))
    figure.text(0.02, 1.0 - 0.14 / height, finding, fontsize=13, weight="bold", va="top")
    figure.text(0.02, 1.0 - 0.42 / height, about, fontsize=9.5, color=PALE, va="top")
    return figure


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG (150 dpi) and SVG; the same figure gives the same bytes."""
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    figure.savefig(png, dpi=150, metadata={"Software": None})
    figure.savefig(svg, metadata={"Date": None, "Creator": None})
    return [png, svg]


def step(run: RunResult, t: float) -> int:
    """The step at time t [s], or the nearest there is."""
    return min(max(round(t / run.trace.dt), 0), len(run.trace) - 1)


def moves(run: RunResult, i: int) -> bool:
    """Whether disc i ever moves."""
    return bool(np.ptp(run.trace.discs[:, i, :2], axis=0).max() > 1e-6)


def plan(axes: Axes, run: RunResult, *, reference: bool = True) -> None:
    """The lab from above: walls with their doors, and the reference."""
    for x1, y1, x2, y2 in run.setup.obstacles.walls:
        axes.plot([x1, x2], [y1, y2], color=WALL, lw=2.2, zorder=2)
    if reference:
        rows = run.trace.rows[::_EVERY]
        axes.plot(rows["x_d"], rows["y_d"], color=REFERENCE, lw=1.3, ls=(0, (4, 3)), zorder=5.2)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def doors(axes: Axes, walls: Floats) -> None:
    """Mark the doors: gaps about a person wide in the walls along x."""
    along = walls[walls[:, 1] == walls[:, 3]]
    for y in np.unique(along[:, 1]):
        spans = np.sort(along[along[:, 1] == y][:, [0, 2]], axis=1)
        spans = spans[np.argsort(spans[:, 0])]
        ends = np.maximum.accumulate(spans[:, 1])[:-1]
        for left, right in zip(ends, spans[1:, 0], strict=True):
            if 0.6 < right - left < 1.5:
                axes.text(
                    right + 0.1, y + 0.25, f"door {right - left:.1f} m", fontsize=8, color=PALE,
                    va="center", zorder=8,
                )  # fmt: skip


def obstacles(axes: Axes, run: RunResult, *, named: bool = True) -> None:
    """Resting discs in their real size, each within its dashed safe distance r_i."""
    named = named and len(run.trace.names) <= _NAMED
    for i, name in enumerate(run.trace.names):
        if moves(run, i):
            continue
        disc = run.trace.discs[0, i]
        body(axes, disc, CONE)
        if named:  # on the left of the reference, beyond the wall
            rows = run.trace.rows
            k = int(np.argmin(np.hypot(rows["x_d"] - disc[X], rows["y_d"] - disc[Y])))
            left = rows["psi_d"][k] + 0.5 * math.pi
            x, y = disc[X] + 1.2 * math.cos(left), disc[Y] + 1.2 * math.sin(left)
            axes.plot([disc[X], x], [disc[Y], y], color=CONE, lw=0.6, zorder=5)
            axes.text(
                x, y, f"{name} ", fontsize=9, zorder=9,
                ha="right" if math.cos(left) < -0.5 else "center",
                va="bottom" if math.sin(left) > 0.5 else "center",
            )  # fmt: skip


def body(axes: Axes, disc: Floats, color: str, alpha: float = 1.0) -> None:
    """One disc: the body filled, its safe distance r_i dashed."""
    at = (disc[X], disc[Y])
    axes.add_patch(Circle(at, disc[RADIUS], fc=color, ec="none", alpha=alpha, zorder=6))
    axes.add_patch(
        Circle(at, disc[SAFE], fc="none", ec=color, ls=(0, (2, 1.5)), lw=0.9, alpha=alpha, zorder=6)
    )


def movers(axes: Axes, run: RunResult, every: float) -> None:
    """Each moving disc's path with an arrow, and the disc where it is every so many seconds."""
    for i, name in enumerate(run.trace.names):
        if not moves(run, i):
            continue
        track = run.trace.discs[:, i]
        axes.plot(track[::_EVERY, X], track[::_EVERY, Y], color=MOVER, lw=1.2, zorder=4)
        _arrow(axes, track[::_EVERY, X], track[::_EVERY, Y])
        if math.isinf(every):
            continue
        axes.text(
            track[0, X] - 0.3, track[0, Y], name, color=MOVER, ha="right", va="center", fontsize=9
        )
        going = np.flatnonzero(np.hypot(track[:, VX], track[:, VY]) > 0.0) * run.trace.dt
        for t in np.arange(math.ceil(going[0] / every) * every, going[-1] - 0.8 * every, every):
            disc: Floats = track[step(run, t)]
            body(axes, disc, MOVER, 0.45)
            axes.annotate(
                f"{t:.0f} s", (disc[X], disc[Y]), (6, -13), textcoords="offset points",
                color=MOVER, fontsize=7.5, ha="center", va="center", bbox=PAPER, zorder=8,
            )  # fmt: skip


def _arrow(axes: Axes, x: Floats, y: Floats) -> None:
    """An arrow head on a mover's path, at 15 % of its length."""
    length: Floats = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    k = int((length < 0.15 * length[-1]).sum())
    j = min(int((length < length[k] + 0.05).sum()), len(x) - 1)
    tail, head = (float(x[k]), float(y[k])), (float(x[j]), float(y[j]))
    axes.add_patch(
        FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=13, color=MOVER, zorder=7)
    )


def driven(
    axes: Axes, run: RunResult, color: str = ROBOT, width: float = 2.0, style: Any = "-"
) -> None:
    """The path of the robot's centre, orange and wide where the person leads."""
    rows = run.trace.rows
    axes.plot(rows["x"][::_EVERY], rows["y"][::_EVERY], color=color, lw=width, ls=style, zorder=5)
    for a, b in spans(leads(rows)):
        axes.plot(rows["x"][a:b:_EVERY], rows["y"][a:b:_EVERY], color=PERSON, lw=5.0, zorder=5.5)


def robot(
    axes: Axes, run: RunResult, t: float, color: str = ROBOT, *, filled: bool = False
) -> None:
    """The robot's real outline at time t, with a line to its nose."""
    row = run.trace.rows[step(run, t)]
    pose = Pose(row["x"], row["y"], row["psi"])
    corners = placed(run.setup.outline, pose)
    axes.add_patch(Polygon(corners, fc=color, ec="none", alpha=0.3 if filled else 0.08, zorder=4))
    axes.add_patch(Polygon(corners, fc="none", ec=color, lw=0.8, alpha=0.9, zorder=4.5))
    nose = placed(np.array([[0.0, 0.0], [run.setup.outline[:, 0].max(), 0.0]]), pose)
    axes.plot(*nose.T, color=color, lw=0.8, alpha=0.9, zorder=4.5)


def clock(axes: Axes, run: RunResult, times: Sequence[float]) -> None:
    """Times along the robot's path, on its left-hand side."""
    away = 0.2 + run.setup.reach
    for t in times:
        row = run.trace.rows[step(run, t)]
        left = row["psi_d"] + 0.5 * math.pi
        axes.text(
            row["x"] + away * math.cos(left), row["y"] + 0.9 * away * math.sin(left),
            f"{t:.0f} s", ha="center", va="center", fontsize=7.5, color=PALE, bbox=PAPER, zorder=8,
        )  # fmt: skip


def in_time(axes: Axes, run: RunResult, values: Floats, color: str) -> None:
    """A line over the run's time [s]."""
    axes.plot(run.trace.rows["t"][::_EVERY], values[::_EVERY], color=color, lw=1.8, zorder=4)
    axes.set_xlim(0.0, max(float(run.trace.rows["t"][-1]), run.trace.dt))
    axes.set_xlabel("time [s]")


def annotate(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    off: tuple[float, float],
    color: str,
    *,
    left: bool = False,
) -> None:
    """A label at a point, `off` points away from it, with a thin line between them."""
    axes.annotate(
        text, at, off, textcoords="offset points", color=color, fontsize=9,
        arrowprops={"arrowstyle": "-", "color": color, "lw": 0.7}, bbox=PAPER, zorder=9,
        ha="left" if left else "center", va="center",
    )  # fmt: skip


def key(axes: Axes, *entries: tuple[str, str, str]) -> None:
    """A one-line key above the axes, from (label, colour, line style) entries."""
    lines = [
        Line2D([], [], color=color, ls=style, lw=4.5 if color == PERSON else 2.0)
        for _, color, style in entries
    ]
    axes.legend(
        lines, [label for label, _, _ in entries], loc="lower left", bbox_to_anchor=(0.0, 1.0),
        ncols=len(entries), frameon=False, fontsize=9, borderaxespad=0.2, handlelength=2.2,
    )  # fmt: skip
