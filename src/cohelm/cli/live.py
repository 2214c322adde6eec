"""The options of the live view: --foxglove and --foxglove-teleop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.output import plain, say

if TYPE_CHECKING:
    from cohelm.drive.live import LiveConfig

Foxglove = Annotated[
    str | None,
    typer.Option(
        metavar="HOST[:PORT]",
        help="Show the drive live in Foxglove or Lichtblick: on localhost, or on the network.",
    ),
]


FoxgloveTeleop = Annotated[
    bool,
    typer.Option(
        "--foxglove-teleop",
        help="With --foxglove on this machine: its Teleop panel may steer while the lease is free.",
    ),
]


def live(where: str | None, teleop: bool = False) -> LiveConfig | None:
    """Address of the live view, or None. teleop: whether viewers may steer. Raises CohelmError for
    a malformed address, or one where anybody on the network could steer."""
    from cohelm.core.errors import CohelmError

    if where is None:
        if teleop:
            raise CohelmError("--foxglove-teleop is of a live view: add --foxglove 127.0.0.1")
        return None
    from cohelm.drive.live import PORT, LiveConfig
    from cohelm.link.udp import address
    from cohelm.station.access_control import is_loopback

    host, port = address(where, PORT)
    if teleop and not is_loopback(host):
        raise CohelmError(
            f"on {host} the address would cross the network in clear, and whoever listens there "
            "could steer: --foxglove 127.0.0.1, and from elsewhere ssh -L "
            f"{port}:127.0.0.1:{port}; or view without --foxglove-teleop"
        )
    if not is_loopback(host):
        say(
            "in clear: whoever can listen on this network can see what the robot's camera sees, "
            "and where it is"
        )
    return LiveConfig(host, port, teleop=teleop)


def shown_at(config: LiveConfig | None) -> None:
    """Print the address of the live view."""
    if config is not None:
        can = "view and steer" if config.teleop else "view"
        say(
            f"live: {plain(config.address)} (Foxglove or Lichtblick, as Foxglove WebSocket; "
            f"whoever has the address can {can})"
        )
