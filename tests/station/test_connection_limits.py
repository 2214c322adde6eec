"""Connection limits of the web server: a page is served among hundreds of idle connections."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect
from websockets.sync.client import ClientConnection

from cohelm.core.errors import CohelmError
from cohelm.station import listening_socket, serve
from cohelm.station.app import pages
from cohelm.station.listening_socket import ListeningSocket
from cohelm.station.serve import Server
from cohelm.station.tls import certificate
from tests.few import first
from tests.link.ends import until
from tests.patience import OwnTime
from tests.station.bare import Bare
from tests.station.conftest import WAIT
from tests.station.person import page_of, who
from tests.station.servers import served
from tests.station.visitor import asked, opened

pytestmark = pytest.mark.xdist_group("realtime")
HEAD = b"GET / HTTP/1.1\r\nHost: localhost\r\n"
HOW = {
    "says nothing": b"",
    "never ends its head": HEAD + b"X: ",
    "never ends its body": HEAD + b"Content-Length: 100000\r\n\r\n",
    "says one thing and sits there": HEAD + b"\r\n",
    "asks a thousand times": (HEAD + b"\r\n") * 1000,
    "reads nothing": b"",
    "never ends its token": HEAD.replace(b"GET /", b"POST /session")
    + b"Content-Length: 99\r\n\r\n",
}


with suppress(CohelmError):  # not built: the tests are skipped
    for script in (pages() / "assets").glob("*.js"):
        HOW["reads nothing"] = HEAD.replace(b"/ ", f"/assets/{script.name} ".encode(), 1) + b"\r\n"


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


@contextmanager
def crowd(port: int, count: int, says: bytes, lasts: float = 60.0) -> Iterator[list[int]]:
    """So many connections, that say this and then a letter now and then; who is let go comes
    again at once. Yields how many came again."""
    over, again = threading.Event(), [0]
    made: list[socket.socket] = []

    def one() -> socket.socket:
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sock.settimeout(5.0)
        with suppress(OSError):
            sock.connect(("127.0.0.1", port))
            sock.sendall(says)
        sock.setblocking(False)
        return sock

    def sit() -> None:
        end = time.monotonic() + lasts
        while not over.is_set() and time.monotonic() < end:
            for i, sock in enumerate(made):
                try:
                    sock.send(b"a")
                except BlockingIOError:
                    pass
                except OSError:
                    sock.close()
                    made[i] = one()
                    again[0] += 1
            over.wait(0.5)

    made += [one() for _ in range(count)]
    thread = threading.Thread(target=sit)
    thread.start()
    try:
        yield again
    finally:
        over.set()
        thread.join()
        for sock in made:
            sock.close()


def beats(page: ClientConnection, own: OwnTime, seconds: float) -> None:
    """It hears something for so long, each time within two seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        began = own.now()
        page.recv(WAIT / 1e3)
        assert own.now() - began < 2.0


@pytest.mark.parametrize("how", first(HOW))
def test_a_page_loads_and_works_among_two_hundred_idle_connections(
    server: Server, browser: Browser, how: str
) -> None:
    with OwnTime() as own, opened(server) as driver, crowd(server.port, 200, HOW[how]):
        for _ in range(5):
            began = own.now()
            assert asked(server, "GET", "/").status == 200
            assert own.now() - began < 3.0
        context = browser.new_context()
        page = page_of(context, server)
        expect(who(page)).to_contain_text("No driver")
        driver.send('{"type":"got","stream":"state"}')
        beats(driver, own, 1.0)  # who was there all along has them
        context.close()
    assert asked(server, "GET", "/").status == 200


def test_of_six_hundred_connections_some_are_closed_and_the_page_is_served(server: Server) -> None:
    with crowd(server.port, 600, HOW["never ends its head"]):
        assert (
            server._listener.count() <= listening_socket.MOST_WAITING + listening_socket.MOST_SERVED
        )
        for _ in range(5):
            assert asked(server, "GET", "/").status == 200


@pytest.mark.parametrize("how", HOW)
def test_incomplete_requests_are_closed_however_slowly_bytes_arrive(
    server: Server, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(serve, "HEAD_WITHIN", 0.2)
    monkeypatch.setattr(serve, "DONE_WITHIN", 0.4)
    with OwnTime() as own, socket.create_connection(("127.0.0.1", server.port)) as one:
        one.sendall(HOW[how])
        began = own.now()
        with suppress(OSError):
            while own.now() - began < 10.0:
                one.send(b"a")
                time.sleep(0.1)
        assert own.now() - began < 5.0
    until(lambda: server._listener.count() == 0)


def test_tls_handshakes_that_never_end_block_no_other_client(tmp_path: Path, bare: Bare) -> None:
    path, key, _ = certificate(tmp_path, "127.0.0.1")
    trusting = ssl.create_default_context(cafile=path)
    with (
        served(bare.connect, certificate=(path, key)) as server,
        crowd(server.port, 300, b"\x16\x03\x01"),
    ):
        assert server._listener.count() <= listening_socket.MOST_WAITING + 1
        for _ in range(3):
            with (
                socket.create_connection(("127.0.0.1", server.port), 5.0) as plain,
                trusting.wrap_socket(plain, server_hostname="127.0.0.1") as safe,
            ):
                safe.sendall(HEAD.replace(b"localhost", b"127.0.0.1") + b"\r\n")
                assert safe.recv(100).startswith(b"HTTP/1.1 200")


def test_connections_of_one_network_address_are_limited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of an address that has too many, its own oldest goes; another's stays."""
    monkeypatch.setattr(listening_socket, "MOST_OF_ONE_ADDRESS", 3)
    door = ListeningSocket(socket.AF_INET)
    pairs = [socket.socketpair() for _ in range(6)]
    given = iter(
        [(pair[0], (f"10.0.0.{1 if i == 1 else 2}", i)) for i, pair in enumerate(pairs, 1)]
    )
    monkeypatch.setattr(socket.socket, "accept", lambda _: next(given))
    gone: list[int] = []
    for i in range(1, 7):
        _, address = door.accept()
        door.made(address, lambda i=i: gone.append(i))
        if i == 3:
            door.admitted(address)
    assert gone == [2]  # the other address has 1, and 3 is known
    door.close()
    for pair in pairs:
        for sock in pair:
            sock.close()


def test_identified_clients_are_never_dropped_for_unidentified_ones(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listening_socket, "MOST_WAITING", 5)
    monkeypatch.setattr(listening_socket, "MOST_SERVED", 5)
    idle = HOW["says one thing and sits there"]
    with OwnTime() as own, opened(server) as page, crowd(server.port, 50, idle):
        beats(page, own, 1.5)
