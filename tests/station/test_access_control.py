"""Access control of the web server."""

import asyncio
import datetime
import http.client
import json
import socket
import ssl
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.typing import Origin, Subprotocol

from cohelm.core.errors import CohelmError
from cohelm.link.udp import address
from cohelm.station import serve, tls
from cohelm.station.access_control import is_loopback, is_own_host
from cohelm.station.serve import Server
from cohelm.station.tls import certificate
from tests.station.bare import Bare
from tests.station.servers import served
from tests.station.visitor import asked, opened, session

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.fixture(scope="module")
def open_server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as server:
        yield server


@pytest.fixture(scope="module", params=["127.0.0.1", "0.0.0.0"])
def any_server(bare: Bare, request: pytest.FixtureRequest) -> Iterator[Server]:
    with served(bare.connect, host=request.param) as server:
        yield server


def test_our_own_page_is_accepted(open_server: Server) -> None:
    with opened(open_server) as page:
        assert json.loads(page.recv(10))["type"] == "welcome"


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "https://127.0.0.1:{port}",
                                    "http://127.0.0.1", "http://localhost:{port}"])  # fmt: skip
def test_a_page_of_another_origin_is_refused(open_server: Server, origin: str | None) -> None:
    origin = origin and origin.replace("{port}", str(open_server.port))
    with pytest.raises(InvalidStatus), opened(open_server, origin=origin):
        pass


def test_a_foreign_host_name_is_refused(open_server: Server) -> None:
    assert asked(open_server, "GET", "/", host="evil.example").status == 421
    assert (
        asked(open_server, "GET", "/", host=f"localhost:{open_server.port}", origin="-").status
        == 200
    )


@pytest.mark.parametrize(
    ("host", "ours"),
    [("localhost:8765", True), ("127.0.0.1", True), ("[::1]:80", True), ("10.1.2.3:9", True),
     (socket.gethostname(), True), ("evil.example", False), ("127.0.0.1.evil.example", False),
     ("", False), ("[::1", False), ("localhost.evil.example", False)],
)  # fmt: skip
def test_host_names_of_this_machine_are_accepted(host: str, ours: bool) -> None:
    assert is_own_host(host) is ours


def test_loopback_addresses_are_recognized() -> None:
    assert all(is_loopback(h) for h in ("localhost", "127.0.0.1", "127.3.2.1", "::1", "[::1]"))
    assert not any(is_loopback(h) for h in ("0.0.0.0", "::", "10.0.0.1", "robot.local"))


def test_without_the_token_no_local_user_drives(any_server: Server) -> None:
    with pytest.raises(InvalidStatus), opened(any_server, "A" * 43):
        pass
    with pytest.raises(InvalidStatus), opened(any_server, any_server.token):  # it is no session
        pass
    assert asked(any_server, "GET", "/session").status == 401
    assert asked(any_server, "GET", "/records/x").status == 401
    assert asked(any_server, "POST", "/records/x").status == 401
    assert asked(any_server, "GET", "/").status == 200


def test_a_login_sets_nothing_that_a_browser_sends_by_itself(
    any_server: Server,
) -> None:
    answer = asked(any_server, "POST", "/session", any_server.token)
    assert answer.status == 200
    assert "set-cookie" not in answer.headers
    assert answer.headers["cache-control"] == "no-store"
    with opened(any_server, answer.text) as page:
        assert page.subprotocol == "cohelm"  # the session is not said back
        assert json.loads(page.recv(10))["type"] == "welcome"
    shown = {"authorization": f"Bearer {answer.text}"}
    assert asked(any_server, "GET", "/session", **shown).status == 204


def test_wrong_tokens_are_rate_limited_without_lockout(bare: Bare) -> None:
    """Whoever may guess, on this machine or behind the same address, must not shut out others."""
    with served(bare.connect, host="0.0.0.0") as server:
        said = [asked(server, "POST", "/session", "guess").status for _ in range(7)]
        assert said == [403] * 4 + [429] * 3
        assert asked(server, "POST", "/session", server.token).status == 200


def test_a_login_from_another_page_is_refused(any_server: Server) -> None:
    answer = asked(any_server, "POST", "/session", any_server.token, origin="http://evil")
    assert answer.status == 403


OTHER_PAGES = [
    {"origin": "http://evil.example", "sec_fetch_site": "cross-site"},
    {"origin": "-", "sec_fetch_site": "cross-site"},  # a link or a picture: no Origin
    {"origin": "-", "sec_fetch_site": "same-site"},  # another port of this machine
    {"origin": "http://127.0.0.1:1", "sec_fetch_site": "same-site"},
    {"origin": "null"},
    {"origin": "https://127.0.0.1:{port}"},
]
"""How a browser says that another page has caused a request."""


def test_every_route_refuses_requests_of_another_page(open_server: Server) -> None:
    """All routes there are: one that is added is tested too, or named here."""
    app = open_server.station.app()
    routes = {
        (method, route.path)
        for route in app.routes  # type: ignore[attr-defined]
        for method in getattr(route, "methods", None) or ["GET"]
    }
    assert routes == {
        ("GET", "/"), ("HEAD", "/"), ("GET", "/icon.svg"), ("HEAD", "/icon.svg"),
        ("GET", "/session"), ("HEAD", "/session"), ("POST", "/session"),
        ("GET", "/records/{name}"), ("HEAD", "/records/{name}"), ("POST", "/records/{name}"),
        ("GET", "/ws"), ("GET", "/assets"),
    }  # fmt: skip
    shown = {"authorization": f"Bearer {session(open_server)}"}
    for method, path in sorted(routes - {("GET", "/"), ("GET", "/ws")}):
        where = path.replace("{name}", "run.mcap")
        for other in OTHER_PAGES:
            said = {k: v.replace("{port}", str(open_server.port)) for k, v in other.items()}
            answer = asked(open_server, method, where, "x", **said, **shown)
            assert answer.status == 403, (method, path, said)


def test_a_link_to_the_page_may_be_followed_from_anywhere(open_server: Server) -> None:
    led = {"origin": "-", "sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}
    assert asked(open_server, "GET", "/", **led).status == 200


def test_pages_forbid_other_origins(open_server: Server) -> None:
    answer = asked(open_server, "GET", "/")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("text", ["hello", "[1]", '{"type":"dance"}', '{"type":"steer","n":1}'])
def test_a_page_that_is_not_understood_is_told_to_reload(open_server: Server, text: str) -> None:
    with opened(open_server) as page:
        page.send(text)
        assert _closed(page) == 1008
        assert "another version, reload it" in (page.close_reason or "")


def test_a_page_that_sends_a_burst_of_messages_is_disconnected(open_server: Server) -> None:
    with opened(open_server) as page:
        page.send("x" * (serve.LARGEST_MESSAGE + 1))
        assert _closed(page) == 1009


def test_a_page_that_sends_too_many_messages_a_second_is_disconnected(open_server: Server) -> None:
    with opened(open_server) as page:
        until = time.monotonic() + 30.0
        with suppress(ConnectionClosed):
            while time.monotonic() < until:  # more a second than are read, however many those are
                page.send('{"type":"got","stream":"state"}')
        assert _closed(page) == 1008


def _closed(page: ClientConnection) -> int | None:
    with suppress(ConnectionClosed):
        while True:
            page.recv(10)
    return page.close_code


def test_a_request_that_never_ends_is_closed_and_others_are_served(
    open_server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serve, "HEAD_WITHIN", 0.5)
    slow = [socket.create_connection(("127.0.0.1", open_server.port)) for _ in range(10)]
    for one in slow:
        one.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ")
    assert asked(open_server, "GET", "/").status == 200
    until = time.monotonic() + 10.0
    for one in slow:
        one.settimeout(max(until - time.monotonic(), 0.1))
        with suppress(ConnectionError, TimeoutError):
            while True:
                one.sendall(b"a")
                time.sleep(0.05)
                assert time.monotonic() < until, "still listened to"
        one.close()


def test_a_port_in_use_is_reported_with_the_cure(open_server: Server) -> None:
    with pytest.raises(CohelmError, match="--port"):
        Server(open_server.station.connect, "127.0.0.1", open_server.port)


@pytest.mark.parametrize("host", ["192.0.2.1", "robot.invalid"])
def test_a_host_that_is_not_this_machine_is_reported_with_the_cure(bare: Bare, host: str) -> None:
    """No port helps there."""
    with pytest.raises(CohelmError, match="with --host an address of this machine"):
        Server(bare.connect, host, 0)


def test_the_tls_certificate_is_kept(tmp_path: Path, bare: Bare) -> None:
    path, key, shown = certificate(tmp_path, "127.0.0.1")
    assert certificate(tmp_path, "localhost")[2] == shown
    assert key.stat().st_mode & 0o077 == 0
    trusting = ssl.create_default_context(cafile=path)
    with served(bare.connect, certificate=(path, key)) as server:
        assert server.address.startswith("https://127.0.0.1:")
        here = f"127.0.0.1:{server.port}"
        link = http.client.HTTPSConnection(here, context=trusting)
        link.request("POST", "/session", server.token)
        protocols = ["cohelm", link.getresponse().read().decode()]
        where, own = f"wss://{here}/ws", f"https://{here}"

        async def welcome(origin: str) -> str:
            # In one thread: websockets.sync reads and writes one TLS connection from two, which
            # OpenSSL does not take, and once in some thousand times loses the answer.
            opening = connect(
                where, origin=Origin(origin), ssl=trusting,
                subprotocols=[Subprotocol(one) for one in protocols],
            )  # fmt: skip
            async with opening as page:
                return str(json.loads(await page.recv())["type"])

        def said(origin: str) -> str:
            # A thread of its own: a browser of the tests before may have left a loop in this one.
            with ThreadPoolExecutor(1) as pool:
                return pool.submit(asyncio.run, asyncio.wait_for(welcome(origin), 10.0)).result()

        assert said(own) == "welcome"
        with pytest.raises(InvalidStatus) as refused:
            said(f"http://{here}")
        assert refused.value.response.status_code == 403
        link.close()


@pytest.mark.parametrize(("years", "kept"), [(0, True), (-3, False), (10, False)])
def test_a_made_certificate_is_made_anew_where_a_browser_would_find_it_over_or_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, years: int, kept: bool
) -> None:
    """As after a start with a clock that was wrong."""

    class Wrong(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> datetime.datetime:
            return datetime.datetime.now(tz) + datetime.timedelta(days=365 * years)

    with monkeypatch.context() as then:
        then.setattr(tls, "datetime", SimpleNamespace(**(vars(datetime) | {"datetime": Wrong})))
        shown = certificate(tmp_path, "127.0.0.1")[2]
    assert (certificate(tmp_path, "127.0.0.1")[2] == shown) is kept


@pytest.mark.parametrize(
    ("text", "where"),
    [("robot.local", ("robot.local", 7)), ("10.0.0.5:8", ("10.0.0.5", 8)), ("::1", ("::1", 7)),
     ("[fe80::1]:9", ("fe80::1", 9))],
)  # fmt: skip
def test_the_address_of_the_robot_is_parsed(text: str, where: tuple[str, int]) -> None:
    assert address(text, 7) == where


@pytest.mark.parametrize("text", ["", "a:b", "a/b", "a:99999", ":80", "me@robot"])
def test_an_invalid_robot_address_is_reported(text: str) -> None:
    with pytest.raises(CohelmError, match="HOST"):
        address(text, 7)
