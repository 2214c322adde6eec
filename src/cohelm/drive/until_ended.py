"""Drives until it is ended: with the site's stick and mode, or for stations."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from typing import TYPE_CHECKING, Any

from cohelm.core.errors import CohelmError
from cohelm.drive.operate import End, ScenarioStick
from cohelm.drive.route_check import checked_route, to_check
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.teleop_server import TeleopConfig, serve
from cohelm.link import keys
from cohelm.link.messages import Mode
from cohelm.link.udp import PORT, address, bracketed
from cohelm.loop.loop import Loop
from cohelm.loop.supervisor import PLANNED

if TYPE_CHECKING:
    from cohelm.drive.on_topics import OnTopics
    from cohelm.drive.reset_here import ResetHere
    from cohelm.ros.joy import JoyOperator


def drive_here(
    plan: SessionConfig, mode: Mode, operator: ScenarioStick | JoyOperator, stop: End,
    seconds: float | None = None, arrive: bool = False, topics: OnTopics | None = None,
    dock: str = "", reset: ResetHere | None = None,
    begun: Callable[[Session], AbstractContextManager[object]] = nullcontext,
) -> dict[str, Any]:  # fmt: skip
    """Drive; returns the summary.

    seconds: end after so many. arrive: end when the route is done. topics: those of a ROS 2 robot.
    dock: dock there instead, and end when that is over. reset: its requests are served. begun:
    called with the session, which drives within the returned context.

    Raises CohelmError if something can not be started.
    """
    number = goal_of(plan, mode, arrive, dock)
    with Session(plan, operator, None if topics is None else topics.camera) as session:
        stop.handle_signals()
        clock = session.loop.gated.now
        with begun(session), ExitStack() as stack:
            if topics is not None:
                topics.attend(session)
                topics.begin(session)
            operator.watches(clock)
            # the walls of a simulated robot's own site are where its route was drawn
            foreign = plan.known is not None or plan.robot.kind == "own"
            leads = mode in PLANNED and not number and foreign and to_check(session)
            route_check = stack.enter_context(checked_route(session)) if leads else None
            end = clock() + (math.inf if seconds is None else seconds)

            def until(loop: Loop) -> bool:
                if route_check is not None:
                    route_check.turn(loop)
                if topics is not None:
                    topics.turn(loop)
                if reset is not None:
                    reset.turn(loop, None if topics is None else topics.joy)
                over = clock() >= end or (arrive and loop.driver.arrived)
                over = over or bool(number and loop.supervisor.docking.last.why)
                return over or stop.reason != ""

            session.run(until, mode, number)
            session.end(stop.reason or "the drive is over")
        summary = session.summary()
    return summary | session.record_summary()


def goal_of(plan: SessionConfig, mode: Mode, arrive: bool, dock: str) -> int:
    """The number of the dock to drive to, from 1; 0: none was named. CohelmError for a goal that is
    never reached, or a dock that the site does not have."""
    if arrive and mode is Mode.HOLD:
        raise CohelmError(
            "in hold mode the robot stands, and does not arrive: name a site or another mode"
        )
    names = [one.name for one in plan.robot.scenario.docks]
    if dock and dock not in names:
        known = f"; there are: {', '.join(names)}" if names else ", and this scenario has none"
        raise CohelmError(f"--dock: no dock is called {dock!r}{known}")
    return names.index(dock) + 1 if dock else 0


def drive_for_stations(
    plan: SessionConfig, listen: str, stop: End, seconds: float | None = None,
    topics: OnTopics | None = None, begun: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:  # fmt: skip
    """Drive for paired stations; returns the summary. listen: HOST[:PORT].

    seconds, topics: as above. begun: called with the address. Raises CohelmError as above.
    """
    host, port = address(listen, PORT)

    def ready(at: tuple[Any, ...]) -> None:
        stop.handle_signals(seconds)
        begun(f"{bracketed(at[0])}:{at[1]}")

    return serve(plan, TeleopConfig(keys.robot(), host, port), ready, stop.over, topics)
