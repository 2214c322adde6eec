"""The robot's side of a drive for link tests: arming, loss and stops as in the loop."""

from __future__ import annotations

from typing import NamedTuple

from cohelm.core.types import CENTRED, Stick
from cohelm.link.messages import Arming, Mode, Request, RequestKind
from cohelm.link.operator import OperatorInput
from cohelm.loop.stick import ArmingParams, StickState, updated

DT = 0.02


class Used(NamedTuple):
    """What a period makes of the driver."""

    stick: Stick
    brake: bool
    arming: Arming


class Side:
    """Stops for what the loop stops for, and stays stopped until it is reset."""

    def __init__(self) -> None:
        # as fast as a hand: these tests ask which deflection was used, not how fast it came
        self.params = ArmingParams(max_rate=1e9)
        self.stick_state = StickState()
        self.mode = Mode.SHARED
        self.stopped = ""
        self.asked: list[RequestKind] = []
        self._seen = False

    def ask(self, request: Request, name: str) -> tuple[bool, str]:
        self.asked.append(request.what)
        if request.what is RequestKind.STOP:
            self.stopped = f"stop by {name}"
        elif request.what is RequestKind.RESET:
            self.stopped = ""
        elif request.what is RequestKind.MODE:
            self.mode = Mode(request.value)
        return True, ""

    def step(self, heard: OperatorInput) -> Used:
        self.stick_state = updated(self.stick_state, heard, self.params, DT)
        self._seen = self._seen or self.stick_state.received.command is not None
        lost = self.stick_state.lost or (self.stick_state.driver_lost if self._seen else "")
        if lost and not self.stopped:
            self.stopped = lost
        brake = bool(self.stopped)
        return Used(CENTRED if brake else self.stick_state.stick, brake, self.stick_state.arming)
