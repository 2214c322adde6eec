"""Both ends of the link on this machine, for tests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from cohelm.core.types import Pose, Stick, Twist
from cohelm.law.verdict import Verdict
from cohelm.link import messages as m
from cohelm.link.codec import Reader, layout
from cohelm.link.robot_end import RobotEnd
from cohelm.link.station_end import StationEnd
from tests.patience import looks

NAN = math.nan
STATUS: m.Status = layout(m.Status).read(Reader(bytes(1000)))._replace(  # all else: nothing
    lease=m.Lease(0, 0, "", 0, "", NAN), mode=m.Mode.SHARED, arming=m.Arming.ABSENT,
    authority=1.0, pose=Pose(1.0, 2.0, 0.5),
    measured=Twist(0.1, 0.0), nominal=Twist(0.5, 0.1), applied=Twist(0.3, 0.1), why="too near",
    verdict=Verdict.SHAPED, clearance_seen=0.2, limiting=(1.5, 2.0), h=0.1, speed_cap=math.inf,
    reference=Pose(1.1, 2.0, 0.5), localised=m.Localised.GOOD,
    timing=m.TimingReport(0.001, 0, NAN, NAN, NAN, 0),
)  # fmt: skip
CENTRED = Stick(0.0, 0.0)
LATE = ("the robot did not answer in time", "the request is too old")
"""Why a request is refused on a machine that took a second for it."""


def until(
    true: Callable[[], object], within: float = 10.0, turn: Callable[[], object] = int
) -> float:
    """Wait for something, calling `turn` meanwhile; returns how long it took [s]."""
    began = time.monotonic()
    for _ in looks(within, 0.005, 0.1):
        if true():
            return time.monotonic() - began
        turn()
    raise AssertionError("it did not come about")


def clients(robot: RobotEnd) -> dict[int, str]:
    """Who is connected: names by number."""
    with robot._lock:
        return {c.number: c.channel.name for c in robot._clients.identified()}


def answered(
    station: StationEnd, what: m.RequestKind, value: int = 0, turn: Callable[[], object] = int
) -> m.Answer:
    """The answer to a request, which is made again where it came too late."""
    while True:
        number = station.ask(what, value)
        until(lambda number=number: station.answer(number), turn=turn)
        answer = station.answer(number)
        assert answer is not None
        if answer.reason not in LATE:
            return answer
