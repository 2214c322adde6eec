"""The command that measures a robot: calibrate."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

from cohelm.cli.app import app, examples, idle_together
from cohelm.cli.drive_options import Twin
from cohelm.cli.output import Json, named, plain, print_json, print_table, progress, say, starting
from cohelm.cli.ros import Bridge, LockTimeout, TopicNames, Transports, on_ros


@app.command(
    epilog=examples("cohelm calibrate sally", "cohelm calibrate my-robot.yaml --ros2 --floor 3")
)
def calibrate(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="A shipped robot, or its file.")],
    scenario: Annotated[
        str, typer.Option(metavar="SCENARIO", help="Where a simulated robot stands.")
    ] = "lab-track",
    driver: Annotated[
        str | None, typer.Option(metavar="PACKAGE:CLASS", help="Your own robot.")
    ] = None,
    ros2: Annotated[bool, typer.Option("--ros2", help="It is a ROS 2 robot.")] = False,
    topics: TopicNames = None,
    lock_timeout: LockTimeout = None,
    transport: Transports = "auto",
    url: Bridge = "",
    twin: Twin = False,
    floor: Annotated[
        float,
        typer.Option(metavar="METRES", min=0.5, max=50.0, help="Free floor ahead of the robot."),
    ] = 4.0,
    load: Annotated[
        bool,
        typer.Option("--load", help="It carries a load now: merge with the run without, in --out."),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="The floor is free: drive without asking.")
    ] = False,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", parser=named, help="Folder to write into.")
    ] = Path("out/calibrate"),
    as_json: Json = False,
) -> None:
    """Measure a robot by driving it; write its YAML file.

    It prints how much free floor it needs, and asks. It drives straight and turns on the spot,
    through the gate, and compares the model with the measurements. Ctrl-C stops the robot, and
    keeps what was measured.
    """

    from cohelm.calibrate.excitation import excitation
    from cohelm.calibrate.mount import mount
    from cohelm.calibrate.pictures import pictures
    from cohelm.calibrate.response import response
    from cohelm.calibrate.rewrite import rewritten
    from cohelm.calibrate.ride import PERIOD, ride
    from cohelm.calibrate.verdict import (
        as_dict,
        earlier_run,
        findings,
        odometry_noise,
        whole_run,
        with_load,
    )
    from cohelm.core.errors import CohelmError
    from cohelm.core.files import alone, write_json
    from cohelm.drive.operate import DriveOptions, end_signals, robot_factory
    from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
    from cohelm.robot.keep.priority import raise_priority, restore_priority
    from cohelm.robot.keep.process import RemoteGatedRobot
    from cohelm.robot.model import SHIPPED, RobotModel, shipped_path
    from cohelm.scenario.load import load_robot, parse

    idle_together(context, ("--driver", "--ros2"), "--scenario", "--kinematic")
    file = Path(shipped_path(name) if name in SHIPPED else name)
    model = load_robot(name)
    context.with_resource(alone(out))
    before = out / "calibration.json"
    earlier = earlier_run(before, model.name) if load else None
    if measured := "" if load else whole_run(before):
        raise CohelmError(
            f"{out} holds what was measured of {measured} already: choose another folder with "
            "--out, or add to it a run with a load (--load)"
        )
    plan = excitation(model, floor)
    kind = "twin" if twin else "kinematic"
    named = name if driver is not None or ros2 else str(file)
    where = on_ros(ros2, topics, transport, url, lock_timeout)
    made = robot_factory(DriveOptions(named, scenario, kind, True, None, [], driver, where))
    say(
        f"{plain(model.name)} needs {plan.length:.1f} m of free floor ahead and "
        f"{plan.radius:.1f} m to either side and behind; it drives up to {plan.speed:.2f} m/s and "
        f"{plan.turn:.2f} rad/s for about {plan.seconds:.0f} s, "
        "with walls in sight that stay where they are"
    )
    if not yes and not _agreed():
        raise CohelmError("nothing was driven: answer y when the floor is free, or give --yes")
    with (
        starting(model.name) as line,
        end_signals() as stop,
        redirect_stdout(sys.stderr),  # what the robot's own code prints is no result
    ):
        maker, gate = made.maker(), rules(made.model, PERIOD)
        # a clock of its own stands still between two calls: no other process can read it
        gated = RemoteGatedRobot(maker, gate) if made.real_time else LocalGatedRobot(maker(), gate)
        try:
            stop.handle_signals()
            line.over()
            if made.real_time:
                raise_priority()
            with progress("driving") as bar:
                driven = ride(gated, plan, lambda: stop.reason, bar)
        finally:
            restore_priority()
            gated.close()
    answered = response(made.model, driven)
    placed, unplaced = None, ""
    try:
        placed = mount(made.model, driven)
    except CohelmError as error:
        unplaced = str(error)
    if driven.ended:
        say(f"[bold red]not whole:[/bold red] {plain(driven.ended)}; what was measured is used")
    if unplaced:
        say(f"[bold red]wheels, track and LiDAR are not measured:[/bold red] {plain(unplaced)}")
    found = findings(made.model, answered, placed, made.delay(0.0) - made.model.delay_s)
    noise = odometry_noise(made.model, answered)
    if earlier is not None:
        found, noise = with_load(found, earlier[0]), earlier[1]
    values = noise | {one.key: one.write for one in found if one.write != one.assumed}
    text = rewritten(file.read_text(encoding="utf-8"), values)
    parse(text, RobotModel, str(file))
    written, unwritten = out / f"{model.name}.yaml", ""
    result: dict[str, Any] = {
        "robot": model.name, "file": str(written), "with_load": load, "whole": not driven.ended,
        "ended": driven.ended or None, "findings": as_dict(found), "odometry": noise,
        "lag_s": answered.straight.lag.value, "lag_off_s": answered.straight.lag.off,
        "turn_lag_s": answered.turn.lag.value, "turn_lag_off_s": answered.turn.lag.off,
        "not_measured": unplaced or None,
    }  # fmt: skip
    try:
        out.mkdir(parents=True, exist_ok=True)
        written.write_text(text, encoding="utf-8")
        result["pictures"] = [str(one) for one in pictures(out, driven, answered, placed)]
        write_json(before, result)
    except OSError as error:  # the result is printed all the same
        unwritten = f"{out} can not be written ({error.strerror}): what was measured stands above"
    if as_json:
        print_json(result)
    else:
        print_table(
            model.name, ("key", "assumed", "measured", "verdict", "because"),
            [(one.key, "none" if one.assumed is None else f"{one.assumed:.4g}",
              f"{one.measured.value:.4g} +- {one.measured.off:.2g}", one.verdict, one.why)
             for one in found],
        )  # fmt: skip
    if unwritten:
        raise CohelmError(unwritten)
    if not as_json:
        say(f"written: {plain(str(written))}; look at the pictures beside it")
    if driven.ended or unplaced:
        raise typer.Exit(1)


def _agreed() -> bool:
    """A person's answer; no, if there is no terminal."""
    try:
        return typer.confirm("is the floor free, and the stop at hand?", err=True)
    except typer.Abort:
        if sys.stdin.isatty():
            raise
        print(file=sys.stderr)
        return False
