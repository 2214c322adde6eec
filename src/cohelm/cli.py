"""The command `cohelm`: thin commands, each importing what it needs when it is called."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from cohelm import __version__
from cohelm.core.errors import CohelmError

app = typer.Typer(
    name="cohelm",
    help="Shared control with obstacle avoidance for uncrewed ground vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help is there in a third of the time, and reads as well
    epilog="Start with `cohelm run minimal`, or `cohelm reproduce`.",
)

Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder to write into.")
]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object, on stdout.")]

USER_ERROR = 2
_MOST_PROBLEMS = 20
"""Of a scenario's problems, no more than these are printed."""


def main() -> None:
    """Run the command line: one sentence and code 2 for what the user can mend, 130 on Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that has no m² shows m?
    try:
        try:
            app()
        finally:
            if sys.stdout is not None:  # pyright: ignore[reportUnnecessaryComparison]  # `>&-`
                sys.stdout.flush()
    except CohelmError as error:
        lines = str(error).splitlines()
        for line in lines[:_MOST_PROBLEMS]:
            _say(f"[bold red]error:[/bold red] {_plain(line)}")
        if lines[_MOST_PROBLEMS:]:
            _say(f"... and {len(lines) - _MOST_PROBLEMS} more")
        sys.exit(USER_ERROR)
    except OSError as error:
        # Nothing more can be written there, and Python must not try again when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):  # that one is `cohelm ... | head`
            where = str(error.filename or "what is printed, or compiled code (COHELM_CACHE_DIR),")
            said = f"{where} can not be written ({error.strerror}): free some space"
            _say(f"[bold red]error:[/bold red] {_plain(said)}")
        sys.exit(1)


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
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario's YAML file, or the name of one that comes with cohelm: minimal, "
            "lab-track, lab-avoid, lab-shared.",
        ),
    ],
    stick: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Play this stick file (CSV, plain or gzip) instead of the scenario's hand; "
            "FILE#3 takes run 3 of a file that holds several.",
        ),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change one value, e.g. law.barrier.k_cbf=1.0; may be given several times.",
        ),
    ] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Run one scenario into a folder.

    There it leaves record.mcap, scenario.yaml (which makes the same run again), metrics.json,
    run.png and run.svg. The folder is out/NAME-DATE-TIME unless --out names one; that one may
    exist and hold other files, but nothing in it is ever overwritten.
    """
    with _progress("starting") as told:
        from cohelm.scenario import build, load
        from cohelm.study import single

        loaded = load.scenario(scenario, changes or [], stick)
        setup = build.setup(loaded)
        for warning in build.warnings(loaded):
            _say(f"[yellow]warning:[/yellow] {_plain(warning)}")
        folder = single.fresh(loaded.name) if out is None else out
        try:
            metrics = single.recorded(setup, folder, told)
        except KeyboardInterrupt:
            if (folder / single.RECORD).exists():
                left = f"; see what was run: cohelm replay {folder / single.RECORD}"
                _say(f"[yellow]interrupted[/yellow]{_plain(left)}")
            raise
    if as_json:
        _print_json({"scenario": loaded.name, "out": str(folder), **metrics.as_dict()})
    else:
        _print_table(loaded.name, ("quantity", "value"), single.table(metrics))
        _say(f"record, scores and picture: {_plain(str(folder))}")


@app.command()
def reproduce(out: Out = None, as_json: Json = False) -> None:
    """Repeat the paper's three experiments.

    Figures 6-11, records and a table ours | paper. Everything goes into out/reproduce unless
    --out names another folder; files of an earlier reproduction there are replaced.
    """
    with _progress("starting") as told:
        from cohelm.study.reproduce import reproduce as repeat

        folder = out or Path("out/reproduce")
        result = repeat(folder, told)
    if as_json:
        _print_json(result.as_dict())
    else:
        _print_table("The paper's experiments", ("quantity", "ours", "paper"), result.table())
        _say(f"figures 6–11, records and numbers: {_plain(str(folder))}")


@app.command()
def replay(
    record: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A record of `cohelm run`, or the folder it is in."),
    ],
    as_json: Json = False,
) -> None:
    """Score a recorded run again.

    The numbers equal those of the run. From a record that was cut short, as far as it goes.
    """
    with _progress("reading") as told:
        import warnings

        from cohelm.record.read import read
        from cohelm.study.metrics import measure
        from cohelm.study.single import RECORD, table

        if record.is_dir():
            record = record / RECORD
        told(f"reading {record}", 0.0)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            metrics = measure(read(record))
    for warning in caught:
        _say(f"[yellow]warning:[/yellow] {_plain(str(warning.message))}")
    if as_json:
        _print_json({"record": str(record), **metrics.as_dict()})
    else:
        _print_table(str(record), ("quantity", "value"), table(metrics))


@app.command()
def bench(as_json: Json = False) -> None:
    """Time it beside its peers, in a minute.

    One step of the law, and the simulator with many robots. Peers (cbfpy, ir-sim) are timed
    where they are installed: pip install "cohelm[peers]".
    """
    with _progress("starting") as told:
        from cohelm.study.bench.compare import bench as measure

        result = measure(told)
    if as_json:
        _print_json(result.as_json())
    else:
        _console().print(result.table())


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenarios.

    For editors that check YAML while you type.
    """
    from cohelm.scenario.schema import text

    print(text(), end="")


def _print_table(title: str, headings: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    from rich.table import Table

    table = Table(title=_plain(title), title_justify="left")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*(_plain(cell) for cell in row))
    _console().print(table)


def _console(*, stderr: bool = False) -> Any:
    from rich.console import Console

    return Console(stderr=stderr, soft_wrap=stderr, highlight=False)


def _print_json(value: Mapping[str, Any]) -> None:
    print(json.dumps(value, indent=2, allow_nan=False))


def _say(text: str) -> None:
    """To the person, beside the result: on stderr."""
    _console(stderr=True).print(text)


def _plain(text: str) -> str:
    """A text in which rich sees no markup, and the terminal no command."""
    from rich.markup import escape

    return escape("".join(c if c.isprintable() else "�" for c in text))


@contextmanager
def _progress(what: str) -> Generator[Callable[[str, float], None]]:
    """A bar on stderr, if a person is there to see it, that hears what is done and its share."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = _console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    hidden = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda doing, share: bar.update(task, description=doing, completed=min(share, 1.0))
