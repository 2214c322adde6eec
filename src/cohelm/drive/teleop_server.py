"""Drives a robot for operators over the link, from start to end."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cohelm.drive.operator_requests import OperatorRequests
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.station_publisher import StationPublisher
from cohelm.link.keys import Keys, with_local_station
from cohelm.link.operator import STALE
from cohelm.link.robot_bulk import both_ends
from cohelm.loop.driver import by_hand
from cohelm.loop.loop import Loop
from cohelm.robot.gate.modes import GateMode, latched

if TYPE_CHECKING:
    from cohelm.drive.on_topics import OnTopics

_log = logging.getLogger("cohelm.drive")


@dataclass(frozen=True)
class TeleopConfig:
    """Where a robot listens to stations, with which keys, and where its records are."""

    keys: Keys
    host: str = "0.0.0.0"
    port: int = 0
    """0: a free one."""
    records: Path = Path("out/records")
    """Folder of the records that operators start, and may fetch."""


class StopLines:
    """Prints each stop once, on a terminal without a line of the drive's state."""

    def __init__(self) -> None:
        self._last = (GateMode.IDLE, "")

    def turn(self, loop: Loop) -> None:
        """After each period; a thread prints, as a terminal may not take it."""
        gate = loop.gated.gate
        now = (gate.mode, gate.reason) if latched(gate.mode) else (GateMode.IDLE, "")
        if now == self._last:
            return
        self._last = now
        if now[1]:
            line = f"stopped: {now[1]}"
            threading.Thread(
                target=_log.warning, args=("%s", line), name="stop line", daemon=True
            ).start()


def serve(
    plan: SessionConfig,
    config: TeleopConfig,
    ready: Callable[[tuple[Any, ...]], None],
    over: Callable[[], str],
    topics: OnTopics | None = None,
) -> dict[str, Any]:
    """Drive for operators over the link, until `over` returns a reason; returns the summary.

    ready: called with the address when the robot can be driven. topics: those of a ROS 2 robot.
    Raises CohelmError if something can not be started.
    """
    admitted, live, own = config.keys, plan.live, None
    if live is not None and live.teleop:
        admitted, own = with_local_station(config.keys, "foxglove")
    end, bulk = both_ends(admitted, config.host, config.port, config.records, STALE + plan.patience)
    publisher = StationPublisher(
        end, bulk, plan.robot.model, config.records,
        plan.robot.kind != "kinematic" and not (topics is not None and topics.blind),
        plan.loop.carry_on,
    )  # fmt: skip
    if live is not None and own is not None:
        from cohelm.drive.foxglove_teleop import Joined  # most drives have no live view

        here = "127.0.0.1" if config.host in ("0.0.0.0", "") else config.host
        here = "::1" if here == "::" else here
        site = plan.robot.scenario
        gains = by_hand(site.law.gains(site.reference.speed_mps))
        joined = Joined(own, here, int(end.address[1]), gains)
        plan = replace(plan, live=replace(live, joined=joined))
    try:
        with Session(plan, end, None if topics is None else topics.camera) as session:
            if session.known is None:
                _log.warning("no map or walls to localize on: the robot uses its odometry")
            path_requests = () if topics is None else (topics,)
            if topics is not None:
                topics.attend(session)
            requests = OperatorRequests(
                session, publisher, config.records, path_requests=path_requests
            )
            try:
                ready(end.address)
                reason, stops = "", StopLines()

                def until(loop: Loop) -> bool:
                    nonlocal reason
                    requests.turn(loop)
                    stops.turn(loop)
                    if topics is not None:
                        topics.turn(loop)
                    reason = over()
                    return reason != ""

                session.run(until)
                session.end(reason)
                summary = session.summary()
            finally:
                requests.close()
        return summary | session.record_summary()
    finally:
        publisher.close()
