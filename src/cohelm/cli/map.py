"""Commands on maps: make one from a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cohelm.cli.app import app
from cohelm.cli.tell import Json, Out, plain, print_json, print_table, progress, say


@app.command(name="map")
def map_(
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            help="A drive: an MCAP record with /scan and /odom, or a CARMEN log (.log, .gz).",
        ),
    ],
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="The record is still being written: map along, until Ctrl-C or its end."
        ),
    ] = False,
    resolution: Annotated[
        float, typer.Option(metavar="M", min=0.005, max=1.0, help="Side of a cell [m].")
    ] = 0.025,
    robot: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="Whose LiDAR it was, if the record does not say."),
    ] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Make a map from a drive, with loops closed.

    Leaves map.yaml and map.pgm (as ROS's map_server reads them), map.png with the way driven,
    trajectory.csv and mapping.json, in out/map unless --out names another folder; files of an
    earlier mapping there are replaced.
    """
    with progress("starting") as told:
        from cohelm.scenario import load
        from cohelm.study.mapping import mapped

        model = load.robot(robot) if robot is not None else None
        folder = out or Path("out/map")
        result = mapped(record, folder, resolution, told, live=live, robot=model)
    if not result.record_whole:
        say(f"[bold red]failed:[/bold red] {plain(str(record))} is cut short or damaged; the map "
            "goes as far as it does")  # fmt: skip
    if as_json:
        print_json({"record": str(record), "out": str(folder), **result.as_dict()})
        _end(result.record_whole)
        return
    rows = (
        ("scans, and those of them without a return", f"{result.scans}, {result.empty_scans}"),
        ("way driven", f"{result.travelled_m:.1f} m"),
        ("places, and pairs of them that met again", f"{result.places}, {result.loops}"),
        ("the odometry's ways are multiplied by", f"{result.odometry_scale:.4f}"),
        ("map", f"{result.width_m:.1f} x {result.height_m:.1f} m at {result.resolution_m:g} m"),
        ("time", f"{result.seconds:.1f} s"),
    )
    print_table(str(record), ("quantity", "value"), rows)
    say(f"map.yaml, map.pgm and map.png: {plain(str(folder))}")
    _end(result.record_whole)


def _end(whole: bool) -> None:
    """With exit status 1 where the record was not whole."""
    if not whole:
        raise typer.Exit(1)
