"""The command `cohelm`: thin commands, each importing what it needs when it is called."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cohelm import __version__
from cohelm.core.errors import CohelmError

if TYPE_CHECKING:
    from cohelm.study.metrics import Metrics

app = typer.Typer(
    name="cohelm",
    help="Shared control with obstacle avoidance for uncrewed ground vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    epilog="Start with [bold]cohelm run minimal[/bold], or [bold]cohelm reproduce[/bold].",
)

Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write into.")]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object, on stdout.")]

USER_ERROR = 2
INTERRUPTED = 130


def main() -> None:
    """Run the command line: one sentence and code 2 for what the user can mend, 130 on Ctrl-C."""
    try:
        app()
    except CohelmError as error:
        for line in str(error).splitlines():
            _say(f"[bold red]error:[/bold red] {_plain(line)}")
        sys.exit(USER_ERROR)
    except KeyboardInterrupt:
        _say("[yellow]interrupted[/yellow]; what was written before stays readable")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # `cohelm … | head`
        sys.stderr.close()
        sys.exit(0)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"cohelm {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Options of every command."""


@app.command()
def run(
    scenario: Annotated[
        str, typer.Argument(help="A scenario's YAML file, or the name of one that is shipped.")
    ],
    stick: Annotated[
        str | None,
        typer.Option(
            help="Play this stick file (CSV, plain or gzip) instead of the scenario's hand; "
            "FILE#3 takes run 3 of a file that holds several."
        ),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change one value, e.g. law.barrier.k_cbf=1.0."
        ),
    ] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Run one scenario; leave its record, its scores and a picture in a folder.

    The folder is out/NAME-DATE-TIME unless --out names one; an existing record is never
    overwritten.
    """
    from cohelm.scenario import build, load
    from cohelm.study.single import recorded

    loaded = load.scenario(scenario, changes or [], stick)
    setup = build.setup(loaded)
    for warning in build.warnings(loaded):
        _say(f"[yellow]warning:[/yellow] {_plain(warning)}")
    folder = out or _stamped(loaded.name)
    with _progress(f"running {loaded.name}", quiet=as_json) as told:
        metrics = recorded(setup, folder, lambda doing, share: told(doing, share))
    if as_json:
        _print_json({"scenario": loaded.name, "out": str(folder), **metrics.as_dict()})
        return
    _print_metrics(loaded.name, metrics)
    _say(f"record, scores and picture: {_plain(str(folder))}")


@app.command()
def reproduce(out: Out = None, as_json: Json = False) -> None:
    """Repeat the paper's three experiments: figures 6-11, records, and a table ours | paper.

    Everything goes into out/reproduce unless --out names another folder; files of an earlier
    reproduction there are replaced.
    """
    from cohelm.study.reproduce import reproduce as repeat

    folder = out or Path("out/reproduce")
    with _progress("reproducing the paper", quiet=as_json) as told:
        result = repeat(folder, told)
    if as_json:
        _print_json(result.as_dict())
        return
    _print_table("The paper's experiments", ("quantity", "ours", "paper"), result.table())
    _say(f"figures 6–11, records and numbers: {_plain(str(folder))}")


@app.command()
def replay(
    record: Annotated[Path, typer.Argument(metavar="FILE", help="An MCAP file of `cohelm run`.")],
    as_json: Json = False,
) -> None:
    """Score a recorded run again; the numbers equal those of the run."""
    import warnings

    from cohelm.record.read import read
    from cohelm.study.metrics import measure

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        trace = read(record)
    for warning in caught:
        _say(f"[yellow]warning:[/yellow] {_plain(str(warning.message))}")
    metrics = measure(trace)
    if as_json:
        _print_json({"record": str(record), **metrics.as_dict()})
    else:
        _print_metrics(record.name, metrics)


@app.command()
def bench(as_json: Json = False) -> None:
    """Time the law and the simulator beside their peers; about a minute.

    Peers (cbfpy, ir-sim) are timed where they are installed: pip install "cohelm[peers]".
    """
    from cohelm.study.bench.compare import bench as measure

    with _progress("timing", quiet=as_json) as told:
        result = measure(told)
    if as_json:
        _print_json(result.as_json())
    else:
        _table_console().print(result.table())


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors that check YAML while you type."""
    from cohelm.scenario.schema import text

    print(text(), end="")


def _print_metrics(name: str, m: Metrics) -> None:
    windows = ", ".join(f"{a:.1f}–{b:.1f} s" for a, b in m.human_windows_s) or "never"
    back = ", ".join(f"{s:.1f} s" if s < float("inf") else "not again" for s in m.return_s) or "–"
    rows = [
        ("reached the end of the reference", "yes" if m.reached else "no"),
        ("contact of the outline", "YES" if m.contact else "none"),
        ("smallest clearance of the outline", f"{m.min_clearance_m:.3f} m at {m.min_clearance_at_s:.1f} s"),
        ("pose error E_P: max, rms, final", f"{m.max_pose_error:.3f}, {m.rms_pose_error:.3f}, {m.final_pose_error:.4f}"),
        *((f"smallest h, {n}", f"{d.min_h:.3f} m² at {d.at_s:.1f} s") for n, d in m.discs.items()),
        ("largest command asked", f"{m.max_speed_mps:.2f} m/s, {m.max_yaw_rate_radps:.2f} rad/s"),
        ("filter acted; wheels saturated", f"{m.filter_share:.1%}; {m.saturated_share:.1%} of the time"),
        ("the person led", windows),
        ("back on the path after that", back),
        ("duration, length driven", f"{m.duration_s:.1f} s, {m.path_length_m:.1f} m"),
    ]  # fmt: skip
    _print_table(name, ("quantity", "value"), rows)


def _print_table(title: str, headings: tuple[str, ...], rows: list[Any]) -> None:
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading)
    for row in rows:
        table.add_row(*(_plain(cell) for cell in row))
    _table_console().print(table)


def _table_console() -> Any:
    from rich.console import Console

    return Console(soft_wrap=False)


def _print_json(value: Mapping[str, Any]) -> None:
    print(json.dumps(value, indent=2, allow_nan=False))


def _say(text: str) -> None:
    """To the person, beside the result: on stderr."""
    from rich.console import Console

    Console(stderr=True, soft_wrap=True, highlight=False).print(text)


def _plain(text: str) -> str:
    """A text in which rich sees no markup."""
    from rich.markup import escape

    return escape(text)


@contextmanager
def _progress(what: str, *, quiet: bool) -> Generator[Callable[[str, float], None]]:
    """A bar on stderr that hears what is being done and the share that is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=quiet) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda doing, share: bar.update(
            task, description=f"{what}: {doing}", completed=min(share, 1.0)
        )


def _stamped(name: str) -> Path:
    from datetime import datetime

    safe = "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
    return Path("out") / f"{safe}-{datetime.now():%Y%m%d-%H%M%S}"
