"""Runs one episode under one law, and scores it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, Floats, Pose, X, Y
from cohelm.robot.clearance import circumscribed_radius, disc_clearance
from cohelm.scenario.worlds.barn import score
from cohelm.sim.heights import fallen
from cohelm.sim.judge import FAR, Judged, clearance_to, judge
from cohelm.sim.setup import Setup
from cohelm.sim.world import ever_moving
from cohelm.study.campaign import laws
from cohelm.study.campaign.contact_analysis import NOTHING_TOUCHED, Touch, first_touch
from cohelm.study.campaign.episode import DT, Episode, EpisodeGoal, Interventions
from cohelm.study.campaign.result import EpisodeResult
from cohelm.study.metrics import BACK_ON_PATH, leads, spans

STEERING = 0.5
"""Weight of yaw rate beside speed in `EpisodeResult.disagreement_mps` [m]."""

_HELD = 0.05
"""A stick deflected by more than this is held."""


def run_episode(case: Episode, law: str) -> EpisodeResult:
    """The row of a case under a law."""
    acted = Interventions()
    return scored(case, law, laws.pieces(case, law, acted), acted)


def arrival(trace: Trace, goal: EpisodeGoal | None) -> int | None:
    """The first step of a trace that is near the goal; None if there is none."""
    if goal is None:
        return None
    far = np.hypot(trace.rows["x"] - goal.x, trace.rows["y"] - goal.y)
    there = np.flatnonzero(far < goal.near)
    return int(there[0]) if there.size else None


def scored(case: Episode, law: str, pieces: Iterator[Trace], acted: Interventions) -> EpisodeResult:
    """The row of a drive, from its trace alone; it is followed until it has arrived.

    acted: what gate and monitors did in it, counted while it was driven; nothing where there were
    none.
    """
    setup = case.setup
    walls = setup.obstacles.walls
    seen, close, moving = Judged(), Proximity(), ever_moving(setup.obstacles)
    kept: list[NDArray[np.void]] = []
    there: list[Floats] = []
    last: tuple[NDArray[np.void], Floats] | None = None
    arrived, nearest = False, ""
    for piece in pieces:
        rows, discs = piece.rows, piece.discs
        end = arrival(piece, case.goal)
        if end is not None:
            arrived, rows, discs = True, rows[: end + 1], discs[: end + 1]
        kept.append(rows)
        if setup.twin is not None:
            there.append(discs)
        close = approached(close, rows, discs, setup.outline, moving)
        if last is not None:
            rows = _joined([last[0], rows])
            discs = np.concatenate((last[1], discs))
        before = seen.at
        seen = judge(seen, rows, discs, setup.outline, walls, setup.limits, piece.dt)
        if seen.at != before or not nearest:
            nearest = _nearest(setup, rows, discs, seen, piece.names)
        last = rows[-1:], discs[-1:]
        if arrived:
            break
    rows = _joined(kept)
    touched = NOTHING_TOUCHED
    if setup.twin is not None and not math.isnan(seen.first):
        touched = first_touch(setup, setup.twin, rows, np.concatenate(there), seen.first)
    return _row(
        case, law, rows, seen, close if moving.any() else None, nearest, arrived, touched, acted
    )


def _joined(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    """One after the other, as bytes; numpy's own way copies field by field."""
    kind = parts[0].dtype
    return np.concatenate([part.view(f"V{kind.itemsize}") for part in parts]).view(kind)


def _nearest(
    setup: Setup, rows: NDArray[np.void], discs: Floats, seen: Judged, names: tuple[str, ...]
) -> str:
    """What the outline was nearest to at the time of the smallest clearance."""
    k = int(np.argmin(np.abs(rows["t"] - seen.at)))
    pose = Pose(float(rows["x"][k]), float(rows["y"][k]), float(rows["psi"][k]))
    walls = setup.obstacles.walls
    obstacles = range(discs.shape[1] + len(walls))
    clearances = [clearance_to(pose, setup.outline, discs[k], walls, i) for i in obstacles]
    best = int(np.argmin(clearances)) if clearances else 0
    return "" if seen.clearance >= FAR else names[best] if best < len(names) else "wall"


def _row(
    case: Episode, law: str, rows: NDArray[np.void], seen: Judged, close: Proximity | None,
    nearest: str, arrived: bool, touched: Touch, acted: Interventions,
) -> EpisodeResult:  # fmt: skip
    duration = float(rows["t"][-1])
    back, unrecovered = recovery(rows, arrived)
    measured = case.rollout is None
    return EpisodeResult(
        suite=case.suite,
        plant=case.plant,
        law=law,
        episode=case.number,
        kind=case.kind,
        fault="",
        arrived=arrived,
        duration_s=duration,
        contacts_moving=seen.moving,
        contacts_standing=seen.standing,
        contacts_departing=seen.departing,
        falls=_falls(case, rows),
        no_goal=case.goal is None,
        untouched_share=1.0 - seen.touched / max(seen.steps, 1),
        min_clearance_m=seen.clearance,
        min_clearance_moving_m=seen.clearance_moving,
        min_clearance_at_s=seen.at,
        closest_mover_m=math.nan if close is None else close.closest,
        near_movers_s=math.nan if close is None else close.near * case.setup.dt,
        nearest=nearest,
        limit_excess=seen.excess,
        score=_score(case, duration, arrived and seen.moving + seen.standing == 0),
        time_ratio=duration / case.setup.reference.duration if arrived else math.nan,
        path_length_m=float(np.hypot(np.diff(rows["x"]), np.diff(rows["y"])).sum()),
        tracking_rms=float(np.sqrt(np.mean(rows["e_p"] ** 2))) if measured else math.nan,
        human_share=1.0 - 0.5 * float(rows["authority_x"].mean() + rows["authority_psi"].mean()),
        disagreement_mps=_disagreement(rows),
        jerk_rms_mps3=_jerk(rows["applied_v"]),
        recovery_s=back if measured else math.nan,
        unrecovered=unrecovered if measured else 0,
        filtered_share=math.nan if laws.by_others(law) else float((rows["verdict"] != 0).mean()),
        gate_share=acted.share(acted.gate),
        monitor_share=acted.share(acted.monitors),
        stops=acted.stops,
        stopped_by=acted.why,
        contact_seen_s=touched.seen,
        contact_needed_s=touched.needed,
        contact_seen_share=touched.share,
        contact_speed_mps=touched.speed,
        contact_driven_mps=touched.driven,
        stick=[],
    )


def _falls(case: Episode, rows: NDArray[np.void]) -> int:
    if case.uneven is None:
        return 0
    poses = np.column_stack((rows["x"], rows["y"], rows["psi"]))
    return int(fallen(case.uneven.heights, poses, case.uneven.wheels) >= 0)


def _score(case: Episode, duration: float, success: bool) -> float:
    if case.goal is None or math.isnan(case.goal.optimal):
        return math.nan
    return score(case.goal.optimal, duration, success)


def _disagreement(rows: NDArray[np.void]) -> float:
    held = (np.abs(rows["stick_x"]) > _HELD) | (np.abs(rows["stick_psi"]) > _HELD)
    if not held.any():
        return math.nan
    dv = (rows["operator_v"] - rows["applied_v"])[held]
    domega = (rows["operator_omega"] - rows["applied_omega"])[held]
    return float(np.hypot(dv, STEERING * domega).mean())


def _jerk(speed: Floats) -> float:
    change = np.diff(speed, 2) / DT**2
    return float(np.sqrt(np.mean(change**2))) if change.size else 0.0


def recovery(rows: NDArray[np.void], arrived: bool) -> tuple[float, int]:
    """Mean time to recover after the person let go, and how often that never happened.

    A release counts as neither where the person leads again, or the robot arrives, before.
    """
    led, found, never = spans(leads(rows)), list[float](), 0
    for k, (_, released) in enumerate(led):
        until = led[k + 1][0] if k + 1 < len(led) else len(rows)
        back = np.flatnonzero(rows["e_p"][released:until] < BACK_ON_PATH)
        if len(back):
            found.append(float(back[0]) * DT)
        elif released < until == len(rows) and not arrived:
            never += 1
    return (float(np.mean(found)) if found else math.nan), never


# How near a run came to movers, and for how long: the distance a person feels.
#
# It works from the trace alone, as the judge does, once a control step.


INTIMATE = 0.45
"""Gap nearer than which only intimates are welcome [m] (E. T. Hall, The Hidden Dimension, 1966)."""


class Proximity(NamedTuple):
    """To the nearest of all that move at any time, also while they stand."""

    closest: float = FAR
    """Smallest gap of the outline, negative in overlap; at most FAR [m]."""
    near: int = 0
    """Control steps in which it was below INTIMATE."""


@jit
def approached(
    seen: Proximity, rows: NDArray[np.void], discs: Floats, outline: Floats,
    moving: NDArray[np.bool_],
) -> Proximity:  # fmt: skip
    """Continue over further rows. rows: (n,) of dtype `core.row.ROW`, discs: (n, m, 6), moving:
    (m,)."""
    closest, near, reach = seen.closest, seen.near, circumscribed_radius(outline)
    for k in range(len(rows)):
        pose = Pose(rows[k].x, rows[k].y, rows[k].psi)
        least = FAR
        for i in range(len(moving)):
            if not moving[i]:
                continue
            x, y, radius = discs[k, i, X], discs[k, i, Y], discs[k, i, RADIUS]
            matters = min(least, max(closest, INTIMATE))
            if np.hypot(x - pose.x, y - pose.y) < matters + radius + reach:
                least = min(least, disc_clearance(pose, outline, x, y, radius))
        closest = min(closest, least)
        near += least < INTIMATE
    return Proximity(closest, near)
