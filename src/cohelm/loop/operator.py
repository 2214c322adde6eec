"""The port of the loop's operator, and operators without a link."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from cohelm.core.types import Stick
from cohelm.link.messages import Command, Device, Discs, Request, RequestKind, ScanPart, Status
from cohelm.link.operator_input import ClientRequest, OperatorInput

NO_INPUT = OperatorInput(0, "", None, math.nan, math.nan, ())


class Operator(Protocol):
    """Port of an operator; `link.robot_end.RobotEnd` is one. Calls return at once.

    A subclass that leaves a method out gives no command, or ignores what it is sent.
    """

    def receive(self) -> OperatorInput:
        """The driver's newest command; each request is returned once."""
        return NO_INPUT

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Send the result of a request."""

    def record(self, on: bool, /) -> str:
        """Start or end a record, as the driver requests; returns why not, or ""."""
        return "this robot does not record"

    def send_status(self, status: Status) -> None:
        """Send the robot's status."""

    def show(self, *parts: ScanPart | Discs) -> None:
        """Send parts of a scan, or obstacles."""


class NullOperator(Operator):
    """No operator."""


class Scripted(NullOperator):
    """An operator whose stick follows a script, in the robot's time."""

    def __init__(self, script: Callable[[float], Stick | None], clock: Callable[[], float]) -> None:
        """script: the deflection at a time [s]; None: there is no stick then."""
        self._script, self._clock = script, clock
        self._requests: list[ClientRequest] = []
        self.answers: list[tuple[int, bool, str]] = []
        """Number, granted, reason."""
        self.statuses: list[Status] = []
        """The last hundred sent."""

    def ask(self, what: RequestKind, value: int = 0) -> None:
        """Make a request."""
        number = len(self._requests) + len(self.answers) + 1
        self._requests.append(ClientRequest(1, "script", Request(number, what, value, 0.0)))

    def receive(self) -> OperatorInput:
        """The script's present deflection, and new requests."""
        requests, self._requests = tuple(self._requests), []
        stick = self._script(self._clock())
        deflection = Stick(0.0, 0.0) if stick is None else stick
        command = Command(deflection, stick is not None, True, Device.SCRIPT, 1.0, ())
        return OperatorInput(1, "script", command, 0.0, 0.0, requests)

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Keep it."""
        self.answers.append((number, granted, reason))

    def send_status(self, status: Status) -> None:
        """Keep it."""
        self.statuses.append(status)
        del self.statuses[:-100]
