"""Who may come in: host names, origins, the token, and how often one may try."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
import time
from collections import deque
from urllib.parse import urlsplit

COOKIE = "cohelm"
TRIES = 5
"""Wrong tokens from one address within `TRIES_IN` that are heard."""
TRIES_IN = 30.0
"""[s]"""
_MOST_SESSIONS = 256


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach what listens on `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def own_name(host: str) -> bool:
    """Whether a Host header names this machine, and not a name that somebody made point here.

    An address can not be made to point elsewhere; a name can (DNS rebinding), so of names only
    localhost and this machine's own are taken.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    mine = socket.gethostname().lower()
    if name in ("localhost", mine, mine.partition(".")[0], f"{mine.partition('.')[0]}.local"):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def same_origin(origin: str | None, host: str, secure: bool) -> bool:
    """Whether a WebSocket comes from our own page. A browser always says where from."""
    return origin == f"{'https' if secure else 'http'}://{host}"


class Doorkeeper:
    """Knows the token and who has shown it. Without a token everybody may come in."""

    def __init__(self, token: str | None) -> None:
        self.token = token
        self._sessions: deque[str] = deque(maxlen=_MOST_SESSIONS)
        self._wrong: dict[str, deque[float]] = {}

    def knows(self, cookie: str | None) -> bool:
        """Whether this cookie was given out."""
        if self.token is None:
            return True
        if cookie is None or not cookie.isascii():
            return False
        return any(hmac.compare_digest(cookie, session) for session in self._sessions)

    def may_try(self, address: str) -> bool:
        """Whether an address may show a token now."""
        return len(self._recent(address)) < TRIES

    def shown(self, token: str, address: str) -> str | None:
        """A cookie for the right token, None for a wrong one."""
        right = self.token or ""
        if not hmac.compare_digest(token.encode(), right.encode()):
            self._recent(address).append(time.monotonic())
            return None
        session = secrets.token_urlsafe(32)
        self._sessions.append(session)
        return session

    def _recent(self, address: str) -> deque[float]:
        now = time.monotonic()
        if address not in self._wrong and len(self._wrong) > 1000:
            self._wrong.clear()
        tries = self._wrong.setdefault(address, deque(maxlen=TRIES))
        while tries and now - tries[0] > TRIES_IN:
            tries.popleft()
        return tries


class Rate:
    """A bucket of messages that fills up steadily; empty, no more are heard."""

    def __init__(self, per_second: float, at_once: float) -> None:
        self.per_second, self.at_once = per_second, at_once
        self._left, self._at = at_once, time.monotonic()

    def allows(self) -> bool:
        """Take one out, if there is one."""
        now = time.monotonic()
        self._left = min(self._left + (now - self._at) * self.per_second, self.at_once)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
