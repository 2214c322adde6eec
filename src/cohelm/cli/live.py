"""The option that shows a drive as it goes: --foxglove."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from cohelm.cli.tell import plain, say

if TYPE_CHECKING:
    from cohelm.drive.live import LiveConfig

Foxglove = Annotated[
    str | None,
    typer.Option(
        metavar="HOST[:PORT]",
        help="Show it as it goes in Foxglove or Lichtblick: on localhost, or on the network.",
    ),
]


def live(where: str | None) -> LiveConfig | None:
    """Where a drive is to be shown, if it is. Raises CohelmError for what is no address."""
    if where is None:
        return None
    from cohelm.drive.live import PORT, LiveConfig
    from cohelm.link.udp import address
    from cohelm.station.doors import is_loopback

    host, port = address(where, PORT)
    if not is_loopback(host):
        say(
            "in clear: whoever can listen on this network can see what the robot's camera sees, "
            "and where it is"
        )
    return LiveConfig(host, port)


def shown_at(config: LiveConfig | None) -> None:
    """Say where it is shown."""
    if config is not None:
        say(
            f"live: {plain(config.address)} (Foxglove or Lichtblick, as Foxglove WebSocket; "
            "whoever has the address can look on)"
        )
