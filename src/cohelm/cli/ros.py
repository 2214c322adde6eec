"""The ROS 2 commands: filter, and base to try it without a robot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cohelm.cli.app import app, examples, idle_without
from cohelm.cli.drive_options import RobotOrScenario, Seconds, Seed, Twin
from cohelm.cli.output import Json, plain, print_json, say, starting
from cohelm.cli.parameters import from_file
from cohelm.cli.print_config import PrintConfig, print_found

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cohelm.drive.operate import Ros2Config
    from cohelm.ros.found import Found

TopicNames = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="KEY=NAME",
        help="With --ros2: another topic for odom, scan, scan_NAME, contact_NAME, out, lock, "
        "footprint or camera (pictures), or the namespace.",
    ),
]
Transports = Annotated[
    str,
    typer.Option("--transport", metavar="auto|dds|foxglove|zenoh", help="Transport to the robot."),
]
Bridge = Annotated[
    str,
    typer.Option(
        "--url",
        metavar="ws://ROBOT:8765|tcp/ROBOT:7447",
        help="Address of the robot's foxglove_bridge or zenoh router.",
    ),
]


LockTimeout = Annotated[
    float | None,
    typer.Option(
        "--lock-timeout",
        min=0.1,
        metavar="SECONDS",
        help="Of a ROS 2 robot: also stop it when no message of its emergency stop arrives for "
        "this long; by default the last message stays valid.",
    ),
]
MasksFrom = Annotated[
    list[str] | None,
    typer.Option(
        "--masks-from",
        metavar="TOPIC",
        help="With --ros2: keep-out or speed zones from Nav2's costmap_filter_info_server on this "
        "topic. Repeat it for each filter.",
    ),
]


def on_ros(
    ros2: bool, topics: Sequence[str] | None, transport: str, url: str,
    lock_timeout: float | None = None, masks: Sequence[str] | None = None, frame: str = "map",
) -> Ros2Config | None:  # fmt: skip
    """Configuration of a ROS 2 robot, or None. frame: of the map. Raises CohelmError for options
    that need one."""
    from cohelm.core.errors import CohelmError
    from cohelm.drive.operate import Ros2Config
    from cohelm.ros.connection import connection

    if ros2:
        connection(transport, url)  # report an unknown transport at once
        silence = math.inf if lock_timeout is None else lock_timeout
        return Ros2Config(tuple(topics or ()), transport, url, tuple(masks or ()), frame, silence)
    if topics or url or transport != "auto" or masks or lock_timeout is not None:
        raise CohelmError(
            "--topic, --transport, --url, --lock-timeout and --masks-from are of a ROS 2 robot: "
            "add --ros2"
        )
    return None


@app.command(
    "filter",
    epilog=examples(
        "cohelm filter --robot my-robot.yaml --print-config",
        "cohelm filter --robot turtlebot4 --in /cmd_vel_nav --out /cmd_vel",
    ),
)
def filter_(
    context: typer.Context,
    robot: Annotated[
        str, typer.Option("--robot", metavar="MODEL", help="A shipped robot, or its YAML file.")
    ],
    command: Annotated[
        str, typer.Option("--in", metavar="TOPIC", help="Commands of the controller.")
    ] = "/cmd_vel_nav",
    out: Annotated[
        str, typer.Option("--out", metavar="TOPIC", help="Safe commands, to the base.")
    ] = "/cmd_vel",
    scan: Annotated[str, typer.Option(metavar="TOPIC", help="The LiDAR's scans.")] = "/scan",
    further_scan: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TOPIC", help="Scans of a further LiDAR of --robot, if not on "
                     "/scan_NAME. Repeat it for each."),
    ] = None,
    contact: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TOPIC", help="A bumper or cliff sensor of --robot, if not on "
                     "/bumper_NAME, /cliff_NAME or /hazard_detection. Repeat it for each."),
    ] = None,
    footprint: Annotated[
        str, typer.Option(metavar="TOPIC",
                          help="The base's outline (PolygonStamped), if it changes.")
    ] = "",
    odom: Annotated[str, typer.Option(metavar="TOPIC", help="The base's odometry.")] = "/odom",
    namespace: Annotated[
        str, typer.Option(metavar="/NAME",
                          help="Namespace of the default topics and of relative names.")
    ] = "/",
    stamped: Annotated[
        bool | None,
        typer.Option("--stamped/--unstamped", help="Publish TwistStamped, or Twist; by default as "
                     "the base subscribes."),
    ] = None,
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.05, max=5.0,
                            help="Brake when the last command is older than this.")
    ] = 0.5,
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", min=25.0, max=125.0, help="Control rate; by default the "
                     "controller's."),
    ] = None,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=2.0, max=3600.0,
                            help="Longest wait for missing topics at the start.")
    ] = 10.0,
    clock_difference: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0,
                            help="Largest accepted difference of the robot's clock.")
    ] = 5.0,
    mount_from_model: Annotated[
        bool, typer.Option("--mount-from-model",
                           help="Take the LiDAR's mount from --robot, not from /tf_static.")
    ] = False,
    allow_bypass: Annotated[
        bool, typer.Option("--allow-bypass",
                           help="Accept other nodes that command the base: without guarantee.")
    ] = False,
    lock: Annotated[
        str, typer.Option(metavar="TOPIC",
                          help="Emergency stop (Bool): stand still while true; '' for none.")
    ] = "/emergency_stop",
    lock_timeout: LockTimeout = None,
    transport: Transports = "auto",
    url: Bridge = "",
    params: Annotated[
        Path | None,
        typer.Option("--params", metavar="FILE", callback=from_file("cohelm_filter"), is_eager=True,
                     help="Read these options from a ROS 2 parameter file (YAML)."),
    ] = None,
    print_config: PrintConfig = False,
    seconds: Seconds = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Pass only what is safe from a ROS 2 controller to its base.

    Needs no ROS here, only the network of the robot: commands, scans and odometry in; safe
    commands, /diagnostics, a reason and markers out. Ctrl-C stops the base first. If something
    does not fit, it says how to fix that, and nothing moves: begin with --print-config.
    """
    from cohelm.core.errors import CohelmError
    from cohelm.drive.operate import end_signals
    from cohelm.ros.connection import connection
    from cohelm.ros.found import Allowed
    from cohelm.ros.look import look
    from cohelm.ros.report import NODE
    from cohelm.ros.topics import Topics
    from cohelm.scenario.load import load_robot

    idle_without(context, "--json", "--print-config")
    model = load_robot(robot)
    topics = Topics.named(
        namespace,
        command,
        out,
        scan,
        odom,
        lock,
        further_scan or (),
        contact or (),
        footprint=footprint,
    )
    if topics.command == topics.out:
        raise CohelmError(
            f"--in and --out are both {topics.out}, and the filter stands between two topics: "
            "remap the controller to another one"
        )
    allowed = Allowed(
        stamped,
        allow_bypass,
        mount_from_model,
        clock_difference,
        math.inf if lock_timeout is None else lock_timeout,
    )
    way = connection(transport, url)
    with starting(NODE) as line, end_signals() as stop:
        opened = way.open(NODE, topics.namespace)
        try:
            found = look(opened, model, topics, allowed, wait, way=way)
            for note in found.notes:
                say(plain(note))
            if print_config:
                line.over()
                used = {key: (one,) for key, one in found.topics.by_use(model).items()}
                print_found(found, found.model, used, as_json)
                return
            _run_filter(opened, found, timeout, rate, seconds, stop, line)
        finally:
            opened.close()


@app.command(epilog=examples("cohelm base turtlebot4 --controller 0.3,0"))
def base(
    name: RobotOrScenario = None,
    scenario: Annotated[
        str | None,
        typer.Option(metavar="SCENARIO", help="Where a robot is driven; by default in lab-guard."),
    ] = None,
    twin: Twin = False,
    namespace: Annotated[str, typer.Option(metavar="/NAME", help="Namespace of its topics.")] = "/",
    stamped: Annotated[
        bool, typer.Option("--stamped", help="Subscribe to TwistStamped, not Twist.")
    ] = False,
    controller: Annotated[
        str | None,
        typer.Option(metavar="V,OMEGA", help="Also publish this command on /cmd_vel_nav."),
    ] = None,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Stamp in simulated time, published on /clock.")
    ] = False,
    seed: Seed = None,
    seconds: Seconds = None,
    as_json: Json = False,
) -> None:
    """Simulate a robot behind ROS 2 topics.

    For trying `cohelm filter` and `cohelm robot --ros2` without a robot. Publishes /odom, /scan,
    /tf and /tf_static, executes /cmd_vel, and prints its smallest clearance at the end.
    --controller 0.5,0 commands it to drive ahead, whatever is there.
    """
    from cohelm.drive.operate import DriveOptions, end_signals, robot_factory
    from cohelm.robot.keep.priority import raise_priority, raise_thread_priorities, restore_priority
    from cohelm.ros.dds import DdsTransport
    from cohelm.ros.served import ServedRobot, parse_twist, run_controller
    from cohelm.ros.topics import Topics

    kind = "twin" if twin else "kinematic"
    twist = None if controller is None else parse_twist(controller)
    topics = Topics.named(namespace)
    with starting("base") as line, end_signals() as stop:
        made = robot_factory(DriveOptions(name, scenario, kind, True, seed, []))
        robot = made()
        transport = DdsTransport("cohelm_base", topics.namespace)
        try:
            served = ServedRobot(transport, robot, topics, stamped=stamped, simulated=sim_time)
            over = run_controller(transport, topics, twist)
            stop.handle_signals(seconds)
            line.over()
            say(f"{plain(made.model.name)} listens on {plain(topics.out)}; Ctrl-C ends it")
            raise_priority()  # a real robot has its own computer
            raise_thread_priorities()
            served.run(lambda: stop.over() != "")
            over.set()
            truth = getattr(robot, "truth", lambda: None)()
        finally:
            restore_priority()
            transport.close()
            robot.close()
    if truth is not None:
        least = truth.least_moving
        result = {
            "x_m": truth.pose.x, "y_m": truth.pose.y, "heading_rad": truth.pose.psi,
            "least_clearance_moving_m": least if least < 1e6 else None,
        }  # fmt: skip
        if as_json:
            print_json(result)
            return
        near = "it did not move" if result["least_clearance_moving_m"] is None else f"{least:.3f} m"
        print(f"smallest clearance while moving: {near}")


def _run_filter(
    transport: Any, found: Found, timeout: float, rate: float | None, seconds: float | None,
    stop: Any, line: Any,
) -> None:  # fmt: skip
    """Filter until Ctrl-C or the end of the time."""
    from functools import partial

    from cohelm.robot.keep.priority import raise_priority, restore_priority
    from cohelm.robot.keep.process import RemoteGatedRobot
    from cohelm.ros.filter_node import FilterNode, FilterParams, gate_rules
    from cohelm.ros.pacing import SPARE, period
    from cohelm.ros.robot import adapted

    length = period(found.command_period) if rate is None else (1.0 + SPARE) / rate
    gated = RemoteGatedRobot(partial(adapted, found), gate_rules(found.model, length))
    try:
        node = FilterNode(
            transport, gated, found, FilterParams(length, timeout), lambda text: say(plain(text))
        )
        node.warm_up()
        stop.handle_signals(seconds)
        line.over()
        topics = found.topics
        say(
            f"filtering {plain(topics.command)} -> {plain(topics.out)}, {1.0 / length:.0f} Hz at "
            "least; Ctrl-C ends it"
        )
        raise_priority()
        node.run(lambda: stop.over() != "")
        say(plain(stop.over()))
    finally:
        restore_priority()
        gated.close()
