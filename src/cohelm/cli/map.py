"""Commands on maps: make one from a drive."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.app import app, end_as_by_ctrl_c, examples
from cohelm.cli.output import Json, Out, named, plain, print_json, print_table, progress, say, typed
from cohelm.core.errors import CohelmError, naming
from cohelm.core.files import alone

if TYPE_CHECKING:
    from cohelm.study.map_files import MapResult
    from cohelm.study.mapping_session import Kind, Mark


@app.command(
    name="map",
    epilog=examples(
        "cohelm map drive.mcap --out maps/office",
        "cohelm map out/map --remove-loop 3",
        "cohelm map office_map.yaml",
    ),
)
def map_(
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            parser=named,
            help="A drive: an MCAP record with /scan and /odom, a ROS 1 or ROS 2 bag, or a CARMEN "
            "log (.log, .gz); or the folder of an earlier mapping, to draw it again; or a map of "
            "map_server (.yaml), to check what it is good for.",
        ),
    ],
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="The record is still being written: map it until Ctrl-C or its end."
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Continue the mapping in --out: of this record, or with this record where another "
            "drive ended.",
        ),
    ] = False,
    remove_loop: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N",
            help="Of an earlier mapping: remove this loop, it was not the same place (loops.csv, "
            "map.png). Repeat it for several, as the next two.",
        ),
    ] = None,
    cut: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FROM:TO", help="Of it: leave out the scans of this time [s since the first]."
        ),
    ] = None,
    crop: Annotated[
        list[str] | None,
        typer.Option(metavar="X:Y:X:Y", help="Of it: keep the area between two corners [m]."),
    ] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Of it: undo the last mark.")] = False,
    localise: Annotated[
        bool,
        typer.Option("--localise", help="Then localise the drive on the map, and compare the two."),
    ] = False,
    resolution: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=0.005,
            max=1.0,
            help="Side of a cell [m]; by default 0.025, or as before.",
            show_default=False,
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="The robot with this LiDAR, if not in the record."),
    ] = None,
    scan_topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="Of a bag with several: the LaserScan to map.")
    ] = "",
    odom_topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="Of a bag with several: the Odometry.")
    ] = "",
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Make a map from a drive, with loops closed, or check one.

    Leaves map.yaml and map.pgm (as ROS's map_server reads them), map.png with the way driven,
    trajectory.csv, loops.csv, mapping.json and survey.npz in out/map unless --out names another
    folder. A folder that holds an earlier mapping is refused; after an interruption, go on with
    --resume.

    Of a map, it prints how long and thick the walls are, where it is open, and at how many places
    a scan would not tell the pose, and leaves check.png and check.json in out/map-check.
    """
    from cohelm.scenario.worlds.maps import PICTURES
    from cohelm.study.bags import BagTopics, is_bag

    others = any(
        (remove_loop, cut, crop, undo, live, resume, localise, resolution, scan_topic, odom_topic)
    )
    is_map = record.suffix in (".yaml", ".yml")
    if is_map and others:
        raise CohelmError(f"{record} is a map: only --robot, --out and --json go with it")
    if is_map or (record.suffix.lower() in PICTURES and not others):
        _check(record, robot or "sally", out or Path("out/map-check"), as_json)
        return
    earlier = record.is_dir() and not is_bag(record)
    if live and is_bag(record):
        raise CohelmError(f"{record} is a bag: --live is for a record of cohelm")
    topics = BagTopics(scan_topic, odom_topic)
    marks = _marks(cut or [], crop or [])
    marked = bool(remove_loop or marks or undo)
    if marked and not earlier:
        raise CohelmError(
            "--remove-loop, --cut, --crop and --undo mark what an earlier mapping made: name its "
            "folder instead of a record"
        )
    if earlier and (live or resume or localise or robot is not None or topics != BagTopics()):
        raise CohelmError(
            f"{record} is a folder: --live, --resume, --localise, --scan-topic, --odom-topic and "
            "--robot are for a record"
        )
    folder = out or (record if earlier else Path("out/map"))
    end_as_by_ctrl_c()
    with alone(folder), progress("starting") as bar:
        from cohelm.scenario import load
        from cohelm.study import mapping

        try:
            if earlier:
                result = mapping.marked(
                    record, folder, resolution, bar, remove_loops=remove_loop or [], marks=marks,
                    undo=undo,
                )  # fmt: skip
            else:
                model = load.robot(robot) if robot is not None else None
                result = mapping.mapped(
                    record, folder, resolution, bar, live=live, robot=model, resume=resume,
                    topics=topics, localise=localise,
                )  # fmt: skip
        except mapping.Interrupted:
            again = typed(record) if earlier else f"{typed(record)} --resume"
            say(
                "[yellow]interrupted[/yellow]; the map so far is kept, continue with: "
                f"cohelm map {plain(again)} --out {plain(typed(folder))}"
            )
            raise
    if result.left_out:
        say(f"[yellow]warning:[/yellow] {plain(str(record))}: left out: {plain(result.left_out)}")
    if not result.record_whole:
        say(f"[bold red]failed:[/bold red] {plain(str(record))} is cut short or damaged; the map "
            "goes as far as it does")  # fmt: skip
    if as_json:
        print_json({"record": str(record), "out": str(folder), **asdict(result)})
    else:
        print_table(str(record), ("quantity", "value"), _rows(result))
        say(f"map.yaml, map.pgm and map.png: {plain(str(folder))}")
    if not result.record_whole:
        raise typer.Exit(1)


def _rows(result: MapResult) -> tuple[tuple[str, str], ...]:
    """What came of a mapping; of a drive that was localized, how that went on its own map."""
    rows = (
        ("scans, and those of them without a return", f"{result.scans}, {result.empty_scans}"),
        ("way driven", f"{result.travelled_m:.1f} m"),
        ("places, and pairs of them that met again", f"{result.places}, {result.loops}"),
        ("times that it came back: loops, by number", f"{result.encounters}"),
        *((("marked", ", ".join(result.marks)),) if result.marks else ()),
        ("the odometry's ways are multiplied by", f"{result.odometry_scale:.4f}"),
        ("map", f"{result.width_m:.1f} x {result.height_m:.1f} m at {result.resolution_m:g} m"),
        ("time", f"{result.seconds:.1f} s"),
    )
    found = result.localized
    if found is None:
        return rows
    off = "lost all the time"
    if found.rms_m is not None and found.most_m is not None:
        off = f"{100 * found.rms_m:.1f} cm, {100 * found.most_m:.0f} cm"
    shares = f"{100 * found.lost_share:.1f} %, {100 * found.wrong_and_sure_share:.1f} %"
    return (
        *rows,
        ("localized on it: off by, rms and most", off),
        ("of its scans lost; wrong and not lost", shares),
    )


def _check(path: Path, robot: str, folder: Path, as_json: bool) -> None:
    """Say what a map is good for, with a picture."""
    from cohelm.scenario import load
    from cohelm.scenario.worlds.maps import read_map
    from cohelm.study import map_check

    lidar = load.robot(robot).lidar
    if lidar is None:
        raise CohelmError(f"{robot} has no LiDAR to localise with: name another with --robot")
    occupancy = read_map(path)
    with alone(folder), progress("starting") as bar:
        with naming(path):
            check = map_check.checked(occupancy, lidar, bar)
        map_check.write(folder, occupancy, check)
    if as_json:
        print_json({"map": str(path), "robot": robot, "out": str(folder), **asdict(check)})
        return
    rows = (
        ("size", f"{check.width_m:.1f} x {check.height_m:.1f} m at {check.resolution_m:g} m"),
        ("free", f"{check.free_m2:.0f} m2"),
        ("walls beside it", f"{check.wall_m:.0f} m"),
        ("their thickness, median and 95 %",
         f"{check.thickness_m:.2f} m, {check.thickness_95_m:.2f} m"),
        ("open ends, free beside unknown", f"{check.open_m:.0f} m"),
        (f"of {check.places} places, with too few features", f"{len(check.few_features)}"),
        ("that look like another place", f"{len(check.alike)}"),
    )  # fmt: skip
    print_table(str(path), ("quantity", "value"), rows)
    if check.places < map_check.PLACES:
        say(f"at {map_check.PLACES} places at most; fewer where more than 4000 m2 are free")
    say(f"for the LiDAR of {robot}; where: {plain(str(folder / 'check.png'))}")


def _marks(cuts: list[str], crops: list[str]) -> list[Mark]:
    """Parse --cut and --crop. Raises CohelmError for a wrong number of values."""
    from cohelm.study.mapping_session import Mark

    found: list[Mark] = []
    kinds: tuple[tuple[Kind, list[str], int, str], ...] = (
        ("cut", cuts, 2, "FROM:TO in seconds"), ("crop", crops, 4, "X:Y:X:Y in metres"),
    )  # fmt: skip
    for kind, texts, count, form in kinds:
        for text in texts:
            try:
                values = [float(part) for part in text.split(":")]
            except ValueError:
                values = []
            if len(values) != count or not all(map(math.isfinite, values)):
                raise CohelmError(f"--{kind} {text}: is not {form}")
            if kind == "cut" and values[0] > values[1]:
                raise CohelmError(f"--cut {text}: ends before it begins")
            found.append(Mark(kind, [values]))
    return found
