"""`cohelm.drive`: a robot of one's own with loop, gate and record, from a Python script."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.files import as_path
from cohelm.drive.factory import own_robot
from cohelm.drive.operate import End, end_signals, mode_and_stick
from cohelm.drive.session import SessionConfig
from cohelm.drive.until_ended import drive_for_stations, drive_here
from cohelm.loop.loop import LoopParams
from cohelm.robot.adapter import Make
from cohelm.robot.model import RobotModel
from cohelm.scenario.model import Scenario


def drive(
    robot: Make | str, site: str | Path | Scenario | None = None, *,
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
    the robot's YAML file. mode: hold, automatic, shared or manual; by default automatic, so that it
    sets off, or shared where the site has a stick; without a site there is no route, and it is
    hold. rate: periods a second, 10 to 500 [Hz]. seconds: end after so many. arrive: end when the
    route is done. record: into this MCAP file. listen: HOST[:PORT], paired stations drive it, and
    it stands until one does. carry_on: whether the controller drives on alone when a stick in use
    vanishes.

    A robot whose `real_time` is False is driven in its own time, in this process.

    Raises CohelmError where something can not be started.
    """
    if not _is_number(rate) or not 10.0 <= rate <= 500.0:
        raise CohelmError(f"rate must be from 10 to 500 periods a second, got {rate!r}")
    if seconds is not None and (not _is_number(seconds) or not seconds > 0.0):
        raise CohelmError(f"seconds must be more than 0, or None without an end, got {seconds!r}")
    for name, given in {"mode": mode, "listen": listen or ""}.items():
        if not isinstance(given, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise CohelmError(f"{name} must be a text, got {given!r}")
    if listen is not None and (mode or arrive):
        raise CohelmError(
            "with listen the station chooses mode and goal: leave out mode and arrive"
        )
    made = own_robot(robot, site, model)
    file = None if record is None else as_path(record, "the record's file")
    loop = LoopParams(carry_on=carry_on)
    plan = SessionConfig(made, rate, file, loop=loop)
    heeding = threading.current_thread() is threading.main_thread()
    with end_signals() if heeding else nullcontext(End([])) as stop:
        if listen is not None:
            return drive_for_stations(plan, listen, stop, seconds)
        return drive_here(plan, *mode_and_stick(made, mode), stop, seconds, arrive)


def _is_number(given: object) -> bool:
    return isinstance(given, int | float)
