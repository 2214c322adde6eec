"""The port of the loop's operator (a link, a local stick or a script): what it gives and gets."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from cohelm.core.types import Stick
from cohelm.link.messages import Command, Device, Discs, Request, RequestKind, ScanPart, Status

STALE = 0.25
"""A driver without a command for this long is lost, with or without a stick [s]: no older one is
used."""
AHEAD = 0.05
"""Messages stamped further ahead of now are not used [s]."""


def is_current(age: float, stale: float = STALE) -> bool:
    """Whether a command or stick of this age is used [s]. stale: the oldest that is [s]; NaN, an
    age that is not known, is not."""
    return -AHEAD <= age <= stale


class ClientRequest(NamedTuple):
    """A request that the loop must execute or refuse, and answer."""

    client: int
    name: str
    request: Request
    age: float = 0.0
    """Upper bound of its age [s]; NaN: the client has left."""


class OperatorInput(NamedTuple):
    """The driver's present input."""

    driver: int
    """Client number; 0: nobody drives."""
    name: str
    command: Command | None
    """The driver's newest, however old: `loop.stick` judges that. None: there is none."""
    age: float
    """Of that command [s]; NaN: not known."""
    round_trip: float
    """To the driver [s]; NaN: not known."""
    requests: tuple[ClientRequest, ...]
    """New since the last call, oldest first, but a stop before all others."""
    term: int = 0
    """Count of leases; a change ends what was chosen before. A driver that is lost without a
    successor leaves it unchanged."""
    why: str = ""
    """Why there is no stick, where it is known."""


def stops_first(requests: tuple[ClientRequest, ...]) -> tuple[ClientRequest, ...]:
    """The requests with stops first."""
    return tuple(sorted(requests, key=lambda one: one.request.what != RequestKind.STOP))


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
        command = Command(deflection, stick is not None, True, Device.SCRIPT)
        return OperatorInput(1, "script", command, 0.0, 0.0, requests)

    def answer(self, client: int, number: int, granted: bool, reason: str = "") -> None:
        """Keep it."""
        self.answers.append((number, granted, reason))

    def send_status(self, status: Status) -> None:
        """Keep it."""
        self.statuses.append(status)
        del self.statuses[:-100]
