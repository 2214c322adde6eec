"""Connects to a `foxglove_bridge`, with or without TLS, and checks its capabilities."""

from __future__ import annotations

import contextlib
import json
import socket
import ssl
from typing import Any, cast
from urllib.parse import SplitResult, urlsplit

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from cohelm.core.errors import CohelmError
from cohelm.ros.foxglove_protocol import PROTOCOLS
from cohelm.ros.tls_socket import TlsSocket

URL = "ws://localhost:8765"
"""Of a bridge on this machine, as it is started by default."""
_NEEDED = ("clientPublish", "connectionGraph")
OPENS = 5.0
"""So long may a connection take to begin [s]."""
_SILENT = 2.0
"""A bridge that does not answer a ping for so long is gone [s]."""
_LARGEST = 1 << 26
_NO_TLS = ("WRONG_VERSION_NUMBER", "RECORD_LAYER_FAILURE")
"""As OpenSSL, and 3.4 and later, calls what is no answer of TLS."""
_NOT_SENT_LOWEST = 25
"""TCP_NOTSENT_LOWAT of Linux: a socket that still holds what it did not send is not writable."""


def opened(url: str) -> tuple[ClientConnection, str]:
    """A new connection, after the bridge has sent its capabilities, and the bridge's name. Raises
    CohelmError where none answers, or a capability is missing."""
    at = _address(url)
    clear = at._replace(scheme="ws").geturl()
    try:
        # In clear, over a socket that does TLS where the address says so. legacy: websockets
        # 17.1 and later warn without it; earlier ones do not look at it, as there is a socket.
        there = connect(
            clear, sock=_reached(at), subprotocols=PROTOCOLS,
            compression=None, open_timeout=OPENS, close_timeout=0.5, ping_interval=1.0,
            ping_timeout=_SILENT, max_size=_LARGEST, proxy=None, legacy=True,
        )  # fmt: skip
        with contextlib.suppress(OSError):
            there.socket.setsockopt(socket.IPPROTO_TCP, _NOT_SENT_LOWEST, 1)
        info = understood(there.recv(OPENS))
    except ssl.SSLCertVerificationError as error:
        raise CohelmError(
            f"the certificate of {url} is not accepted (certificate verify failed: "
            f"{error.verify_message}): name the file of who signed it in SSL_CERT_FILE, and the "
            "bridge by the name in its certificate"
        ) from error
    except (OSError, ValueError, WebSocketException) as error:
        if isinstance(error, ssl.SSLError) and error.reason in _NO_TLS:
            raise CohelmError(
                f"{url} does no TLS: write {clear}, or give the bridge a certificate (its "
                "parameters tls, certfile and keyfile)"
            ) from error
        raise CohelmError(
            f"no foxglove_bridge answers at {url} ({error}): start it on the robot (ros2 "
            "launch foxglove_bridge foxglove_bridge_launch.xml), or name its address with --url"
        ) from error
    abilities = listed(info.get("capabilities"))
    lacking = [one for one in _NEEDED if one not in abilities]
    if lacking:
        there.close()
        raise CohelmError(
            f"the bridge at {url} offers no {' and no '.join(lacking)}: add that to its "
            "parameter capabilities, and start it again"
        )
    if "cdr" not in listed(info.get("supportedEncodings")):
        there.close()
        raise CohelmError(f"the bridge at {url} takes no CDR: it is none of ROS 2")
    there.send(json.dumps({"op": "subscribeConnectionGraph"}))
    return there, str(info.get("name", ""))


def _address(url: str) -> SplitResult:
    """Parses an address. Raises CohelmError for an invalid one."""
    with contextlib.suppress(ValueError):  # half an IPv6 address, or a port that there is not
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
        if host and parts.scheme in ("ws", "wss"):
            return parts
    raise CohelmError(f"--url {url!r}: give the bridge's address, such as {URL}")


def _reached(at: SplitResult) -> socket.socket:
    """A socket to an address, with TLS where the scheme asks for it. Raises OSError, or
    ValueError."""
    host, sealed = at.hostname or "", at.scheme == "wss"
    there = socket.create_connection((host, at.port or (443 if sealed else 80)), OPENS)
    if sealed:
        return TlsSocket(there, host)
    there.settimeout(None)
    return there


def listed(data: object) -> list[Any]:
    """A list; an empty one for what is none."""
    return cast("list[Any]", data) if isinstance(data, list) else []


def understood(data: str | bytes) -> dict[str, Any]:
    """A JSON object; an empty one for what is none."""
    try:
        made: Any = json.loads(data)
    except ValueError:
        return {}
    return cast("dict[str, Any]", made) if isinstance(made, dict) else {}
