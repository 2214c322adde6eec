"""Prints a ROS 2 robot's topics, their publishers or subscribers, and its YAML: --print-config."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from cohelm.cli.output import print_json

if TYPE_CHECKING:
    from cohelm.robot.model import RobotModel
    from cohelm.ros.found import Found
    from cohelm.ros.port import Endpoint

PrintConfig = Annotated[
    bool, typer.Option("--print-config", help="Print what was found of a ROS 2 robot, and end.")
]


def print_found(
    found: Found, model: RobotModel, topics: Mapping[str, Sequence[str]], as_json: bool
) -> None:
    """Print as the robot's YAML file, or as JSON. model: the robot as it would be driven. topics:
    by their use."""
    ends = {
        (key, topic): [
            one for one in found.endpoints if one.topic == topic and one.publishes != (key == "out")
        ]
        for key, several in topics.items() for topic in several
    }  # fmt: skip
    if as_json:
        way = found.connection
        print_json({
            "transport": {"kind": way.kind, "url": way.url, "why": way.why},
            "topics": {key: several[0] for key, several in topics.items() if several}
            | {"out_type": found.out_type},
            "ends": [
                {"for": key, "topic": topic, "type": one.type, "node": one.node,
                 "reliable": one.qos.reliable, "transient_local": one.qos.transient_local}
                for (key, topic), there in ends.items() for one in there
            ],
            "robot": model.model_dump(mode="json", exclude_none=True), "notes": list(found.notes),
        })  # fmt: skip
        return
    from cohelm.robot.model import RobotModel
    from cohelm.scenario.load import dump

    for (key, topic), there in ends.items():
        print(f"# {key}: {topic}, {_endpoints_text(there, key == 'out')}")
    short = _short(model.model_dump(mode="json", exclude_none=True))
    print(dump(RobotModel.model_validate(short)), end="")


def _endpoints_text(there: Sequence[Endpoint], subscribed: bool) -> str:
    """The nodes at the other end of a topic, as text. subscribed: whether they subscribe to it."""
    if not there:
        return "no subscriber" if subscribed else "no publisher"
    texts = (
        f"{one.type} {'wanted ' if subscribed else ''}by {one.node or 'a node without a name'} "
        f"({'reliable' if one.qos.reliable else 'best effort'}, "
        f"{'transient local' if one.qos.transient_local else 'volatile'})"
        for one in there
    )
    return "; ".join(dict.fromkeys(texts))


def _short(value: Any) -> Any:
    """Round numbers to four decimals: a tenth of a millimetre or millisecond."""
    if isinstance(value, dict):
        return {key: _short(one) for key, one in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [_short(one) for one in cast("list[Any]", value)]
    return round(value, 4) if isinstance(value, float) else value
