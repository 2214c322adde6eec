"""Who is let in to the web server, and who is not."""

import http.client
import json
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from cohelm.core.errors import CohelmError
from cohelm.link.udp import address
from cohelm.station import serve
from cohelm.station.doors import is_loopback, own_name
from cohelm.station.serve import Server
from cohelm.station.tls import certificate
from tests.station.servers import Robot, served

pytestmark = pytest.mark.xdist_group("browser")  # they share the robot


@pytest.fixture(scope="module")
def open_server(robot: Robot) -> Iterator[Server]:
    with served(robot.connect) as server:
        yield server


@pytest.fixture(scope="module")
def locked_server(robot: Robot) -> Iterator[Server]:
    with served(robot.connect, host="0.0.0.0") as server:
        yield server


def _socket(server: Server, **options: object) -> ClientConnection:
    here = f"127.0.0.1:{server.port}"
    options.setdefault("origin", f"http://{here}")
    return connect(f"ws://{here}/ws", max_size=None, **options)  # type: ignore[arg-type]


def _asked(
    server: Server, method: str, path: str, body: str | None = None, **headers: str
) -> http.client.HTTPResponse:
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    headers.setdefault("origin", f"http://127.0.0.1:{server.port}")
    link.request(method, path, body, headers)
    answer = link.getresponse()
    answer.read()
    link.close()
    return answer


def test_our_own_page_is_let_in(open_server: Server) -> None:
    with _socket(open_server) as page:
        assert json.loads(page.recv(10))["type"] == "welcome"


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "https://127.0.0.1:{port}",
                                    "http://127.0.0.1", "http://localhost:{port}"])  # fmt: skip
def test_a_page_from_elsewhere_is_refused(open_server: Server, origin: str | None) -> None:
    origin = origin and origin.replace("{port}", str(open_server.port))
    with pytest.raises(InvalidStatus), _socket(open_server, origin=origin):
        pass


def test_a_foreign_name_that_points_here_is_refused(open_server: Server) -> None:
    assert _asked(open_server, "GET", "/", host="evil.example").status == 421
    assert _asked(open_server, "GET", "/", host=f"localhost:{open_server.port}").status == 200


@pytest.mark.parametrize(
    ("host", "ours"),
    [("localhost:8765", True), ("127.0.0.1", True), ("[::1]:80", True), ("10.1.2.3:9", True),
     (socket.gethostname(), True), ("evil.example", False), ("127.0.0.1.evil.example", False),
     ("", False), ("[::1", False), ("localhost.evil.example", False)],
)  # fmt: skip
def test_names_of_this_machine(host: str, ours: bool) -> None:
    assert own_name(host) is ours


def test_what_only_this_machine_reaches() -> None:
    assert all(is_loopback(h) for h in ("localhost", "127.0.0.1", "127.3.2.1", "::1", "[::1]"))
    assert not any(is_loopback(h) for h in ("0.0.0.0", "::", "10.0.0.1", "robot.local"))


def test_nobody_drives_over_the_network_without_the_token(locked_server: Server) -> None:
    with pytest.raises(InvalidStatus), _socket(locked_server):
        pass
    assert _asked(locked_server, "GET", "/session").status == 401
    assert _asked(locked_server, "GET", "/records/x").status == 401
    assert _asked(locked_server, "GET", "/").status == 200


def test_the_token_opens_and_its_cookie_is_for_this_site_and_no_script(
    locked_server: Server,
) -> None:
    answer = _asked(locked_server, "POST", "/session", locked_server.token)
    assert answer.status == 204
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    with _socket(locked_server, additional_headers={"cookie": cookie.partition(";")[0]}) as page:
        assert json.loads(page.recv(10))["type"] == "welcome"
    forged = {"cookie": "cohelm=" + "A" * 43}
    with pytest.raises(InvalidStatus), _socket(locked_server, additional_headers=forged):
        pass


def test_wrong_tokens_are_soon_not_heard_any_more(robot: Robot) -> None:
    with served(robot.connect, host="0.0.0.0") as server:
        said = [_asked(server, "POST", "/session", "guess").status for _ in range(7)]
        assert said == [403] * 5 + [429] * 2
        assert _asked(server, "POST", "/session", server.token).status == 429


def test_a_login_from_another_page_is_refused(locked_server: Server) -> None:
    answer = _asked(locked_server, "POST", "/session", locked_server.token, origin="http://evil")
    assert answer.status == 403


def test_pages_forbid_what_does_not_come_from_here(open_server: Server) -> None:
    answer = _asked(open_server, "GET", "/")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("text", ["hello", "[1]", '{"type":"dance"}'])
def test_a_page_that_speaks_nonsense_is_let_go(open_server: Server, text: str) -> None:
    with _socket(open_server) as page:
        page.send(text)
        assert _closed(page) == 1008


def test_a_page_that_says_too_much_at_once_is_let_go(open_server: Server) -> None:
    with _socket(open_server) as page:
        page.send("x" * (serve.LARGEST_MESSAGE + 1))
        assert _closed(page) == 1009


def test_a_page_that_says_too_much_in_a_second_is_let_go(open_server: Server) -> None:
    with _socket(open_server) as page:
        with suppress(ConnectionClosed):
            for _ in range(5000):
                page.send('{"type":"got","stream":"state"}')
        assert _closed(page) == 1008


def _closed(page: ClientConnection) -> int | None:
    with suppress(ConnectionClosed):
        while True:
            page.recv(10)
    return page.close_code


def test_a_request_that_never_ends_is_let_go_and_others_are_served(
    open_server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serve, "HEAD_WITHIN", 0.5)
    slow = [socket.create_connection(("127.0.0.1", open_server.port)) for _ in range(10)]
    for one in slow:
        one.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ")
    assert _asked(open_server, "GET", "/").status == 200
    until = time.monotonic() + 10.0
    for one in slow:
        one.settimeout(max(until - time.monotonic(), 0.1))
        with suppress(ConnectionError, TimeoutError):
            while True:
                one.sendall(b"a")
                time.sleep(0.05)
                assert time.monotonic() < until, "still listened to"
        one.close()


def test_a_taken_port_is_said_with_the_cure(open_server: Server) -> None:
    with pytest.raises(CohelmError, match="--port"):
        Server(open_server.station.connect, "127.0.0.1", open_server.port)


def test_tls_with_a_certificate_that_is_kept(tmp_path: Path, robot: Robot) -> None:
    path, key, shown = certificate(tmp_path, "127.0.0.1")
    assert certificate(tmp_path, "localhost")[2] == shown
    assert key.stat().st_mode & 0o077 == 0
    trusting = ssl.create_default_context(cafile=path)
    with served(robot.connect, certificate=(path, key)) as server:
        assert server.address.startswith("https://127.0.0.1:")
        here = f"127.0.0.1:{server.port}"
        with connect(f"wss://{here}/ws", origin=f"https://{here}", ssl=trusting) as page:
            assert json.loads(page.recv(10))["type"] == "welcome"
        with pytest.raises(InvalidStatus):
            connect(f"wss://{here}/ws", origin=f"http://{here}", ssl=trusting)


@pytest.mark.parametrize(
    ("text", "where"),
    [("robot.local", ("robot.local", 7)), ("10.0.0.5:8", ("10.0.0.5", 8)), ("::1", ("::1", 7)),
     ("[fe80::1]:9", ("fe80::1", 9))],
)  # fmt: skip
def test_the_robots_address(text: str, where: tuple[str, int]) -> None:
    assert address(text, 7) == where


@pytest.mark.parametrize("text", ["", "a:b", "a/b", "a:99999", ":80", "me@robot"])
def test_what_is_no_address_is_said(text: str) -> None:
    with pytest.raises(CohelmError, match="HOST"):
        address(text, 7)
