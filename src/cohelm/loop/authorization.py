"""Decides who may make the robot drive: the lease's holder, if he asked after every stop."""

from __future__ import annotations

import math

from cohelm.link.operator_input import ClientRequest

REMEMBERED = 10.0
"""No request is done that is so old [s]."""


class Authorization:
    """Remembers what ended a mode or forbade one, and judges requests by it."""

    def __init__(self) -> None:
        self.ended = 0
        """How often a mode was ended, or forbidden: by a stop, hold, fault, or the lease's end."""
        self._stood: dict[int, int] = {}
        """The number of each client's newest request to stand."""
        self._ended: dict[int, float] = {}
        """When each client did that last, 0: the robot itself [s]."""

    def end(self, who: int, now: float) -> None:
        """No mode, and no request made before, leads on from here. who: client; 0: the robot."""
        self.ended += 1
        self._ended = {w: at for w, at in self._ended.items() if now - at < REMEMBERED}
        self._stood = {w: number for w, number in self._stood.items() if w in self._ended}
        self._ended[who] = now

    def stand(self, asked: ClientRequest) -> None:
        """This request, done, told the robot to stand."""
        self._stood[asked.client] = asked.request.number

    def refusal(self, asked: ClientRequest, driver: int, now: float, hold: bool = False) -> str:
        """Why a request may not lead to driving; empty: it may. hold: it asks for hold, for which
        it is never too late.

        Whoever asked must drive still, and must have asked after everything that ended a mode or
        forbade one; what he did himself counts by the order of his requests.
        """
        if asked.client != driver:
            return "you do not drive"
        who, number = asked.client, asked.request.number
        made, own = now - asked.age, self._ended.get(who, -math.inf)
        others = (at for other, at in self._ended.items() if other != who)
        if not hold and now - own < REMEMBERED and number < self._stood.get(who, 0):
            return "you told the robot to stand after that: ask again"
        if not hold and (math.isnan(made) or made <= max(others, default=-math.inf)):
            return "the robot was told to stand after you asked: ask again"
        return ""
