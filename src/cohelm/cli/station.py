"""Commands of the operator's station."""

from __future__ import annotations

from typing import Annotated

import typer

from cohelm.cli.app import app
from cohelm.cli.tell import say

Port = Annotated[int, typer.Option(min=0, max=65535, help="Port of the web page; 0: a free one.")]
Host = Annotated[str, typer.Option(help="Address to listen on; others than loopback need a login.")]


@app.command()
def station(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Drive a simulated robot in this scenario.")
    ] = "lab-avoid",
    host: Host = "127.0.0.1",
    port: Port = 8765,
) -> None:
    """Open the operator's station: a web page to drive from."""
    from cohelm.drive.simulated import SimulatedRobot
    from cohelm.scenario import build, load
    from cohelm.station.serve import Server

    robot = SimulatedRobot(build.setup(load.scenario(scenario, [], None)), scenario, None)
    server = Server(robot.connect, host, port)
    robot.start()
    say(f"station: {server.address}")
    try:
        server.run()
    finally:
        robot.close()
