"""`cohelm.drive`: a robot of one's own with loop, gate and record, from a Python script."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.drive.factory import Make, own_robot
from cohelm.drive.operate import End, ended, hands
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.teleop_server import TeleopConfig, serve
from cohelm.link import keys
from cohelm.link.udp import PORT, address
from cohelm.loop.loop import Loop, LoopParams
from cohelm.robot.model import RobotModel
from cohelm.scenario.model import Scenario


def drive(
    robot: Make | str, site: str | Path | Scenario = "lab-guard", *,
    model: RobotModel | str | Path | None = None, mode: str = "", rate: float = 50.0,
    seconds: float | None = None, arrive: bool = False, record: str | Path | None = None,
    listen: str | None = None, carry_on: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Drive a robot until Ctrl-C, as `cohelm robot --driver` does; what became of it, in numbers.

        >>> import cohelm
        >>> cohelm.drive(Cart, "office.yaml", model="cart.yaml")       # doctest: +SKIP
        {'reason': ...}

    robot: a subclass of `cohelm.Robot`, "package:Class", or an instance that can be pickled. It is
    made in a process of its own, so a script needs `if __name__ == "__main__":`. site: a scenario;
    its walls are the map, its route and law are followed, its obstacles are not simulated. model:
    the robot's YAML file. mode: hold, automatic, shared or manual; by default as the site's stick
    is. rate: periods a second, 10 to 500 [Hz]. seconds: end after so many. arrive: end when the
    route is done. record: into this MCAP file. listen: HOST[:PORT], paired stations drive it.
    carry_on: whether the controller drives on alone when a stick in use vanishes.

    A robot whose `real_time` is False is driven in its own time, in this process.

    Raises CohelmError where something can not be started.
    """
    if not 10.0 <= rate <= 500.0:
        raise CohelmError(f"rate must be from 10 to 500 periods a second, got {rate:g}")
    if listen is not None and (mode or arrive):
        raise CohelmError("with listen the station says how to drive: leave out mode and arrive")
    made = own_robot(robot, site, model)
    file = None if record is None else Path(record)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
    ways = LoopParams(carry_on=carry_on)
    plan = SessionConfig(made, rate, file, ways=ways)
    heeding = threading.current_thread() is threading.main_thread()
    with ended() if heeding else nullcontext(End([])) as stop:
        if listen is not None:
            return _served(plan, listen, seconds, stop)
        chosen, operator = hands(made, mode)
        with Session(plan, operator) as session:
            stop.heed()
            clock = session.loop.keeper.now
            operator.watches(clock)
            begun = clock()

            def until(loop: Loop) -> bool:
                late = seconds is not None and clock() - begun >= seconds
                return stop.asked != "" or late or (arrive and loop.driver.arrived)

            session.run(until, chosen)
            session.end(stop.asked or "the drive is over")
            return session.summary()


def _served(plan: SessionConfig, where: str, seconds: float | None, stop: End) -> dict[str, Any]:
    host, port = address(where, PORT)
    door = TeleopConfig(keys.robot(), host, port)
    over = threading.Event()
    timer = threading.Timer(seconds if seconds is not None else 0.0, over.set)
    timer.daemon = True

    def ready(_: tuple[Any, ...]) -> None:
        stop.heed()
        if seconds is not None:
            timer.start()

    try:
        return serve(
            plan, door, ready,
            lambda: stop.asked or ("its time is over" if over.is_set() else ""),
        )  # fmt: skip
    finally:
        timer.cancel()
