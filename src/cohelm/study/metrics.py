"""The scores of one run, from its trace alone: a replayed record gives the same ones."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cohelm.core.trace import Trace
from cohelm.core.types import Floats, X, Y
from cohelm.law.barrier import HEADING
from cohelm.law.verdict import INVALID, POWERLESS, SHAPED

BACK_ON_PATH = 0.03
"""E_P below this is back on the reference: the paper's tracking error [m, rad]."""

LEADS_BELOW = 0.5
"""The person leads while the automatic share of some axis is below this."""

PASSED_WITHIN = 1.5
"""A disc that never came nearer to the robot's centre than this was not passed at all [m]."""

STANDS_BELOW = 0.05
"""Slower than this while the reference moves is a stall [m/s]."""

Side = Literal["left", "right", "through"]


@dataclass(frozen=True)
class DiscMetrics:
    """How one obstacle was met."""

    min_h: float
    """Smallest h_i [m^2]; below 0 the robot's centre was inside the safe distance (19)."""
    at_s: float
    """When that was [s]."""
    side: Side | None
    """Side of the disc that the robot's centre passed on, seen along its heading; `through` the
    safe distance; None when it stayed away farther than PASSED_WITHIN."""


@dataclass(frozen=True)
class Metrics:
    """What one run is judged by. SI units and radians; shares are of all steps, in [0, 1]."""

    duration_s: float
    path_length_m: float
    """Length driven by the robot's centre."""
    reached: bool
    """Whether the run ended near enough to the end of its reference; with the paper's law, whose
    reference runs on with time, when it should be there."""
    max_pose_error: float
    rms_pose_error: float
    final_pose_error: float
    """E_P (51), position and heading together [m, rad]."""
    longest_stall_s: float
    """Longest time below STANDS_BELOW while the reference moved on, or waited (E3, E12)."""

    discs: dict[str, DiscMetrics]
    """Per obstacle, by name, in the order of the trace."""
    min_h: float
    """Smallest h of all obstacles [m^2]; infinite without any."""
    min_clearance_m: float
    """Smallest clearance between the robot's real outline and any disc or wall (E7)."""
    min_clearance_at_s: float
    contact: bool
    """Whether that clearance closed."""

    max_speed_mps: float
    max_yaw_rate_radps: float
    """Largest |v| and |omega| requested of the robot by U (49) (E5)."""
    max_acceleration_mps2: float
    max_yaw_acceleration_radps2: float
    """Largest change per second of what was applied, between two steps."""
    saturated_share: float
    """Steps in which limits changed the command (E5)."""
    filter_share: float
    """Steps in which the barrier's input acted (33)."""
    heading_share: float
    """Of all steps, those in which it acted for its heading term and no obstacle (E6)."""
    powerless_share: float
    """Steps in which it should have acted but L_gB vanished (E5)."""
    invalid_share: float
    """Steps stopped because a number that came in was not finite."""

    human_share: float
    """Mean human authority 1 - K_c over both axes and all steps."""
    min_auto_authority: float
    """Smallest automatic authority of either axis, e^-V_h with joint blending (48)."""
    human_windows_s: list[tuple[float, float]]
    """Times in which the person led, [from, to)."""
    return_s: list[float]
    """After each of them, time until E_P < BACK_ON_PATH; infinite if it never was again."""
    min_supplied_energy: float
    """Smallest passivity integral (40); Assumption 2 holds while it is >= 0."""

    def as_dict(self) -> dict[str, Any]:
        """The same as plain values for JSON; what is infinite or not a number becomes None."""
        return plain(asdict(self))


def measure(trace: Trace) -> Metrics:
    """Score a run. The trace must hold at least one step."""
    r = trace.rows
    t = r["t"]
    windows = spans(leads(r))
    stalls = spans((np.abs(r["applied_v"]) < STANDS_BELOW) & ((r["u_d"] > 0.0) | (r["rate"] < 1.0)))
    nearest = int(np.argmin(r["clearance"]))
    found = {name: _disc(trace, i) for i, name in enumerate(trace.names)}
    verdict = r["verdict"]
    return Metrics(
        duration_s=float(t[-1] - t[0]),
        path_length_m=float(np.hypot(np.diff(r["x"]), np.diff(r["y"])).sum()),
        reached=bool(r["arrived"][-1]),
        max_pose_error=float(r["e_p"].max()),
        rms_pose_error=float(np.sqrt(np.mean(r["e_p"] ** 2))),
        final_pose_error=float(r["e_p"][-1]),
        longest_stall_s=max((b - a for a, b in stalls), default=0) * trace.dt,
        discs=found,
        min_h=min((d.min_h for d in found.values()), default=math.inf),
        min_clearance_m=float(r["clearance"][nearest]),
        min_clearance_at_s=float(t[nearest]),
        contact=bool(r["clearance"][nearest] <= 0.0),
        max_speed_mps=float(np.abs(r["safe_v"]).max()),
        max_yaw_rate_radps=float(np.abs(r["safe_omega"]).max()),
        max_acceleration_mps2=_steepest(r["applied_v"], trace.dt),
        max_yaw_acceleration_radps2=_steepest(r["applied_omega"], trace.dt),
        saturated_share=float(r["saturated"].mean()),
        filter_share=float((verdict == SHAPED).mean()),
        heading_share=float(((verdict == SHAPED) & (r["limiting"] == HEADING)).mean()),
        powerless_share=float((verdict == POWERLESS).mean()),
        invalid_share=float((verdict == INVALID).mean()),
        human_share=float(1.0 - 0.5 * (r["authority_x"].mean() + r["authority_psi"].mean())),
        min_auto_authority=float(min(r["authority_x"].min(), r["authority_psi"].min())),
        human_windows_s=[(float(t[a]), float(t[b - 1] + trace.dt)) for a, b in windows],
        return_s=[settling(trace, b, BACK_ON_PATH) for _, b in windows],
        min_supplied_energy=float(r["energy"].min()),
    )


def leads(rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """The periods in which the person leads."""
    return np.minimum(rows["authority_x"], rows["authority_psi"]) < LEADS_BELOW


def settling(trace: Trace, first: int, below: float) -> float:
    """Time from step `first` until E_P is first below a bound [s]; infinite if it never is."""
    inside = np.flatnonzero(trace.rows["e_p"][first:] < below)
    return float(inside[0] * trace.dt) if len(inside) else math.inf


def wheel_acceleration(trace: Trace, track: float) -> float:
    """Largest jump of either wheel's rim speed between two steps, per second [m/s^2].

    track: distance between the wheels [m].
    """
    r = trace.rows
    rim = [r["applied_v"] + side * 0.5 * track * r["applied_omega"] for side in (-1.0, 1.0)]
    return max(_steepest(speed, trace.dt) for speed in rim)


def spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of true values as (first, one past the last) indices."""
    edges = np.diff(np.concatenate(([False], flags, [False])).astype(np.int8))
    return [
        (int(a), int(b))
        for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    ]


def plain(value: Any) -> Any:
    """Containers and numbers as JSON has them: tuples as lists, no infinity, no NaN."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _steepest(values: Floats, dt: float) -> float:
    return float(np.abs(np.diff(values)).max(initial=0.0) / dt)


def _disc(trace: Trace, i: int) -> DiscMetrics:
    k = int(np.argmin(trace.h[:, i]))
    row, disc = trace.rows[k], trace.discs[k, i]
    dx, dy = disc[X] - row["x"], disc[Y] - row["y"]
    h = float(trace.h[k, i])
    to_the_left = -math.sin(row["psi"]) * dx + math.cos(row["psi"]) * dy > 0.0
    side: Side | None = "right" if to_the_left else "left"
    if h < 0.0:
        side = "through"
    elif math.hypot(dx, dy) > PASSED_WITHIN:
        side = None
    return DiscMetrics(h, float(row["t"]), side)
