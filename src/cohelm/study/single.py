"""One scenario, run, recorded as it goes, scored and drawn."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime
from math import inf
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_free, make_folder, unmade, write_json
from cohelm.core.trace import Trace
from cohelm.core.types import Progress
from cohelm.drive.shown import reference_lines, zone_messages
from cohelm.plan.zones import UNZONED
from cohelm.record.file import RECORD
from cohelm.record.write import Recorder, RunScene
from cohelm.sim.run import pieces
from cohelm.sim.setup import Setup
from cohelm.study.controlled import RunResult
from cohelm.study.metrics import Metrics

SCENARIO = "scenario.yaml"
METRICS = "metrics.json"
PICTURE = "run"
WRITTEN = (RECORD, SCENARIO, METRICS, f"{PICTURE}.png", f"{PICTURE}.svg")
"""What a run leaves in its folder."""

_SIMULATED = 0.7
"""Share of the whole that is behind when the run is; drawing is the rest."""

_NAMED = 8
"""Of more obstacles than this, only so many are listed."""

_UNSAFE = re.compile(r"[^\w-]")


def recorded(setup: Setup, folder: Path, progress: Progress) -> Metrics:
    """Run a setup into a folder, which is made if need be.

    Interrupted (Ctrl-C) or on a full disk, what was written before stays readable. Raises
    CohelmError where the folder or a file in it can not be made, or where one of WRITTEN is
    there already: a run never replaces what it finds.
    """
    make_folder(folder)
    mend = "choose another folder with --out, or none for a new one in out/"
    check_free(folder, WRITTEN, "a run", mend)
    progress("running (the first time, compiling)", 0.0)
    steps, done = 0, list[Trace]()
    with Recorder(folder / RECORD, scene(setup)) as recorder:
        for piece in pieces(setup):
            recorder.write(piece)
            done.append(piece)
            steps += len(piece)
            progress("running and recording", _SIMULATED * steps / setup.steps)
    run = RunResult(setup, done[0].joined(*done[1:]))
    with _writing(folder / SCENARIO) as path:
        path.write_text(setup.scenario, encoding="utf-8")
    with _writing(folder / METRICS) as path:
        write_json(path, run.metrics.as_dict())
    progress("drawing", _SIMULATED)
    from cohelm.study.figures import draw_run  # matplotlib takes a second to import

    with _writing(folder / f"{PICTURE}.png"):
        draw_run(run, folder, PICTURE)
    return run.metrics


def scene(setup: Setup) -> RunScene:
    """What a record of a run draws once."""
    zones = UNZONED if setup.pilot is None else setup.pilot.zones
    return RunScene(
        setup.outline,
        setup.obstacles.walls,
        reference_lines(setup.reference),
        zone_messages(zones, setup.gains.u_d),
    )


def table(m: Metrics) -> list[tuple[str, str]]:
    """Rows of (quantity, value), for people; of many obstacles those that came nearest."""
    near = f"{m.min_clearance_m:.3f} m at {m.min_clearance_at_s:.1f} s"
    led = ", ".join(f"{a:.1f}–{b:.1f} s" for a, b in m.human_windows_s)
    back = ", ".join(f"{s:.1f} s" if s < inf else "not again" for s in m.return_s)
    e_p = f"{m.max_pose_error:.3f}, {m.rms_pose_error:.3f}, {m.final_pose_error:.4f}"
    limited = f"{m.filter_share:.1%}; {m.saturated_share:.1%} of the time"
    return [
        ("reached the end of the reference", "yes" if m.reached else "no"),
        ("contact of the outline", "YES" if m.contact else "none"),
        ("smallest clearance of the outline", near if m.min_clearance_m < inf else "nothing near"),
        ("pose error E_P: max, rms, final", e_p),
        *_smallest_h(m),
        (
            "largest command requested",
            f"{m.max_speed_mps:.2f} m/s, {m.max_yaw_rate_radps:.2f} rad/s",
        ),
        ("filter acted; wheels saturated", limited),
        ("the person led", led or "never"),
        ("back on the path after that", back or "–"),
        ("duration, length driven", f"{m.duration_s:.1f} s, {m.path_length_m:.1f} m"),
    ]


def _smallest_h(m: Metrics) -> list[tuple[str, str]]:
    nearest = sorted(m.discs.items(), key=lambda named: named[1].min_h)[:_NAMED]
    shown = m.discs.items() if len(m.discs) <= _NAMED else nearest
    rows = [(f"smallest h, {n}", f"{d.min_h:.3f} m² at {d.at_s:.1f} s") for n, d in shown]
    if len(m.discs) > _NAMED:
        others = len(m.discs) - _NAMED
        rows.append((f"smallest h, {others} others", f"≥ {nearest[-1][1].min_h:.3f} m²"))
    return rows


def fresh(name: str) -> Path:
    """Make a folder out/NAME-DATE-TIME of its own, also when several start in one second."""
    out = Path("out")
    make_folder(out)
    stamped = f"{_UNSAFE.sub('-', name)[:48]}-{datetime.now():%Y%m%d-%H%M%S}"
    folder, k = out / stamped, 1
    while True:
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            k += 1
            folder = out / f"{stamped}-{k}"
        except OSError as error:
            raise unmade(folder, error) from error


@contextmanager
def _writing(path: Path) -> Generator[Path]:
    """CohelmError where a file beside the record can not be written."""
    try:
        yield path
    except OSError as error:
        raise CohelmError(
            f"{path} can not be written ({error.strerror}), the record beside it is whole: free "
            "some space, or choose another folder with --out"
        ) from error
