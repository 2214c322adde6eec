"""An episode from above, and its gap over time, as one small picture."""

# matplotlib's methods take untyped **kwargs; everything of ours is still checked.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.perceive.frames import placed
from cohelm.scenario.worlds.tracks import ELSEWHERE
from cohelm.study.campaign.case import Case
from cohelm.study.campaign.row import Row
from cohelm.study.draw import (
    CONE,
    DANGER,
    INK,
    MOVER,
    PALE,
    REFERENCE,
    ROBOT,
    WALL,
    styled,
)  # fmt: skip

_EVERY_S = 2.0  # between outlines of the robot that are drawn
_TRAIL_S = 4.0  # of a mover's way that is drawn
_MARGIN = 1.5  # around what was driven [m]


def picture(case: Case, trace: Trace, row: Row) -> bytes:
    """The episode as PNG. The outline is red where the gap was smallest."""
    with styled():
        figure = Figure(figsize=(5.2, 4.4), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(4.0, 1.0))
        _above(above, case, trace, row)
        _below(below, trace, row)
        out = io.BytesIO()
        figure.savefig(out, dpi=80, metadata={"Software": None})
    return out.getvalue()


def _above(axes: Axes, case: Case, trace: Trace, row: Row) -> None:
    rows, setup = trace.rows, case.setup
    for x1, y1, x2, y2 in setup.around.walls:
        axes.plot([x1, x2], [y1, y2], color=WALL, lw=1.6)
    worst = int(np.argmin(np.abs(rows["t"] - row.min_clearance_at_s)))
    for i in range(trace.discs.shape[1]):
        _disc(axes, trace.discs[:, i], worst, trace.dt)
    if case.goal is not None:
        poses = [rows["x_d"], rows["y_d"]]
        axes.plot(*poses, color=REFERENCE, lw=1.0, ls=(0, (4, 3)), zorder=3)
        axes.add_patch(
            Circle((case.goal.x, case.goal.y), case.goal.near, fc="none", ec=PALE, ls=":", lw=1.2)
        )
    axes.plot(rows["x"], rows["y"], color=ROBOT, lw=1.6, zorder=5)
    for k in range(0, len(rows), max(round(_EVERY_S / trace.dt), 1)):
        _outline(axes, setup.outline, rows[k], ROBOT, 0.6)
    _outline(axes, setup.outline, rows[-1], INK, 1.2)
    _outline(axes, setup.outline, rows[worst], DANGER, 1.8)
    axes.set_xlim(float(rows["x"].min()) - _MARGIN, float(rows["x"].max()) + _MARGIN)
    axes.set_ylim(float(rows["y"].min()) - _MARGIN, float(rows["y"].max()) + _MARGIN)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)


def _disc(axes: Axes, places: Floats, worst: int, dt: float) -> None:
    """A disc where it was at the worst moment; of one that moves also the way there."""
    now = places[worst]
    moves = float(np.ptp(places[:, :2], axis=0).max()) > 1e-6
    color = MOVER if moves else CONE
    if moves:
        way = places[max(worst - round(_TRAIL_S / dt), 0) : worst + 1]
        way = way[np.abs(way[:, X]) < ELSEWHERE]
        axes.plot(way[:, X], way[:, Y], color=MOVER, lw=1.2, alpha=0.6, zorder=2)
    radius = max(float(now[RADIUS]), 0.015)
    axes.add_patch(Circle((now[X], now[Y]), radius, fc=color, ec="none", alpha=0.8, zorder=4))


def _outline(axes: Axes, outline: Floats, row: np.void, color: str, width: float) -> None:
    corners = placed(outline, Pose(row["x"], row["y"], row["psi"]))
    axes.add_patch(Polygon(corners, closed=True, fc="none", ec=color, lw=width, zorder=6))


def _below(axes: Axes, trace: Trace, row: Row) -> None:
    rows = trace.rows
    gap = np.clip(rows["clearance"], -0.5, 1.0)
    axes.axhline(0.0, color=DANGER, lw=0.8)
    axes.plot(rows["t"], gap, color=INK, lw=1.0)
    axes.plot(
        rows["t"], np.abs(rows["applied_v"]), color=ROBOT, lw=0.8, alpha=0.7
    )  # fmt: skip
    axes.plot([row.min_clearance_at_s], [max(row.min_clearance_m, -0.5)], "o", color=DANGER, ms=4)
    axes.set_ylim(min(-0.1, float(gap.min()) - 0.05), 1.05)
    axes.set_xlabel("s", fontsize=7, labelpad=0)
    axes.set_ylabel("gap [m], speed [m/s]", fontsize=6)
    axes.tick_params(labelsize=7)
