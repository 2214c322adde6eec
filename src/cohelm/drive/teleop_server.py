"""A robot that a person drives over the link, from its start to its end."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cohelm.drive.foxglove_teleop import Joined
from cohelm.drive.operator_requests import OperatorRequests
from cohelm.drive.over_link import OverLink
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.keys import Keys, joined_by
from cohelm.link.operator_input import STALE
from cohelm.link.robot_bulk import both_ends
from cohelm.loop.driver import by_hand
from cohelm.loop.loop import Loop

if TYPE_CHECKING:
    from cohelm.drive.on_topics import OnTopics

_log = logging.getLogger("cohelm.drive")


@dataclass(frozen=True)
class TeleopConfig:
    """Where a robot listens to stations, and what it lends them."""

    keys: Keys
    host: str = "0.0.0.0"
    port: int = 0
    """0: a free one."""
    records: Path = Path("out/records")
    """Folder of the records that people start, and may fetch."""


def serve(
    plan: SessionConfig,
    door: TeleopConfig,
    ready: Callable[[tuple[Any, ...]], None],
    over: Callable[[], str],
    topics: OnTopics | None = None,
) -> dict[str, Any]:
    """Drive as the person at the link wants, until `over` has a reason; returns the summary.

    ready: told the address when the robot can be driven. topics: what a ROS 2 robot says besides.
    Raises CohelmError where something can not be started.
    """
    on_loss = "goes on alone" if plan.loop.carry_on else "stops"
    let_in, live, own = door.keys, plan.live, None
    if live is not None and live.teleop:
        let_in, own = joined_by(door.keys, "foxglove")
    end, bulk = both_ends(let_in, door.host, door.port, door.records, STALE + plan.patience)
    operator = OverLink(
        end, bulk, plan.robot.model, door.records, on_loss, plan.loop.arming.silence,
        plan.robot.kind != "kinematic" and not (topics is not None and topics.blind),
    )  # fmt: skip
    if live is not None and own is not None:
        here = "127.0.0.1" if door.host in ("0.0.0.0", "") else door.host
        here = "::1" if here == "::" else here
        site = plan.robot.scenario
        gains = by_hand(site.law.gains(site.reference.speed_mps))
        joined = Joined(own, here, int(operator.address[1]), gains)
        plan = replace(plan, live=replace(live, joined=joined))
    try:
        with Session(plan, operator, None if topics is None else topics.camera) as session:
            if session.known is None:
                _log.warning("neither map nor walls to localise by: the robot trusts its odometry")
            path_requests = () if topics is None else (topics,)
            if topics is not None:
                topics.attend(session)
            desk = OperatorRequests(
                session, operator, session.known, door.records, path_requests=path_requests
            )
            try:
                ready(operator.address)
                said = ""

                def until(loop: Loop) -> bool:
                    nonlocal said
                    desk.turn(loop)
                    if topics is not None:
                        topics.turn(loop)
                    said = over()
                    return said != ""

                session.run(until)
                session.end(said)
                summary = session.summary()
            finally:
                desk.close()
        return summary | session.record_summary()
    finally:
        operator.close()
