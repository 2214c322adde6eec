"""The operator's side of the loop: what it must offer, and those without a link."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from cohelm.core.types import Stick
from cohelm.link.messages import Ask, Command, Device, Discs, Request, ScanPart, Status
from cohelm.link.operator_input import ClientRequest, OperatorInput

NOBODY = OperatorInput(0, "", None, math.nan, math.nan, ())


class Operator(Protocol):
    """`link.robot_end.RobotEnd` is one. Calls return at once."""

    def receive(self) -> OperatorInput:
        """What the person wants now; each request is handed out once."""
        ...

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """What became of a request."""
        ...

    def tell(self, status: Status) -> None:
        """What the robot does now."""
        ...

    def show(self, *parts: ScanPart | Discs) -> None:
        """What it sees."""
        ...


class NullOperator:
    """No operator at all."""

    def receive(self) -> OperatorInput:
        """Nothing."""
        return NOBODY

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Nobody asked."""

    def tell(self, status: Status) -> None:
        """Nobody listens."""

    def show(self, *parts: ScanPart | Discs) -> None:
        """Nobody looks."""


class Scripted(NullOperator):
    """A hand that follows a script, in the robot's time."""

    def __init__(self, hand: Callable[[float], Stick | None], clock: Callable[[], float]) -> None:
        """hand: the deflection at a time [s]; None: there is no stick then."""
        self._hand, self._clock = hand, clock
        self._asked: list[ClientRequest] = []
        self.answers: list[tuple[int, bool, str]] = []
        """Number, granted, reason."""
        self.statuses: list[Status] = []
        """The last hundred told."""

    def ask(self, what: Ask, value: int = 0) -> None:
        """Have something done once."""
        number = len(self._asked) + len(self.answers) + 1
        self._asked.append(ClientRequest(1, "script", Request(number, what, value, 0.0)))

    def receive(self) -> OperatorInput:
        """The script's deflection, as fresh as can be."""
        asked, self._asked = tuple(self._asked), []
        stick = self._hand(self._clock())
        known = Stick(0.0, 0.0) if stick is None else stick
        command = Command(known, stick is not None, True, Device.SCRIPT, 1.0, ())
        return OperatorInput(1, "script", command, 0.0, 0.0, asked)

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Keep it."""
        self.answers.append((number, granted, reason))

    def tell(self, status: Status) -> None:
        """Keep it."""
        self.statuses.append(status)
        del self.statuses[:-100]
