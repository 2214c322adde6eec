"""The paper's experiments again, in one go: numbers, table, figures and records in one folder."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from cohelm.core.files import alone, write_json, writing
from cohelm.core.types import Progress
from cohelm.record.write import Recorder
from cohelm.study.experiments import SETTLED, Experiments, perform
from cohelm.study.metrics import Metrics, plain, wheel_acceleration
from cohelm.study.single import scene

_RUNS, _RECORDS = 0.25, 0.55
"""Shares of the whole at which runs and records are done."""


def reproduce(out: Path, progress: Progress = lambda _doing, _share: None) -> Experiments:
    """Run the paper's experiments and write their figures and numbers into the folder `out`.

    The folder is made if need be; files of an earlier reproduction in it are replaced. The same
    code writes the same bytes every time. progress: called with a description, and the share of the
    whole that is done. Raises CohelmError where the folder can not be written.
    """
    with alone(out), writing(out):
        (out / "records").mkdir(exist_ok=True)
        ex = perform(lambda doing, share: progress(doing, _RUNS * share))
        _write(ex, out, progress)
    progress("done", 1.0)
    return ex


def _write(ex: Experiments, out: Path, progress: Progress) -> None:
    write_json(out / "reproduce.json", numbers(ex))
    runs = ex.recorded()
    for k, (name, run) in enumerate(runs.items()):
        progress(f"record {name}", _RUNS + (_RECORDS - _RUNS) * k / len(runs))
        path = out / "records" / f"{name}.mcap"
        path.unlink(missing_ok=True)  # of an earlier reproduction
        with Recorder(path, scene(run.setup)) as file:
            file.write(run.trace)
    # matplotlib takes a second to import: only drawing waits for it.
    from cohelm.study.figures import draw_figures

    draw_figures(ex, out, lambda doing, s: progress(doing, _RECORDS + (1 - _RECORDS) * s))
    (out / "summary.md").write_text(_summary(ex), encoding="utf-8")


def numbers(ex: Experiments) -> dict[str, Any]:
    """Everything that is reported, as plain values for JSON."""
    track, avoid, without, shared = (
        run.metrics for run in (ex.track, ex.avoid, ex.without, ex.shared)
    )
    return plain({
        "tracking": {
            **_of(track, "max_pose_error", "final_pose_error"),
            "settle_s": ex.settle_s,
            "least_settle_s": ex.least_settle_s,
            "longest_above_settled_s": ex.longest_above_settled_s,
        },
        "barrier": {
            "k_cbf": ex.avoid.setup.gains.k_cbf,
            "min_h": {name: disc.min_h for name, disc in avoid.discs.items()},
            "min_h_without": {name: disc.min_h for name, disc in without.discs.items()},
            "min_footprint_clearance_m": avoid.min_clearance_m,
            "max_command": [avoid.max_speed_mps, avoid.max_yaw_rate_radps],
            "max_pose_error": avoid.max_pose_error,
            "passed_on": {name: disc.side for name, disc in avoid.discs.items()},
        },
        "shared": {
            **_of(shared, "human_windows_s", "min_auto_authority", "return_s", "min_h"),
            "min_footprint_clearance_m": shared.min_clearance_m,
            "final_pose_error": shared.final_pose_error,
        },
        "wheel_limits_on": {
            name: {
                **_of(run.metrics, "max_pose_error", "final_pose_error", "min_h"),
                "min_footprint_clearance_m": run.metrics.min_clearance_m,
                "saturated_share": run.metrics.saturated_share,
                "max_wheel_acceleration_mps2": wheel_acceleration(run.trace, ex.wheels.track),
                **_of(run.metrics, "human_windows_s", "return_s"),
            }
            for name, run in ex.limited.items()
        },
        "k_cbf_sweep": [
            {
                "k_cbf": k_cbf,
                **_of(m, "min_h", "reached", "max_speed_mps", "longest_stall_s", "max_pose_error"),
                "min_footprint_clearance_m": m.min_clearance_m,
            }
            for k_cbf, m in ex.sweep.items()
        ],
    })  # fmt: skip


def _of(m: Metrics, *names: str) -> dict[str, Any]:
    return {name: getattr(m, name) for name in names}


def table(ex: Experiments) -> list[tuple[str, str, str]]:
    """Rows of (quantity, ours, paper); a dash where the paper gives no number."""
    track, avoid, without, shared = (
        run.metrics for run in (ex.track, ex.avoid, ex.without, ex.shared)
    )
    rows = [
        ("tracking: largest E_P", f"{track.max_pose_error:.3f}", "< 0.03 but for jumps"),
        ("tracking: final E_P", f"{track.final_pose_error:.4f}", "–"),
        (
            f"tracking: longest above E_P {SETTLED}, at a turn",
            f"{ex.longest_above_settled_s:.1f} s",
            "< 2 s",
        ),
        (f"back to E_P {SETTLED} from a 90° heading error", _seconds(ex.settle_s), "< 2 s"),
    ]
    for name, disc in avoid.discs.items():
        rows.append((f"barrier: smallest h, {name}", f"{disc.min_h:.3f} m²", "> 0"))
        h = without.discs[name].min_h
        rows.append((f"no barrier: smallest h, {name}", f"{h:.3f} m²", "< 0"))
    windows = ", ".join(f"{a:.1f}–{b:.1f}" for a, b in shared.human_windows_s) or "never"
    rows += [
        ("barrier: outline's smallest clearance", f"{avoid.min_clearance_m:.3f} m", "no contact"),
        (
            "barrier: largest command",
            f"{avoid.max_speed_mps:.2f} m/s, {avoid.max_yaw_rate_radps:.2f} rad/s",
            "–",
        ),
        ("shared: the person leads", f"{windows} s", "2.5–6.3, 43.2–46.6 s"),
        ("shared: least automatic authority", f"{shared.min_auto_authority:.2f}", "–"),
        (
            "shared: back on the path after",
            ", ".join(_seconds(t) for t in shared.return_s) or "–",
            "“quickly”",
        ),
        ("shared: smallest h", f"{shared.min_h:.3f} m²", "> 0"),
    ]
    for name, run in ex.limited.items():
        m = run.metrics
        if m.discs:
            rows.append(
                (
                    f"{name}, wheel limits on: h, clearance",
                    f"{m.min_h:.3f} m², {m.min_clearance_m:.3f} m",
                    "–",
                )
            )
    return rows


def _seconds(t: float) -> str:
    return f"{t:.1f} s" if math.isfinite(t) else "never"


_PICTURES = (
    "fig06_track_path", "fig07_track_error", "fig08_avoid_path", "fig09_avoid_h",
    "fig10_shared_path", "fig11_shared_authority", "k_cbf_sweep",
)  # fmt: skip


def _summary(ex: Experiments) -> str:
    """Table and figures on one page of Markdown."""
    lines = ["# The paper's experiments, again", "", "| | ours | paper |", "|---|---|---|"]
    lines += [f"| {quantity} | {ours} | {paper} |" for quantity, ours, paper in table(ex)]
    lines += ["", "`reproduce.json` and docs/paper.md explain each number.", ""]
    lines += [f"![{name}]({name}.png)\n" for name in _PICTURES]
    return "\n".join(lines)
