"""A loop as small as can be, in a process of its own, which freezes where it is told to."""

from __future__ import annotations

import os
import signal
import socket
from multiprocessing.connection import Connection
from typing import Any

from cohelm.core.types import Twist
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.gate.modes import Mode
from cohelm.robot.keep.kept import rules
from cohelm.robot.keep.priority import urgent
from cohelm.robot.keep.process import KeptElsewhere
from tests.robot.keep.robots import Traced

SPEED = 0.5
PERIOD = 0.02


def drive(make: Traced, said: Connection, record: socket.socket, freezes: str) -> None:
    """Straight on for a second and more, then freeze in a call of this name once its request is
    on the way; `nothing`: go on until killed. Says how the robot is called, then that it drives,
    and what went wrong."""
    keeper = KeptElsewhere(make, rules(make.model, PERIOD), record)
    urgent()
    said.send(keeper.pid)
    ask, wanted = keeper._ask, False

    def freezing(what: str, *more: Any) -> Any:
        nonlocal wanted
        if what != freezes or not wanted:
            return ask(what, *more)
        wanted = False
        if what == "read":  # whose answer brings scan and frame, as one in a few does
            more = ((-1, -1),)
        before = keeper._answer

        def frozen(*given: Any) -> Any:
            keeper._answer = before
            os.kill(os.getpid(), signal.SIGSTOP)
            return before(*given)

        keeper._answer = frozen
        return ask(what, *more)

    keeper._ask = freezing
    due = keeper.now()
    for number in range(10_000):
        readings = keeper.read()
        keeper.propose(Proposal(number, readings.odometry.stamp, Twist(SPEED, 0.0)))
        if number == 10:
            assert not keeper.drive(Mode.AUTOMATIC)
        if number == 70:
            said.send("drives")
        wanted = wanted or number == 80
        due += PERIOD
        keeper.wait(due)
