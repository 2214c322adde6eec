"""A loop as small as can be, in a process of its own, which freezes where it is told to."""

from __future__ import annotations

import os
import signal
import socket
import time
from multiprocessing.connection import Connection
from typing import Any

from cohelm.core.types import Twist
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.gate.modes import GateMode
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.priority import raise_priority
from cohelm.robot.keep.process import RemoteGatedRobot
from cohelm.robot.port import Readings
from tests.robot.keep.robots import Traced

SPEED = 0.5
PERIOD = 0.02


def drive(make: Traced, said: Connection, record: socket.socket, wrong: str) -> None:
    """Straight on for a second and more, then go wrong. Says who keeps the robot, then that it
    drives.

    wrong: a call in which it freezes, with its request on the way; or `only reads`, or `listens
    no more`, and goes on asking.
    """
    gated = RemoteGatedRobot(make, rules(make.model, PERIOD), record)
    raise_priority()
    said.send(gated.pid)
    ask, wanted = gated._ask, False

    def freezing(what: str, *more: Any, **named: Any) -> Any:
        nonlocal wanted
        if what != wrong or not wanted:
            return ask(what, *more, **named)
        wanted = False
        if what == "read":  # whose answer brings scan and frame, as one in a few does
            more = -1, {}, -1
        before = gated._answer

        def frozen(*given: Any) -> Any:
            gated._answer = before
            os.kill(os.getpid(), signal.SIGSTOP)
            answer = before(*given)
            whole = what != "read" or isinstance(answer, Readings)
            said.send((gated.gate.mode.name, whole))
            return answer

        gated._answer = frozen
        return ask(what, *more, **named)

    gated._ask = freezing
    due = gated.now()
    for number in range(10_000):
        readings = gated.read()
        gated.propose(Proposal(number, readings.odometry.stamp, Twist(SPEED, 0.0)))
        gated.truth()
        if number == 10:
            assert not gated.drive(GateMode.AUTOMATIC)
        if number == 70:
            said.send("drives")
        wanted = wanted or number == 80
        while wanted and wrong == "only reads":
            gated.read()
        while wanted and wrong == "listens no more":
            gated._line.send((number, "read", (-1, {}, -1)))
            gated._line.send((number, "truth", ()))
            time.sleep(0.001)
        due += PERIOD
        gated.wait(due)
