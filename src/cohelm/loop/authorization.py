"""Authorizes requests to drive: the lease holder's, if made after every stop."""

from __future__ import annotations

import math

from cohelm.link.operator import ClientRequest

REMEMBERED = 10.0
"""Older requests are never executed [s]."""


class Authorization:
    """Remembers what ended or forbade a mode, and judges requests by it."""

    def __init__(self) -> None:
        self.revocations = 0
        """Count of ended or forbidden modes: by a stop, hold, fault, or the lease's end."""
        self._last_hold: dict[int, int] = {}
        """The number of each client's newest stop or hold request."""
        self._revoked_at: dict[int, float] = {}
        """When each client last did that, 0: the robot itself [s]."""

    def revoke(self, who: int, now: float) -> None:
        """Revoke the mode and all requests made before now [s]. who: client; 0: the robot."""
        self.revocations += 1
        self._revoked_at = {w: at for w, at in self._revoked_at.items() if now - at < REMEMBERED}
        self._last_hold = {w: n for w, n in self._last_hold.items() if w in self._revoked_at}
        self._revoked_at[who] = now

    def record_hold(self, request: ClientRequest) -> None:
        """This request, a stop or hold, was executed."""
        self._last_hold[request.client] = request.request.number

    def refusal(self, request: ClientRequest, driver: int, now: float, hold: bool = False) -> str:
        """Why a request may not lead to driving; empty: it may. hold: it requests hold, which is
        never too late.

        The client must still hold the lease, and must have made the request after everything that
        ended or forbade a mode; its own requests count by their order.
        """
        if request.client != driver:
            return "you are not the driver"
        who, number = request.client, request.request.number
        made, own = now - request.age, self._revoked_at.get(who, -math.inf)
        others = (at for other, at in self._revoked_at.items() if other != who)
        if not hold and now - own < REMEMBERED and number < self._last_hold.get(who, 0):
            return "you stopped the robot after that: request it again"
        if not hold and (math.isnan(made) or made <= max(others, default=-math.inf)):
            return "the robot was stopped after your request: request it again"
        return ""
