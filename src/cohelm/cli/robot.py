"""The command `robot`: drives a robot."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cohelm.cli.app import app, examples, idle_together, idle_without
from cohelm.cli.drive_options import (
    CarryOn,
    Changes,
    Chart,
    KeepOut,
    OwnDriver,
    RobotOrScenario,
    Ros2,
    Seconds,
    Seed,
    Site,
    SpeedZones,
    Twin,
)
from cohelm.cli.live import Foxglove, FoxgloveTeleop, live, shown_at
from cohelm.cli.output import Json, Pictures, named, plain, print_json, print_table, say, starting
from cohelm.cli.print_config import PrintConfig, print_found
from cohelm.cli.ros import Bridge, LockTimeout, MasksFrom, TopicNames, Transports, on_ros

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from contextlib import AbstractContextManager

    from cohelm.drive.factory import OwnRobot, RobotFactory
    from cohelm.drive.session import Session
    from cohelm.link.messages import Mode


@app.command(
    epilog=examples(
        "cohelm robot lab-guard --mode automatic --arrive --record drive.mcap",
        "cohelm robot my-robot.yaml --driver my_package:MyRobot --listen 0.0.0.0",
        "cohelm robot my-robot.yaml --ros2 --map map.yaml --goals-from /goal_pose",
    )
)
def robot(
    context: typer.Context,
    name: RobotOrScenario = None,
    scenario: Site = None,
    driver: OwnDriver = None,
    ros2: Ros2 = False,
    topics: TopicNames = None,
    lock_timeout: LockTimeout = None,
    transport: Transports = "auto",
    url: Bridge = "",
    map_frame: Annotated[
        str, typer.Option(metavar="FRAME", help="With --ros2: the map's frame on /tf.")
    ] = "map",
    transforms: Annotated[
        bool, typer.Option("--tf/--no-tf", help="With --ros2: publish map -> odom on /tf.")
    ] = True,
    goals_from: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TOPIC",
            help="With --ros2: follow the goals (PoseStamped) or paths (Path) on this topic; any "
            "node that publishes there directs the robot. Repeat it for more topics.",
        ),
    ] = None,
    initial_pose_from: Annotated[
        str,
        typer.Option(
            metavar="TOPIC",
            help="With --ros2: topic of initial poses, taken while it stands; RViz: /initialpose.",
        ),
    ] = "",
    joy: Annotated[
        str,
        typer.Option(
            metavar="TOPIC",
            help="With --ros2: the joystick (sensor_msgs/msg/Joy) on this topic steers.",
        ),
    ] = "",
    joy_param: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="As teleop_twist_joy has: axis_linear.x=5, axis_angular.yaw=2, enable_button=5, "
            "require_enable_button=true; also hold_to_run=false.",
        ),
    ] = None,
    reset_from: Annotated[
        str,
        typer.Option(
            metavar="TOPIC",
            help="With --ros2: std_msgs/msg/Empty on this topic resets a latched stop.",
        ),
    ] = "",
    twin: Twin = False,
    mode: Annotated[
        str,
        typer.Option(
            metavar="MODE",
            help="hold, automatic, shared or manual; by default shared with a stick file or "
            "--joy, else automatic. A real robot without --scenario follows no route: hold, or "
            "manual with --joy.",
        ),
    ] = "",
    dock: Annotated[
        str,
        typer.Option(metavar="NAME", help="Drive to this dock, from its approach, and end there."),
    ] = "",
    rate: Annotated[
        float, typer.Option(metavar="HZ", min=10.0, max=500.0, help="Control periods a second.")
    ] = 50.0,
    seconds: Seconds = None,
    arrive: Annotated[bool, typer.Option("--arrive", help="End when the route is done.")] = False,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FILE", parser=named, help="Record into this MCAP file."),
    ] = None,
    pictures: Pictures = 5.0,
    chart: Chart = None,
    keep_out: KeepOut = None,
    speed_zones: SpeedZones = None,
    masks_from: MasksFrom = None,
    carry_on: CarryOn = False,
    fast: Annotated[
        bool, typer.Option("--fast", help="Simulated time: as fast as possible.")
    ] = False,
    seed: Seed = None,
    listen: Annotated[
        str | None,
        typer.Option(metavar="HOST[:PORT]", help="Paired stations drive it, see `cohelm pair`."),
    ] = None,
    foxglove: Foxglove = None,
    foxglove_teleop: FoxgloveTeleop = False,
    changes: Changes = None,
    print_config: PrintConfig = False,
    as_json: Json = False,
) -> None:
    """Drive a robot in real time until stopped.

    The robot senses with odometry and LiDAR only, localises on the scenario's walls, follows the
    route and keeps clear. Ctrl-C stops the robot first, and ends when it stands.

    With --listen 0.0.0.0 it stands until a paired station takes over (`cohelm station --robot`). A
    robot of --driver or --ros2 follows a route only where --scenario names one.
    """
    from cohelm.cli.terminal import shown
    from cohelm.core.errors import CohelmError
    from cohelm.core.files import taken
    from cohelm.drive.factory import OwnRobot
    from cohelm.drive.on_topics import TopicsConfig, on_topics
    from cohelm.drive.operate import (
        DriveOptions,
        end_signals,
        map_and_zones,
        masks_on_topics,
        mode_and_stick,
        remarks,
        robot_factory,
    )
    from cohelm.drive.reset_here import ResetHere
    from cohelm.drive.session import SessionConfig
    from cohelm.drive.until_ended import drive_for_stations, drive_here, goal_of
    from cohelm.link import keys
    from cohelm.link.messages import Mode
    from cohelm.link.udp import PORT, address
    from cohelm.loop.loop import LoopParams
    from cohelm.ros.joy import joy_params
    from cohelm.ros.names import resolved

    idle_together(context, ("--driver", "--ros2"), "--kinematic")
    idle_without(context, "--pictures", "--record", "--listen", "--foxglove")
    options = DriveOptions(
        name=name, scenario=scenario, kind="twin" if twin else "kinematic", real_time=not fast,
        seed=seed, changes=changes or [], driver=driver,
        ros2=on_ros(ros2, topics, transport, url, lock_timeout, masks_from, map_frame),
        chart=chart, keep_out=keep_out, speed_zones=speed_zones,
    )  # fmt: skip
    if listen is not None and (mode or arrive or fast or dock):
        raise CohelmError(
            "with --listen the station chooses mode and goal: leave out --mode, --dock, --arrive "
            "and --fast"
        )
    if listen is None and foxglove_teleop:
        raise CohelmError(
            "--foxglove-teleop takes the lease as a station does, and without --listen there is "
            "none: add --listen 127.0.0.1, or use cohelm drive"
        )
    if listen is not None and joy:
        raise CohelmError("with --listen the sticks of stations steer: leave out --joy")
    if listen is not None and reset_from:
        raise CohelmError("with --listen a station resets it: leave out --reset-from")
    if joy_param and not joy:
        raise CohelmError("--joy-param is of a joystick on a topic: name that with --joy /joy")
    if record is not None and record.exists():  # reported now, and not when all is compiled
        raise taken(record)
    parameters = joy_params(joy_param or ())
    for topic in (*(goals_from or ()), initial_pose_from, joy, reset_from, *(masks_from or ())):
        if topic:
            resolved(topic)  # report a malformed name before looking for a robot
    if dock and (mode or arrive or goals_from):
        raise CohelmError(
            "--dock is how and where to drive: leave out --mode, --arrive and --goals-from"
        )
    if listen is not None:
        address(listen, PORT)
    made = robot_factory(options)
    masks = masks_on_topics(options, made)
    chosen_map, zones = map_and_zones(options, made, masks)
    if print_config:
        others = {
            "goals": goals_from or (), "initial_pose": (initial_pose_from,), "joy": (joy,),
            "reset": (reset_from,), "masks": masks_from or (),
        }  # fmt: skip
        _print_config(made, others, as_json)
        return
    plan = SessionConfig(
        made, rate, record, live(foxglove, foxglove_teleop), chosen_map, zones=zones,
        loop=LoopParams(carry_on=carry_on), pictures=pictures,
    )  # fmt: skip
    begins = f"starting {plain(made.model.name)} in {plain(made.scenario.name)}"
    if remark := remarks(made):
        begins += f"; {remark}"
    if listen is None and chosen_map is None and len(made.scenario.walls()) == 0:
        begins += "; no --map or walls to localize on: it uses its odometry"
    config = TopicsConfig(
        map_frame, transforms, tuple(goals_from or ()), initial_pose_from, joy, parameters,
        reset_from, masks,
    )  # fmt: skip
    chosen = None
    if listen is None:
        chosen = mode_and_stick(made, mode, bool(joy and not dock), bool(goals_from))
        goal_of(plan, chosen[0], arrive, dock)
    reset = ResetHere(Mode.HOLD if chosen is None else chosen[0], lambda text: say(plain(text)))
    topics_too = on_topics(made, config, lambda text: say(plain(text)), reset.ask)
    say(begins)
    if isinstance(made, OwnRobot) and not made.site_named:
        say(_without_site(made, None if chosen is None else chosen[0]))
    if listen is not None and not keys.stations() and not foxglove_teleop:
        say("no station is paired yet, so no operator can drive: cohelm pair new STATION")
    with (
        redirect_stdout(sys.stderr),  # what its own code prints is no result
        starting(made.model.name) as line, end_signals() as stop, topics_too as beside,
    ):  # fmt: skip

        def on_start(session: Session) -> AbstractContextManager[None]:
            line.over()
            shown_at(plan.live)
            return shown(session, reset, beside.resets)

        def on_listening(at: str) -> None:
            line.over()
            say(f"listening on {at}; robot {plain(keys.robot().name)}, Ctrl-C ends it")
            shown_at(plan.live)

        if chosen is None:
            summary = drive_for_stations(plan, listen or "", stop, seconds, beside, on_listening)
        else:
            how, stick = chosen
            summary = drive_here(
                plan, how, beside.joy or stick, stop, seconds, arrive, beside, dock, reset, on_start
            )  # fmt: skip
    _print_summary(made.scenario.name, summary, as_json)


def _without_site(made: OwnRobot, mode: Mode | None) -> str:
    """What it means that no site was named. mode: to start in; None: stations choose it."""
    from cohelm.link.messages import Mode

    if mode is not Mode.HOLD:
        return f"no --scenario: its site is {plain(made.scenario.name)}, without map and route"
    return (
        "no --scenario: it stands, and follows no route. Name its site, or what leads it: "
        "--listen, --goals-from or --joy"
    )


def _print_config(made: RobotFactory, others: Mapping[str, Sequence[str]], as_json: bool) -> None:
    """Print the configuration found of a ROS 2 robot. others: topics of further options, by their
    use. Raises CohelmError for another robot."""
    from cohelm.core.errors import CohelmError
    from cohelm.drive.factory import OwnRobot
    from cohelm.ros.names import resolved
    from cohelm.ros.robot import Ros2Make

    if not isinstance(made, OwnRobot) or not isinstance(made.make, Ros2Make):
        raise CohelmError("--print-config is of a ROS 2 robot: add --ros2")
    found = made.make.found
    topics: dict[str, tuple[str, ...]] = {
        key: (one,) for key, one in found.topics.by_use(found.model).items()
    }
    del topics["command"]  # of other controllers: cohelm is the only one
    if found.camera is not None:
        topics["camera"] = (found.camera.name,)
    space = found.topics.namespace
    for key, several in others.items():
        if named := tuple(resolved(one, space) for one in several if one):
            topics[key] = named
    for note in found.notes:
        say(plain(note))
    print_found(found, made.model, topics, as_json)


def _print_summary(name: str, summary: dict[str, Any], as_json: bool) -> None:
    """Print the summary of the drive; exit with status 1 if it failed."""
    failed = failures(summary)
    if as_json:
        print_json(summary | {"failed": failed})
    else:
        print_table(name, ("quantity", "value"), rows(summary))
    for one in failed:
        say(f"[bold red]failed:[/bold red] {plain(one)}")
    if failed:
        raise typer.Exit(1)


def failures(summary: dict[str, Any]) -> list[str]:
    """What failed in a drive, a sentence each: with any of them the exit status is 1."""
    found: list[str] = []
    if summary["docked"] is False:
        found.append(f"it has not docked: {summary['docking'] or summary['reason']}")
    if summary["faulted"]:
        found.append(f"the robot stopped itself: {summary['reason']}")
    if summary["not_begun"]:
        found.append(f"it never drove: {summary['not_begun']}")
    share = summary["lost_share"] or 0.0
    if summary["lost"] or share > 0.5:  # found again, but lost for longer than it was localized
        when = "at the end" if summary["lost"] else "for most of the drive"
        lost = f"{when} the robot was not localized on the map ({share:.0%} of the time)"
        cure = ": does the map fit, and the start?"
        found.append(lost if summary["faulted"] or summary["not_begun"] else lost + cure)
    if summary["record_whole"] is False:
        found.append(f"the record is not whole: {summary['record_fault']}")
    if summary["live"] is False:
        found.append("the live view ended before the drive")
    return found


def rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """The summary as a table; `--json` has every number."""
    from cohelm.drive.session import SIMULATED_TIME

    periods = summary.get("periods", 0)
    clearance, lost = summary["least_clearance_moving_m"], summary["lost_share"]
    found = [
        ("robot", f"{summary['robot']} ({summary['kind']})"),
        ("ended", f"{summary['mode'].lower()}: {summary['reason']}"),
        ("the route is done", "yes" if summary["arrived"] else "no"),
    ]
    if summary["route"]:
        found.append(("the route", summary["route"]))
    if summary["docking"]:
        found.append(("docking", summary["docking"]))
    if clearance is not None:
        found.append(("smallest clearance while moving", f"{clearance:.3f} m"))
    if lost is not None:
        found.append(("localized", f"{1.0 - lost:.1%} of the time"))
    if periods:
        seconds, rate = periods / summary["rate_hz"], summary["rate_hz"]
        found.append(("driven for", f"{seconds:.1f} s at {rate:g} Hz"))
    if periods and "within_2ms" in summary and summary["scheduling"] != SIMULATED_TIME:
        found += [
            ("periods in time (within 2 ms)", f"{summary['within_2ms']:.2%} of {periods}"),
            ("latest period", f"{1e3 * summary['late_worst']:.1f} ms late"),
            ("work in a period, usual and most",
             f"{1e3 * summary['took_median']:.1f} and {1e3 * summary['took_worst']:.1f} ms"),
            ("periods whose work took too long", f"{summary['overruns']}"),
        ]  # fmt: skip
    found.append(("proposals the gate refused", f"{summary['refused']}"))
    found.append(("scheduling", summary["scheduling"]))
    if summary["live"] is not None:
        whole = "to the end" if summary["live"] else "ended before the drive"
        found.append(("live view", whole))
    if summary["record"]:
        dropped = summary["record_dropped"]
        whole = "whole" if summary["record_whole"] else "NOT WHOLE"
        missing = f", {dropped} messages dropped" if dropped else ""
        found.append(("record", f"{summary['record']} ({whole}{missing})"))
    return found
