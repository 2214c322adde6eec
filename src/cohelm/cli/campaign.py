"""The command `campaign`: runs, evaluates and reports many episodes of a suite."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.app import app, end_as_by_ctrl_c, examples, idle_together
from cohelm.cli.output import Json, Out, named, plain, print_json, print_table, progress, say, typed
from cohelm.core.errors import CohelmError
from cohelm.core.extras import missing

if TYPE_CHECKING:
    from cohelm.study.campaign.runner import CampaignConfig


@app.command(
    epilog=examples(
        "cohelm campaign lab --n 20",
        "cohelm campaign random --n 100 --compare guard,paper,none",
        "cohelm campaign random --n 100 --plant twin --out out/rooms",
        "cohelm campaign random --n 100 --robot turtlebot4",
        "cohelm campaign out/rooms --replay 17",
    )
)
def campaign(
    context: typer.Context,
    suite: Annotated[
        str,
        typer.Argument(
            metavar="SUITE",
            help="lab, random, movers, barn, crowd, adversary, hands or heights; or the folder of "
            "a campaign, to continue it with its own options.",
        ),
    ],
    law: Annotated[
        str | None,
        typer.Option(
            metavar="LAW",
            help="guard (the default), paper, none, or PACKAGE:FACTORY, a law of your own.",
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="LAW,LAW",
            help="Several laws on the same episodes, e.g. guard,paper,none; in random and "
            "movers also rvo and vo, controllers of ir-sim; PACKAGE:FACTORY is a law of your own.",
        ),
    ] = None,
    n: Annotated[
        int | None, typer.Option("--n", metavar="N", help="Episodes; each suite has a default.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="S", help="Of everything random; 1 by default.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="J", help="Processes: as many as processors by default, four times at most."
        ),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            parser=named,
            help="Worlds and recordings made by others: needed by barn, crowd and hands.",
        ),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            metavar="PLANT",
            help="kinematic, or twin, twin-rear (a second LiDAR behind), twin-all-round: MuJoCo, "
            "knowing only what its sensors say. lab, random, movers and adversary are driven on "
            "any, heights on the twin, others on kinematic; the first of these by default.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="Drives instead of the suite's own robot: a YAML file, or a shipped one's name. "
            "random, movers and adversary.",
        ),
    ] = None,
    out: Out = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Drive on this Dask scheduler instead.")
    ] = None,
    replay: Annotated[
        str | None,
        typer.Option(
            metavar="ROW",
            help="With a campaign's folder: drive one row again, NUMBER or LAW/NUMBER, and "
            "record it.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Run many episodes and report the results.

    Rows go to the folder as they come; interrupted or killed, the same command with the same
    --out goes on. At the end it holds report.html. The folder is out/campaign-SUITE-DATE-TIME
    unless --out names one.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise missing("a campaign", "campaign")
    idle_together(context, ("--replay", "--cluster"), "--jobs")
    idle_together(context, ("--replay",), "--cluster")
    if replay is not None:
        _check_own(Path(suite), (law, compare, n, seed, data, plant, robot))
        _again(Path(suite), replay, out, as_json)
        return
    with progress("starting") as bar:
        from cohelm.study import single
        from cohelm.study.campaign import report, runner, store

        folder, plan = _planned(suite, law, compare, n, seed, data, plant, robot, out)
        jobs = runner.processors() if jobs is None else jobs
        runner.check(plan, jobs)  # problems are reported before a folder is made
        folder = folder or single.fresh(f"campaign-{plan.suite}")
        end_as_by_ctrl_c()
        try:
            made, rows = runner.run(plan, folder, jobs, cluster, bar)
            found = report.outcome(made, plan.laws, rows, store.origin(folder))
            page = report.written(folder) or report.write(found, folder, bar)
        except KeyboardInterrupt:
            say(
                "[yellow]interrupted[/yellow]; finished episodes are kept, continue with: "
                f"cohelm campaign {plain(typed(folder))}"
            )
            raise
    failed = list(report.faults(found))
    if as_json:
        files = {"out": str(folder), "report": str(page)}
        print_json({**found.as_dict(), **files, "failed": failed})
    else:
        print_table(f"{report.made_on(found)}, seed {plan.seed}", *report.table(found))
        say(f"rows and report: {plain(str(page))}")
    if failed:
        more = f" (and {len(failed) - 1} more, in the report)" if len(failed) > 1 else ""
        say(f"[bold red]failed:[/bold red] {plain(failed[0])}{more}")
        raise typer.Exit(1)


def _planned(
    suite: str, law: str | None, compare: str | None, n: int | None, seed: int | None,
    data: Path | None, plant: str | None, robot: str | None, out: Path | None,
) -> tuple[Path | None, CampaignConfig]:  # fmt: skip
    """The folder, if one is named, and the plan, by the command line or by that folder."""
    from cohelm.scenario.load import load_robot
    from cohelm.study.campaign import runner
    from cohelm.study.campaign.suites import NAMES

    folder = Path(suite)
    if suite not in NAMES and folder.is_dir():
        plan = runner.planned(folder)
        _check_own(folder, (law, compare, n, seed, data, plant, robot, out))
        return folder, plan
    if "/" in suite:
        raise CohelmError(f"{suite}: there is no such folder; give a suite or a campaign's folder")
    if law and compare:
        raise CohelmError("give either --law or --compare, not both")
    chosen = compare if compare is not None else "guard" if law is None else law
    laws = tuple(part.strip() for part in chosen.split(","))
    model = None if robot is None else load_robot(robot)
    seed = 1 if seed is None else seed
    return out, runner.CampaignConfig(suite, laws, seed, n, data, plant, model)


def _check_own(folder: Path, given: tuple[object, ...]) -> None:
    """CohelmError where anything is given that the campaign in a folder has already."""
    if any(option is not None for option in given):
        raise CohelmError(
            f"{folder} continues with its own options: leave out --law, --compare, --n, --seed, "
            "--data, --plant, --robot and, but for --replay, --out"
        )


def _again(folder: Path, which: str, out: Path | None, as_json: bool) -> None:
    with progress("driving again"):
        from cohelm.study.campaign import replay_episode
        from cohelm.study.metrics import plain as values

        found, there = replay_episode.again(folder, which, out)
        replay_episode.record(found, there)
    if not found.same:
        say(
            "[yellow]warning:[/yellow] this differs from the campaign's row: code or data "
            "have changed since"
        )
    if as_json:
        row = values(found.row._asdict())
        print_json({**row, "same_as_row": found.same, "out": str(there)})
    else:
        rows = [
            (name, "–" if value != value else str(value))  # NaN
            for name, value in found.row._asdict().items() if value not in ([], "")
        ]  # fmt: skip
        print_table(f"{found.law}/{found.row.episode}", ("quantity", "value"), rows)
        say(f"record, row and picture: {plain(str(there))}")
