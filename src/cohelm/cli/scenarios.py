"""Commands on scenarios and their records: run, reproduce, replay, bench, schema."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from cohelm.cli.app import app, end_as_by_ctrl_c, examples
from cohelm.cli.output import (
    Json,
    Out,
    console,
    named,
    plain,
    print_json,
    print_table,
    progress,
    say,
    typed,
    warnings_said,
)


@app.command(
    epilog=examples(
        "cohelm run minimal",
        "cohelm run lab-guard --set law.guard.hard_margin_m=0.05",
        "cohelm run my.yaml --stick tried.csv --out out/mine",
    )
)
def run(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario's YAML file, or the name of a shipped one: minimal, lab-guard, "
            "lab-track, lab-avoid, lab-shared, dock, open.",
        ),
    ],
    stick: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Play this stick file (CSV, plain or gzip) instead of the scenario's stick; "
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
    end_as_by_ctrl_c()
    with progress("starting") as bar:
        from cohelm.scenario import build, load
        from cohelm.study import single

        loaded = load.scenario(scenario, changes or [], stick)
        setup = build.setup(loaded)
        for warning in build.warnings(loaded):
            say(f"[yellow]warning:[/yellow] {plain(warning)}")
        folder = single.fresh(loaded.name) if out is None else out
        try:
            metrics = single.recorded(setup, folder, bar)
        except KeyboardInterrupt:
            if (folder / single.RECORD).exists():
                left = f"see what was run: cohelm replay {typed(folder / single.RECORD)}"
                say(f"[yellow]interrupted[/yellow]; {plain(left)}")
            raise
    if as_json:
        print_json({"scenario": loaded.name, "out": str(folder), **metrics.as_dict()})
    else:
        print_table(loaded.name, ("quantity", "value"), single.table(metrics))
        say(f"record, scores and picture: {plain(str(folder))}")


@app.command(epilog=examples("cohelm reproduce", "cohelm reproduce --out figures"))
def reproduce(out: Out = None, as_json: Json = False) -> None:
    """Repeat the paper's three experiments.

    Figures 6-11, records and a table ours | paper. Everything goes into out/reproduce unless
    --out names another folder; files of an earlier reproduction there are replaced.
    """
    end_as_by_ctrl_c()
    with progress("starting") as bar:
        from cohelm.study.reproduce import numbers, reproduce as repeat, table

        folder = out or Path("out/reproduce")
        result = repeat(folder, bar)
    if as_json:
        print_json(numbers(result))
    else:
        print_table("The paper's experiments", ("quantity", "ours", "paper"), table(result))
        say(f"figures 6–11, records and numbers: {plain(str(folder))}")


@app.command(
    epilog=examples("cohelm replay out/minimal-20261126-120000", "cohelm replay drive.mcap --json")
)
def replay(
    record: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", parser=named, help="A record of `cohelm run`, or the folder it is in."
        ),
    ],
    as_json: Json = False,
) -> None:
    """Compute the scores of a recorded run.

    The numbers equal those of the run. A record that was cut short is scored up to there, with
    exit status 1.
    """
    with progress("reading") as bar:
        from cohelm.record.read import read
        from cohelm.study.metrics import measure
        from cohelm.study.single import RECORD, table

        if record.is_dir():
            record = record / RECORD
        bar(f"reading {record}", 0.0)
        with warnings_said() as caught:
            metrics = measure(read(record))
    if as_json:
        fault = str(caught[0].message) if caught else None
        whole = {"record_whole": not caught, "record_fault": fault}
        print_json({"record": str(record), **whole, **metrics.as_dict()})
    else:
        cut = [("record", "NOT WHOLE, see above")] if caught else []
        print_table(str(record), ("quantity", "value"), cut + table(metrics))
    if caught:
        raise typer.Exit(1)


@app.command(epilog=examples("cohelm bench", "cohelm bench --json"))
def bench(as_json: Json = False) -> None:
    """Time it beside its peers, in a minute.

    One step of the law, a run, and episodes of the campaigns. Peers (cbfpy, ir-sim) are timed
    where the extra `peers` is installed.
    """
    with progress("starting") as bar:
        result = _benchmark().bench(bar)
    if as_json:
        print_json(result.as_json())
    else:
        console().print(result.table())


def _benchmark() -> Any:
    """The measuring, which lies in a wheel beside this package, and in a checkout at its top."""
    from importlib import import_module
    from importlib.util import find_spec

    if find_spec("cohelm.bench") is not None:
        return import_module("cohelm.bench.compare")
    sys.path.insert(0, str(Path(__file__).parents[3]))
    return import_module("benchmarks.bench.compare")


@app.command(epilog=examples("cohelm schema > scenario.schema.json"))
def schema() -> None:
    """Print the JSON Schema of scenarios.

    For editors that check YAML while you type.
    """
    from cohelm.scenario.schema import text

    print(text(), end="")
