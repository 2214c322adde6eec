"""An episode from above, with clearance and speed over time; and how it made way, as a strip."""

# matplotlib's methods take untyped **kwargs; everything of ours is still checked.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import io

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from cohelm.core.frames import placed
from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.pilot.behavior import EVADING
from cohelm.scenario.worlds.tracks import ELSEWHERE
from cohelm.sim.heights import edges
from cohelm.study.campaign.episode import Episode
from cohelm.study.campaign.result import EpisodeResult, clearance_then
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
_MARGIN = 1.0  # around what is shown [m]
_ROOM = 40.0  # a larger world is not shown whole, but for where the robot was [m]
_LEAST, _MOST = -0.5, 1.0  # of the clearance that is drawn [m]
_CLEARANCE = f"clearance [m], drawn from {_LEAST:g} to {_MOST:g}".replace("-", "−")
_FRAMES, _APART_S = 6, 0.8  # of a strip, and from one to the next
_SIDE = 6.0  # of the square that a frame shows [m]
_AHEAD_S = 1.0  # of a mover's motion, as an arrow


def picture(case: Episode, trace: Trace, row: EpisodeResult) -> bytes:
    """The episode as PNG. The outline is red where the clearance was smallest."""
    with styled():
        out = io.BytesIO()
        drawn(case, trace, row).savefig(out, dpi=110, metadata={"Software": None})
    return out.getvalue()


def drawn(case: Episode, trace: Trace, row: EpisodeResult) -> Figure:
    """The episode from above, whole room, and clearance and speed over time, with a legend."""
    left, right, low, high = _room(case, trace)
    height = 6.4 * min(max((high - low) / (right - left), 0.35), 1.1)
    figure = Figure(figsize=(7.0, height + 2.6), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(height, 1.5))
    above.set_xlim(left, right)
    above.set_ylim(low, high)
    _above(above, case, trace, row)
    _below(below, trace, row)
    handles = _legend(case, trace)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure


def strip(case: Episode, trace: Trace) -> bytes | None:
    """How it made way where that was tightest: six moments from above, as PNG; None: it never did.

    Of a mover its last second, and an arrow to where it would be in one; of the robot where it has
    been since the first frame.
    """
    rows = trace.rows
    evading = np.flatnonzero(rows["behavior"] == EVADING)
    if not evading.size:
        return None
    tightest = int(evading[np.argmin(rows["clearance"][evading])])
    apart = max(round(_APART_S / trace.dt), 1)
    first = max(min(tightest - apart * _FRAMES // 2, len(rows) - 1 - apart * (_FRAMES - 1)), 0)
    steps = [k for k in range(first, first + apart * _FRAMES, apart) if k < len(rows)]
    middle = rows[steps[len(steps) // 2]]
    out = io.BytesIO()
    with styled():
        figure = Figure(figsize=(1.8 * len(steps), 2.3), layout="constrained")
        frames = figure.subplots(1, len(steps), squeeze=False)[0]
        for axes, k in zip(frames, steps, strict=True):
            _frame(axes, case, trace, first, k)
            axes.set_xlim(middle["x"] - 0.5 * _SIDE, middle["x"] + 0.5 * _SIDE)
            axes.set_ylim(middle["y"] - 0.5 * _SIDE, middle["y"] + 0.5 * _SIDE)
            axes.set_title(f"{rows['t'][k]:.1f} s", fontsize=9)
        figure.savefig(out, dpi=110, metadata={"Software": None})
    return out.getvalue()


def _frame(axes: Axes, case: Episode, trace: Trace, first: int, k: int) -> None:
    """One moment, row k; `first` is the row of the strip's first."""
    rows, setup = trace.rows, case.setup
    walls = setup.obstacles.walls.reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(walls), colors=WALL, linewidths=1.4))
    axes.plot(rows["x_d"], rows["y_d"], color=REFERENCE, lw=0.8, ls=(0, (4, 3)), zorder=1)
    for i in range(trace.discs.shape[1]):
        places = trace.discs[:, i]
        _disc(axes, places, k, round(_AHEAD_S / trace.dt))
        x, y, vx, vy = places[k, :RADIUS]
        if _moves(places) and abs(x) < ELSEWHERE:
            axes.quiver(x, y, _AHEAD_S * vx, _AHEAD_S * vy, color=MOVER, zorder=5, angles="xy",
                        scale_units="xy", scale=1.0, width=0.015)  # fmt: skip
    axes.plot(rows["x"][first : k + 1], rows["y"][first : k + 1], color=ROBOT, lw=1.4, zorder=5)
    corners = placed(setup.outline, Pose(rows["x"][k], rows["y"][k], rows["psi"][k]))
    axes.add_patch(Polygon(corners, closed=True, fc=ROBOT, ec=INK, lw=0.8, alpha=0.85, zorder=6))
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(True)


def _room(case: Episode, trace: Trace) -> tuple[float, float, float, float]:
    """Left, right, lower and upper end of what is shown [m]: walls and obstacles as well as the
    drive, or the drive alone in a world that is too large for that."""
    ways = np.column_stack((trace.rows["x"], trace.rows["y"]))
    discs = trace.discs[0, :, :2] if len(trace.discs) else np.empty((0, 2))
    discs = discs[np.abs(discs).max(axis=1, initial=0.0) < ELSEWHERE]
    whole = np.vstack((ways, case.setup.obstacles.walls.reshape(-1, 2), discs))
    shown = whole if np.ptp(whole, axis=0).max() <= _ROOM else ways
    (left, low), (right, high) = shown.min(axis=0) - _MARGIN, shown.max(axis=0) + _MARGIN
    return float(left), float(right), float(low), float(high)


def _legend(case: Episode, trace: Trace) -> list[Artist]:
    """What the lines and colours mean, of those that are there."""
    moving = [_moves(trace.discs[:, i]) for i in range(trace.discs.shape[1])]
    entries: list[tuple[bool, Artist]] = [
        (True, Line2D([], [], color=ROBOT, lw=1.8, label="robot: path, outline every 2 s; speed")),
        (True, Patch(fc="none", ec=DANGER, lw=1.8, label="least clearance while moving")),
        (True, Patch(fc="none", ec=INK, lw=1.2, label="robot at the end")),
        (case.goal is not None,
         Line2D([], [], color=REFERENCE, lw=1.0, ls=(0, (4, 3)),
                label="reference or detour")),
        (case.goal is not None, Patch(fc="none", ec=PALE, ls=":", lw=1.2, label="goal")),
        (len(case.setup.obstacles.walls) > 0, Line2D([], [], color=WALL, lw=1.6, label="wall")),
        (not all(moving), Patch(fc=CONE, alpha=0.8, label="obstacle at rest")),
        (any(moving), Patch(fc=MOVER, alpha=0.8, label="mover then, its last 4 s")),
    ]  # fmt: skip
    return [artist for there, artist in entries if there]


def _above(axes: Axes, case: Episode, trace: Trace, row: EpisodeResult) -> None:
    rows, setup = trace.rows, case.setup
    walls = setup.obstacles.walls.reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(walls), colors=WALL, linewidths=1.6))
    if case.uneven is not None:
        drops = edges(case.uneven.heights.drops).reshape(-1, 2, 2)
        axes.add_collection(LineCollection(list(drops), colors=DANGER, linewidths=1.0))
    worst = int(np.argmin(np.abs(rows["t"] - row.min_clearance_at_s)))
    for i in range(trace.discs.shape[1]):
        _disc(axes, trace.discs[:, i], worst, round(_TRAIL_S / trace.dt))
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
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def _moves(places: Floats) -> bool:
    return float(np.ptp(places[:, :2], axis=0).max()) > 1e-6


def _disc(axes: Axes, places: Floats, k: int, steps: int) -> None:
    """A disc where it was in step k; of one that moves also its way in so many steps before."""
    now, moves = places[k], _moves(places)
    if moves:
        way = places[max(k - steps, 0) : k + 1]
        way = way[np.abs(way[:, X]) < ELSEWHERE]
        axes.plot(way[:, X], way[:, Y], color=MOVER, lw=1.2, alpha=0.6, zorder=2)
    at, radius, color = (now[X], now[Y]), max(float(now[RADIUS]), 0.015), MOVER if moves else CONE
    axes.add_patch(Circle(at, radius, fc=color, ec="none", alpha=0.8, zorder=4))


def _outline(axes: Axes, outline: Floats, row: np.void, color: str, width: float) -> None:
    corners = placed(outline, Pose(row["x"], row["y"], row["psi"]))
    axes.add_patch(Polygon(corners, closed=True, fc="none", ec=color, lw=width, zorder=6))


def _below(axes: Axes, trace: Trace, row: EpisodeResult) -> None:
    rows = trace.rows
    clearance, speed = np.clip(rows["clearance"], _LEAST, _MOST), np.abs(rows["applied_v"])
    axes.axhline(0.0, color=DANGER, lw=0.8)
    axes.plot(rows["t"], clearance, color=INK, lw=1.2, label=_CLEARANCE)
    axes.plot(rows["t"], speed, color=ROBOT, lw=1.2, label="speed [m/s]")
    least = float(np.clip(clearance_then(row), _LEAST, _MOST))
    axes.plot([row.min_clearance_at_s], [least], "o", color=DANGER, ms=5)
    top = max(_MOST, float(speed.max(initial=0.0)))
    axes.set_ylim(min(-0.1, float(clearance.min(initial=0.0)) - 0.05), 1.05 * top)
    axes.set_xlabel("time [s]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=9, frameon=False,
                borderaxespad=0.1)  # fmt: skip
