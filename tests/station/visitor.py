"""A client of the station that behaves as a page, or not."""

from __future__ import annotations

import http.client
from typing import NamedTuple

from websockets.sync.client import ClientConnection, connect

from cohelm.station.serve import Server


class Said(NamedTuple):
    """An answer of the station."""

    status: int
    headers: http.client.HTTPMessage
    text: str


def asked(server: Server, method: str, path: str, body: str | None = None, **headers: str) -> Said:
    """One request, as our own page makes it unless `headers` say something else; - for no such."""
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    headers.setdefault("origin", f"http://127.0.0.1:{server.port}")
    named = {k.replace("_", "-"): v for k, v in headers.items() if v != "-"}
    link.request(method, path, body, named)
    answer = link.getresponse()
    text = answer.read().decode(errors="replace")
    link.close()
    return Said(answer.status, answer.headers, text)


def session(server: Server) -> str:
    """What a page gets for the token."""
    said = asked(server, "POST", "/session", server.token)
    assert said.status == 200
    return said.text


def opened(
    server: Server, shown: str | None = None, key: str = "", **options: object
) -> ClientConnection:
    """A WebSocket; shown: the session, else one that is got for the token. key: of the operator
    that it was."""
    here = f"127.0.0.1:{server.port}"
    options.setdefault("origin", f"http://{here}")
    options.setdefault("close_timeout", 0.5)  # who has not read all does not see the answer to it
    protocols = ["cohelm", shown or session(server)]
    return connect(f"ws://{here}/ws?key={key}", max_size=None, subprotocols=protocols, **options)  # type: ignore[arg-type]
