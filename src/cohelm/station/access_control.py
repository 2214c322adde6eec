"""Access control: host names, origins, the token, sessions, and tickets for downloads.

No cookie is set: a browser sends cookies to every port of a host, so also to another user's server
on the same machine, and with requests that another page caused. The page keeps its session in the
storage of its own origin, which includes the port, and sends it explicitly with each request.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
import time
from collections import deque
from collections.abc import Collection
from urllib.parse import urlsplit

TRIES = 5
"""Wrong tokens from one address within `TRIES_IN` that are answered one by one."""
TRIES_IN = 30.0
"""[s]"""
TICKET_FOR = 3600.0
"""A download may be started or resumed for so long [s]."""
_MOST_SESSIONS = 256
_MOST_TICKETS = 256


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach what listens on `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def is_own_host(host: str, certified: Collection[str] = ()) -> bool:
    """Whether a Host header names this machine, and not a name that was made to point here.

    An address can not be made to point elsewhere; a name can (DNS rebinding). So the only names
    accepted are localhost, this machine's own, and those `certified`: an attacker that makes
    another name point here has no certificate for it.
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
        return name in certified
    return True


def same_origin(origin: str | None, host: str, secure: bool) -> bool:
    """Whether a WebSocket comes from our own page. A browser always sends the origin."""
    return origin == f"{'https' if secure else 'http'}://{host}"


def is_cross_site(origin: str | None, site: str | None, host: str, secure: bool) -> bool:
    """Whether another page has caused a request; origin, site: Origin and Sec-Fetch-Site.

    Another port of this host is `same-site`, and another page. Programs say neither.
    """
    if origin is not None and not same_origin(origin, host, secure):
        return True
    return site is not None and site not in ("same-origin", "none")


class AccessControl:
    """Checks the token, sessions, and download tickets."""

    def __init__(self, token: str) -> None:
        self.token = token
        self._sessions: deque[str] = deque(maxlen=_MOST_SESSIONS)
        self._failures: dict[str, deque[float]] = {}
        self._tickets: deque[tuple[str, str, float]] = deque(maxlen=_MOST_TICKETS)

    def has_session(self, session: str | None) -> bool:
        """Whether this session is valid."""
        if session is None or not session.isascii():
            return False
        return any(hmac.compare_digest(session, known) for known in self._sessions)

    def login(self, token: str, address: str) -> str | None:
        """A session for the right token, None for a wrong one.

        The right one is always accepted: guessing locks no person out, and 128 bits can not be
        guessed.
        """
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            self._recent(address).append(time.monotonic())
            return None
        session = secrets.token_urlsafe(32)
        self._sessions.append(session)
        return session

    def too_many_attempts(self, address: str) -> bool:
        """Whether an address sent so many wrong tokens that more are only counted."""
        return len(self._recent(address)) >= TRIES

    def ticket(self, record: str) -> str:
        """A ticket that fetches one record, for a while: a link can carry no header."""
        made = secrets.token_urlsafe(32)
        self._tickets.append((made, record, time.monotonic() + TICKET_FOR))
        return made

    def ticket_valid(self, ticket: str | None, record: str) -> bool:
        """Whether this ticket is for this record, and still valid."""
        if ticket is None or not ticket.isascii():
            return False
        now = time.monotonic()
        return any(
            hmac.compare_digest(ticket, made) and record == name and now < until
            for made, name, until in self._tickets
        )

    def _recent(self, address: str) -> deque[float]:
        now = time.monotonic()
        if address not in self._failures and len(self._failures) > 1000:
            self._failures.clear()
        tries = self._failures.setdefault(address, deque(maxlen=TRIES))
        while tries and now - tries[0] > TRIES_IN:
            tries.popleft()
        return tries
