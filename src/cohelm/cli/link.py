"""Commands of the link between station and robot: pair."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cohelm.cli.app import CommandLine, app, examples, idle_beside, idle_without
from cohelm.cli.output import Json, named, plain, print_json, say, typed

pair = CommandLine(
    help="Pair stations with robots: keys that allow to drive.", no_args_is_help=True
)
app.add_typer(pair, name="pair")


@pair.command(epilog=examples("cohelm pair new desk"))
def new(
    station: Annotated[str, typer.Argument(metavar="NAME", help="Name of the station.")],
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Name of this robot, when it is paired for the first time."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", parser=named, help="Where to write it; else NAME.pair."
        ),
    ] = None,
) -> None:
    """On the robot: pair a station.

    Writes a file with the station's private key. Transfer it to the station over a channel that
    nobody else can read (a USB stick, scp), install it there with `cohelm pair install`, and
    delete it.
    """
    from cohelm.link import keys

    keys.robot(robot)
    path = out or Path(f"{station}.pair")
    own = keys.pair(station, path)
    say(f"robot {plain(own.name)} accepts {plain(station)} from its next start on; on the station:")
    print(f"cohelm pair install {typed(path)}")
    say(f"the robot shows this certificate: {keys.fingerprint(own.certificate)}")


@pair.command(epilog=examples("cohelm pair install desk.pair"))
def install(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", parser=named, help="The file that `cohelm pair new` wrote."),
    ],
) -> None:
    """On the station: install a key for a robot.

    The file can be deleted then.
    """
    from cohelm.link import keys

    name = keys.install(file)
    print(f"cohelm station --robot HOST --name {name}")
    shown = keys.fingerprint(keys.station(name).trusted[0])
    say(f"paired with robot {plain(name)}, which shows this certificate: {shown}")
    say(f"now delete the file: rm {plain(typed(file))}")


@pair.command(name="list", epilog=examples("cohelm pair list", "cohelm pair list --json"))
def listed(as_json: Json = False) -> None:
    """List the pairings.

    Stations that may connect to this robot, and robots that this station may drive.
    """
    from cohelm.link import keys

    rows = [
        *(("station let in", name, shown) for name, shown in keys.stations()),
        *(("robot", name, shown) for name, shown in keys.robots()),
    ]
    if as_json:
        print_json({"pairs": [{"what": w, "name": n, "sha256": s} for w, n, s in rows]})
    elif rows:
        print(f"paired here, in {keys.home()}")
        wide = max(len(name) for _, name, _ in rows)
        for what, name, shown in rows:  # no table: a certificate is wider than most terminals
            print(f"{what:14}  {name:{wide}}  {shown}")
    else:
        say(f"nothing is paired here, in {plain(str(keys.home()))}")


@pair.command(epilog=examples("cohelm pair remove desk"))
def remove(
    station: Annotated[str, typer.Argument(metavar="NAME", help="The station to revoke.")],
) -> None:
    """On the robot: revoke a station.

    It is refused from the robot's next start on.
    """
    from cohelm.link import keys

    keys.unpair(station)
    say(f"{plain(station)} is revoked once the robot is started again")


@app.command(
    epilog=examples(
        "cohelm stick --list", "cohelm stick --drive", "cohelm stick --robot 192.168.1.20"
    )
)
def stick(
    context: typer.Context,
    robot: Annotated[
        str | None,
        typer.Option(metavar="HOST[:PORT]", help="The robot to drive; it must be paired."),
    ] = None,
    drive: Annotated[
        bool, typer.Option("--drive", help="Join the `cohelm drive` that runs on this machine.")
    ] = False,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The robot's name, where several are paired here."),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="DEVICE",
            help="/dev/input/event..., the number of a gamepad, brunner://HOST?force=N for a "
            "Brunner stick, or a stick file (CSV); else the first that is found.",
        ),
    ] = None,
    k_s: Annotated[
        float,
        typer.Option(
            metavar="N", min=0.0, max=10.0, help="Constant of the spring (35); 10 is stiffest."
        ),
    ] = 5.0,
    listing: Annotated[bool, typer.Option("--list", help="Only list the devices here.")] = False,
    trial: Annotated[
        bool,
        typer.Option("--trial", help="Only find out which way a Brunner stick pushes: it moves."),
    ] = False,
    strongest: Annotated[
        float,
        typer.Option(metavar="N", min=1.0, max=10000.0, help="--trial pushes no harder than this."),
    ] = 500.0,
) -> None:
    """Drive with a stick of this machine, with force feedback.

    Force feedback where the stick has it, rumble where it has that.

    A station without a screen, in a process of its own: open `cohelm station` beside it to see,
    and hand the lease over there. Buttons: 1 stop, 2 reset, 3 shared or automatic, 4 take the
    lease or give it back; in this terminal: space, r, m, l. Ctrl-C ends it.
    """
    from cohelm.core.errors import CohelmError
    from cohelm.link.sticks import choose

    if listing:
        idle_beside(context, "--list")
        found = choose.listed()
        for line in found:
            print(line)
        if not found:
            say("no stick is here: plug one in, or name a Brunner stick or a file with --device")
        return
    idle_without(context, "--strongest", "--trial")
    if trial:
        idle_beside(context, "--trial", "--device", "--strongest")
        if device is None:
            raise CohelmError("--trial is of a Brunner stick: name it with --device brunner://HOST")
        from cohelm.link.sticks import trial as trials

        found = trials.run(device, strongest, lambda text: say(plain(text)))
        say("now, with the force that feels right (this one is a beginning):")
        print(f"--device '{found}'")
        return
    from cohelm.link import keys
    from cohelm.link.local_credentials import credentials_of_drive
    from cohelm.link.sticks import stick_client
    from cohelm.link.sticks.terminal_buttons import TerminalButtons
    from cohelm.link.udp import PORT, address

    if drive:
        idle_beside(context, "--drive", "--robot", "--device", "--k-s")
        own, to = credentials_of_drive(robot)
    elif robot is None:
        raise CohelmError(
            "name a robot (--robot HOST), or join the drive on this machine (--drive), or list "
            "the devices here (--list)"
        )
    else:
        own, to = keys.station(name), address(robot, PORT)
    held = TerminalButtons(choose.opened(device))
    if held.listens:
        say("space: stop, r: reset, m: shared or automatic, l: take the lease or give it back")
    stick_client.drive(held, own, to, k_s, lambda text: say(plain(text)))
