"""Commands of the operator's station."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.app import app
from cohelm.cli.tell import Pictures, plain, say

if TYPE_CHECKING:
    from cohelm.station.robot_link import Connect

Port = Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes a free one.")]
Host = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Where to listen. Anything but loopback asks for the token in the address printed.",
    ),
]
_LAST_WORDS = 1.0  # pages are told four times a second how the link is [s]
Tls = Annotated[bool, typer.Option("--tls", help="HTTPS, with a certificate made here.")]


@app.command()
def station(
    robot: Annotated[
        str | None,
        typer.Option(metavar="HOST[:PORT]", help="The robot to drive; it must be paired."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="The robot's name, where several are paired here.")
    ] = None,
    replay: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Show a record, or the folder it is in.")
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8765,
    tls: Tls = False,
) -> None:
    """Open the operator's station, a web page to drive from.

    Or to see a record again, with --replay.

    Opens no browser; it prints the address of the page. Ctrl-C ends it.
    """
    from cohelm.core.errors import CohelmError

    if (robot is None) == (replay is None):
        raise CohelmError(
            "name a robot (--robot HOST) or a record (--replay FILE); "
            "for a simulated robot on this machine: cohelm drive"
        )
    serve(_recorded(replay) if replay is not None else _linked(robot or "", name), host, port, tls)


@app.command()
def drive(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Where to drive, by file or name.")
    ] = "lab-guard",
    twin: Annotated[
        bool,
        typer.Option("--twin/--kinematic", help="Physics and a camera (MuJoCo), or kinematics."),
    ] = True,
    records: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the records made from the screen.")
    ] = Path("out/records"),
    carry_on: Annotated[
        bool, typer.Option("--carry-on", help="Drive on alone when a stick in use vanishes.")
    ] = False,
    pictures: Pictures = 5.0,
    host: Host = "127.0.0.1",
    port: Port = 8765,
    tls: Tls = False,
) -> None:
    """Drive a simulated robot from a browser.

    Robot and station, both on this machine.

    Two processes with the real link between them; it prints the address of the page. A stick of
    this machine joins with `cohelm stick --drive`. When the robot's process dies, the page says
    so, and the command ends.
    """
    from cohelm.core.errors import CohelmError
    from cohelm.drive.beside import Beside
    from cohelm.drive.served import Door
    from cohelm.link import keys
    from cohelm.link.lent import lent
    from cohelm.scenario import load
    from cohelm.station.app import pages
    from cohelm.station.linked import Linked

    load.scenario(scenario)  # one that can not be used is told at once,
    pages()  # and so is a checkout without them, not after the robot was made
    of_robot, of_station, of_stick = keys.pair_here("station", "stick")
    say(f"starting the robot in {plain(scenario)}; the first time takes a minute")
    door = Door(of_robot, "127.0.0.1", 0, records)
    with (
        Beside(scenario, twin, door, carry_on, pictures=pictures) as robot,
        lent(of_stick, robot.host, robot.port),
    ):
        say("to join it with a stick of this machine: cohelm stick --drive")
        connect = partial(Linked, of_station, robot.host, robot.port, lambda: robot.over)
        serve(lambda _: connect(), host, port, tls, robot.afterwards)
        over = robot.over
    if over:
        raise CohelmError(f"{over}. The station has ended too: start it again when you want to")


def _recorded(path: Path) -> Connect:
    from cohelm.drive.film import film
    from cohelm.drive.replayed import Replaying

    shown = film(path / "record.mcap" if path.is_dir() else path)
    return lambda _: Replaying(shown)


def _linked(robot: str, name: str | None) -> Connect:
    from cohelm.link import keys
    from cohelm.link.udp import PORT, address
    from cohelm.station.linked import Linked

    own = keys.station(name)
    host, port = address(robot, PORT)
    return lambda _: Linked(own, host, port)


def serve(
    connect: Connect, host: str, port: int, tls: bool,
    afterwards: Callable[[Callable[[], None]], None] = lambda _: None,
) -> None:  # fmt: skip
    """Serve the page, and say where it is. afterwards: told what to call when all is over."""
    import time

    from cohelm.link import keys
    from cohelm.station.serve import Server
    from cohelm.station.tls import certificate

    files = None
    if tls:
        path, key, shown = certificate(keys.home(), host)
        files = (path, key)
        say(f"the browser will warn once, and must show this SHA-256 fingerprint:\n{shown}")
    server = Server(connect, host, port, files)
    print(server.address, flush=True)
    say("open this address in a browser; Ctrl-C ends the station")

    def last_words() -> None:
        time.sleep(_LAST_WORDS)
        server.stop()

    afterwards(last_words)
    server.run()
    say(plain("the station is closed"))
