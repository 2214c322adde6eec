"""Commands of the operator's station."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.app import app, end_as_by_ctrl_c, examples, given, idle_beside, idle_together
from cohelm.cli.drive_options import (
    CarryOn,
    Changes,
    Chart,
    KeepOut,
    OwnDriver,
    RobotOrScenario,
    Ros2,
    Site,
    SpeedZones,
)
from cohelm.cli.live import Foxglove, FoxgloveTeleop, live, shown_at
from cohelm.cli.output import Pictures, named, plain, say, starting, warnings_said
from cohelm.cli.ros import Bridge, LockTimeout, MasksFrom, TopicNames, Transports, on_ros
from cohelm.core.interrupts import INTERRUPTS

if TYPE_CHECKING:
    from cohelm.station.robot_link import Connect

Port = Annotated[
    int,
    typer.Option(metavar="PORT", min=0, max=65535, help="Port of the page; 0 takes a free one."),
]
Host = Annotated[
    str,
    typer.Option(
        metavar="HOST[:PORT]", help="Address to listen on. Any but loopback needs --tls as well."
    ),
]
_LAST_WORDS = 1.0  # pages get the quality of the link four times a second [s]
Tls = Annotated[bool, typer.Option("--tls", help="HTTPS, with a certificate made here.")]
Certificate = Annotated[
    Path | None,
    typer.Option(
        "--tls-cert", metavar="FILE", parser=named, help="HTTPS, with this certificate (PEM)."
    ),
]
CertificateKey = Annotated[
    Path | None,
    typer.Option(
        "--tls-key",
        metavar="FILE",
        parser=named,
        help="Its key (PEM), where it is not in that file.",
    ),
]
InClear = Annotated[
    bool,
    typer.Option(
        "--without-tls",
        help="Plain HTTP on the network: whoever can listen there can take the token and drive.",
    ),
]


@app.command(
    epilog=examples(
        "cohelm station --robot 192.168.1.20",
        "cohelm station --robot 192.168.1.20 --host 0.0.0.0 --tls",
        "cohelm station --replay drive.mcap",
    )
)
def station(
    context: typer.Context,
    robot: Annotated[
        str | None,
        typer.Option(metavar="HOST[:PORT]", help="The robot to drive; it must be paired."),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The robot's name, where several are paired here."),
    ] = None,
    replay: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=named, help="Show a record, or the folder it is in."),
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8765,
    tls: Tls = False,
    tls_cert: Certificate = None,
    tls_key: CertificateKey = None,
    without_tls: InClear = False,
) -> None:
    """Serve the operator's station, a web page to drive from.

    With --replay it plays a record.

    Opens no browser; it prints the address of the page. Ctrl-C ends it.
    """
    from cohelm.core.errors import CohelmError

    if robot is not None and replay is not None:
        raise CohelmError("--robot and --replay each fill the page: leave one of them out")
    if robot is None and replay is None:
        raise CohelmError(
            "name a robot (--robot HOST) or a record (--replay FILE); "
            "for a simulated robot on this machine: cohelm drive"
        )
    if replay is not None:
        idle_beside(
            context, "--replay", "--host", "--port", "--tls", "--tls-cert", "--tls-key",
            "--without-tls",
        )  # fmt: skip
    host, port = _address(context, host, port)
    can = "drive" if replay is None else "watch"
    files = _encryption(host, tls, tls_cert, tls_key, without_tls, can)
    connect = _recorded(replay) if replay is not None else _linked(robot or "", name)
    serve(connect, host, port, files, can=can)


@app.command(
    epilog=examples(
        "cohelm drive",
        "cohelm drive my-robot.yaml --scenario lab-shared",
        "cohelm drive my-robot.yaml --driver my_package:MyRobot",
        "cohelm drive my-robot.yaml --ros2 --map map.yaml",
    )
)
def drive(
    context: typer.Context,
    name: RobotOrScenario = None,
    scenario: Site = None,
    twin: Annotated[
        bool,
        typer.Option("--twin/--kinematic", help="Physics and a camera (MuJoCo), or kinematics."),
    ] = True,
    driver: OwnDriver = None,
    ros2: Ros2 = False,
    topics: TopicNames = None,
    lock_timeout: LockTimeout = None,
    transport: Transports = "auto",
    url: Bridge = "",
    chart: Chart = None,
    keep_out: KeepOut = None,
    speed_zones: SpeedZones = None,
    masks_from: MasksFrom = None,
    changes: Changes = None,
    records: Annotated[
        Path,
        typer.Option(
            metavar="DIR", parser=named, help="Folder of the records made from the screen."
        ),
    ] = Path("out/records"),
    carry_on: CarryOn = False,
    pictures: Pictures = 5.0,
    foxglove: Foxglove = None,
    foxglove_teleop: FoxgloveTeleop = False,
    host: Host = "127.0.0.1",
    port: Port = 8765,
    tls: Tls = False,
    tls_cert: Certificate = None,
    tls_key: CertificateKey = None,
    without_tls: InClear = False,
) -> None:
    """Drive a robot from a browser: a simulated one, or yours.

    Robot and station, both on this machine.

    Two processes with the real link between them; it prints the address of the page. A stick of
    this machine joins with `cohelm stick --drive`. When the robot's process dies, the page says
    so, and the command ends.
    """
    from cohelm.core.errors import CohelmError
    from cohelm.drive.operate import DriveOptions, map_and_zones, remarks, robot_factory
    from cohelm.drive.robot_process import RobotProcess
    from cohelm.drive.teleop_server import TeleopConfig
    from cohelm.link import keys
    from cohelm.link.local_credentials import shared_credentials
    from cohelm.station.app import pages
    from cohelm.station.robot_link import Linked, RobotLink, StartingLink

    idle_together(context, ("--driver", "--ros2"), "--twin", "--kinematic")
    host, port = _address(context, host, port)
    files = _encryption(host, tls, tls_cert, tls_key, without_tls)
    if records.exists() and not records.is_dir():
        raise CohelmError(f"{records} is no folder: choose another with --records")
    kind = "twin" if twin and driver is None and not ros2 else "kinematic"
    options = DriveOptions(
        name=name, scenario=scenario, kind=kind, real_time=True, seed=None, changes=changes or [],
        driver=driver, ros2=on_ros(ros2, topics, transport, url, lock_timeout, masks_from),
        chart=chart, keep_out=keep_out, speed_zones=speed_zones,
    )  # fmt: skip
    if driver is not None or not ros2:  # a ROS 2 robot is looked for once
        made = robot_factory(options)
        map_and_zones(options, made)  # problems are reported at once,
        if remark := remarks(made):
            say(remark)
    pages()  # and so is a checkout without them, not after the robot was made
    of_robot, of_station, of_stick = keys.pair_here("station", "stick")
    door, view = TeleopConfig(of_robot, "127.0.0.1", 0, records), live(foxglove, foxglove_teleop)
    with (
        ExitStack() as joined,
        RobotProcess(options, door, carry_on, pictures=pictures, live=view) as robot,
        starting(name or "the robot") as begun,
    ):

        def linked() -> Linked | None:
            """The page is there before the robot is: what it compiles takes a minute at first."""
            if not robot.ready.is_set():
                return None
            return Linked(of_station, robot.host, robot.port, lambda: robot.over)

        def ready() -> None:
            joined.enter_context(shared_credentials(of_stick, robot.host, robot.port))
            begun.over()
            say("the robot is ready; to join it with a stick of this machine: cohelm stick --drive")
            shown_at(view)

        def connect(_: str) -> RobotLink:
            return linked() or StartingLink(linked, lambda: robot.over or begun.text())

        def waiting() -> None:
            say(
                f"the robot's process ({robot.pid}) does not end yet; Ctrl-C again kills it, and "
                "its gate process stops the robot"
            )
            for number in INTERRUPTS:
                signal.signal(number, kill)

        def kill(*_: object) -> None:
            robot.kill()
            say("killed; its gate process stops the robot, and ends within some seconds")

        robot.when_ready(ready)
        robot.when_waiting(waiting)
        interrupted = serve(connect, host, port, files, robot.afterwards)
        over, came = robot.over, robot.ready.is_set()
    if interrupted or not over:  # a terminal sends Ctrl-C to the robot's process as well
        return
    if not came:
        raise CohelmError(over)
    raise CohelmError(f"{over}. The station has ended too: start it again when you want to")


def _recorded(path: Path) -> Connect:
    from cohelm.drive.playback import Playback
    from cohelm.drive.replayed import Replaying

    with warnings_said():
        shown = Playback(path / "record.mcap" if path.is_dir() else path)
    return lambda _: Replaying(shown)


def _linked(robot: str, name: str | None) -> Connect:
    import socket
    import threading

    from cohelm.core.errors import CohelmError
    from cohelm.link import keys
    from cohelm.link.udp import PORT, address, resolved
    from cohelm.station.robot_link import Linked

    own = keys.station(name)
    host, port = address(robot, PORT)

    def look_up() -> None:
        try:
            resolved(host, port, socket.SOCK_DGRAM)
        except CohelmError as error:
            why = f"{error}; it is looked up again for each page"
            say(f"[yellow]warning:[/yellow] {plain(why)}")

    # beside the server: it may take seconds, and the robot may be there later
    threading.Thread(target=look_up, name="look-up", daemon=True).start()
    return lambda _: Linked(own, host, port)


def _address(context: typer.Context, host: str, port: int) -> tuple[str, int]:
    """Where the page is served. Raises CohelmError for a host that can not be one, and for two
    ports."""
    from cohelm.core.errors import CohelmError
    from cohelm.link.udp import address

    name, chosen = address(host, port)
    if chosen != port and "--port" in given(context):
        raise CohelmError(
            f"--host {host} and --port {port} each name a port: leave one of them out"
        )
    return name, chosen


def _encryption(
    host: str, made: bool, certificate: Path | None, key: Path | None, in_clear: bool,
    can: str = "drive",
) -> tuple[Path, Path] | None:  # fmt: skip
    """Files of the page's certificate and key; None: plain HTTP. can: what one does with the page.

    Raises CohelmError where token and stick would cross a network in clear.
    """
    from cohelm.core.errors import CohelmError
    from cohelm.link import keys
    from cohelm.station import tls
    from cohelm.station.access_control import is_loopback

    if key is not None and certificate is None:
        raise CohelmError("a key without its certificate: name that too, with --tls-cert FILE")
    if in_clear and (made or certificate is not None):
        raise CohelmError("--without-tls and a certificate: leave one of them out")
    if certificate is not None:
        own = tls.own(certificate, key or certificate)
        if day := tls.over_since(certificate):
            say(
                f"[yellow]warning:[/yellow] {plain(str(certificate))} was valid until {day}: "
                "browsers will warn, or refuse it; renew it"
            )
        return own
    if made:
        path, key, shown = tls.certificate(keys.home(), host)
        say(f"the browser will warn once, and must show this SHA-256 fingerprint:\n{shown}")
        return path, key
    if is_loopback(host):
        return None
    if not in_clear:
        raise CohelmError(
            f"on {host} the token and all else would cross the network in clear, and whoever "
            f"listens there could {can}: add --tls, or --without-tls in a private network"
        )
    say(f"in clear: whoever can listen on this network can take the token and {can}")
    return None


def serve(
    connect: Connect, host: str, port: int, files: tuple[Path, Path] | None,
    afterwards: Callable[[Callable[[], None]], None] = lambda _: None, can: str = "drive",
) -> bool:  # fmt: skip
    """Serve the page, and print its address; returns whether a signal has ended it. afterwards:
    registers what to call when the robot has ended. can: what one does with the page."""
    import time

    from cohelm.station.serve import Server

    server = Server(connect, host, port, files)
    print(server.address, flush=True)
    say(f"open this address in a browser (whoever has it can {can}); Ctrl-C ends the station")

    def last_words() -> None:
        time.sleep(_LAST_WORDS)
        server.stop()

    afterwards(last_words)
    end_as_by_ctrl_c()
    try:
        server.run()
    finally:
        for number in INTERRUPTS:  # the robot is being stopped, which ends by itself
            signal.signal(number, signal.SIG_IGN)
        say("the station is closed")
    return server.interrupted
