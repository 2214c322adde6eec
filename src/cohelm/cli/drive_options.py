"""Which robot is driven, where and for how long: the options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cohelm.cli.output import named

RobotOrScenario = Annotated[
    str | None,
    typer.Argument(
        metavar="ROBOT|SCENARIO",
        help="A robot, by its YAML file or a shipped one's name, driven in --scenario; or a "
        "scenario, with its robot; by default lab-guard.",
    ),
]
Site = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar="SCENARIO",
        help="Where a robot is driven; by default in lab-guard, a real one where nothing is known.",
    ),
]
OwnDriver = Annotated[
    str | None,
    typer.Option(
        "--driver",
        metavar="PACKAGE:CLASS",
        help="Your own robot: a subclass of cohelm.Robot, or an entry point of cohelm.robots. "
        "The scenario gives map, route and law.",
    ),
]
Ros2 = Annotated[bool, typer.Option("--ros2", help="The robot is a ROS 2 robot on this network.")]
Chart = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        parser=named,
        help="Localise on this map: of map_server, in the scenario's frame, or made by "
        "`cohelm map` from the same start; else on the scenario's walls.",
    ),
]
KeepOut = Annotated[
    Path | None,
    typer.Option(
        "--keep-out", metavar="FILE", parser=named, help="Keep-out zones: a mask of map_server."
    ),
]
SpeedZones = Annotated[
    Path | None,
    typer.Option(
        "--speed-zones",
        metavar="FILE",
        parser=named,
        help="Speed zones: a mask of Nav2's speed filter.",
    ),
]
Twin = Annotated[
    bool, typer.Option("--twin/--kinematic", help="Physics (MuJoCo), or kinematics only.")
]
Seed = Annotated[
    int | None,
    typer.Option(metavar="N", min=0, max=2**32 - 1, help="Seed of the simulated sensors' errors."),
]
Seconds = Annotated[
    float | None, typer.Option("--for", metavar="SECONDS", min=0.1, help="End after this time.")
]
CarryOn = Annotated[
    bool, typer.Option("--carry-on", help="Continue without operator when a stick in use is lost.")
]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="As in `cohelm run`.")
]
