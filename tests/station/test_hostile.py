"""Hostile clients of the web port: nothing crashes, nothing moves, the driver continues."""

import asyncio
import json
import logging
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection

from cohelm.link.messages import Mode
from cohelm.station import app
from cohelm.station.messages import Do, from_page
from cohelm.station.operator import PageOperator
from cohelm.station.serve import Server
from tests.few import first
from tests.link.ends import until
from tests.station import visitor
from tests.station.servers import Robot, served

pytestmark = pytest.mark.xdist_group("realtime")
WITHIN = 60.0
STICK: dict[str, Any] = {
    "type": "steer", "n": 1, "echo_ms": 0.0,
    "command": {
        "stick": [0.5, 0.5], "valid": True, "armed": True, "device": "gamepad", "speed_scale": 1.0,
    },
}  # fmt: skip
SAID = [
    STICK,
    {"type": "do", "what": "manual", "value": 0},
    {"type": "do", "what": "reset", "value": 0},
    {"type": "do", "what": "give", "value": 3},
    {"type": "do", "what": "acknowledge", "value": 0},
    {"type": "waypoints", "points": [[1.0, 2.0], [3.0, 4.0]], "only_check": False},
    {"type": "got", "stream": "scan"},
    {"type": "play", "playing": True, "speed": 1.0, "seek_s": 3.0},
]
"""All that a page may say, but to take the robot: that would be no attack."""
ODD = [None, True, -1, 0, 1e308, -1e-320, 2**63, "", "stick", "\x00\ud83d\ude00", [], {}, [[]],
       float("nan"), float("inf"), "a" * 300]  # fmt: skip


@pytest.fixture
def server(robot: Robot) -> Iterator[Server]:
    """Of its own for every test: who was let go is an operator for some seconds still."""
    with served(robot.connect) as made:
        yield made


def opened(server: Server) -> ClientConnection:
    return visitor.opened(server, open_timeout=WITHIN)


def nonsense(rng: random.Random) -> str | bytes:
    """Something like a message, seldom a good one."""
    said = json.loads(json.dumps(rng.choice(SAID)))
    how = rng.randrange(6)
    if how == 0:
        return rng.randbytes(rng.randrange(400))
    if "command" in said and rng.random() < 0.5:
        said["command"][rng.choice(list(said["command"]))] = rng.choice(ODD)
    if how == 1:
        said[rng.choice(list(said))] = rng.choice(ODD)
    elif how == 2:
        said.pop(rng.choice(list(said)))
    elif how == 3:
        said[rng.choice(["x", "what", "points", "__proto__", "n" * 99])] = rng.choice(ODD)
    text = json.dumps(said)
    if how == 4:
        at = rng.randrange(len(text))
        text = text[:at] + chr(rng.randrange(1, 0xD000)) + text[at + rng.randrange(3) :]
    elif how == 5:
        text = rng.choice(
            ["[" * 4000, '{"type":' * 500, text * 40, text[: rng.randrange(len(text))]]
        )
    with suppress(ValueError):
        good = from_page(text)
        return "{}" if isinstance(good, Do) and good.what == "take" else text
    return text


@pytest.mark.parametrize("seconds", [1.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_no_websocket_message_crashes_or_moves_anything(
    robot: Robot, server: Server, seconds: float
) -> None:
    seed = random.randrange(2**32)
    rng, before = random.Random(seed), robot.status()
    assert before is not None
    end, said = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        try:
            with opened(server) as page:
                for _ in range(rng.randrange(1, 30)):
                    page.send(nonsense(rng))
                    said += 1
                if rng.random() < 0.3:
                    page.socket.shutdown(socket.SHUT_RDWR)
        except (ConnectionClosed, InvalidHandshake, OSError):
            time.sleep(0.2)  # let go, or too many operators for the moment
        now = robot.status()
        assert now is not None
        assert now.applied == (0.0, 0.0), f"seed {seed}"
        assert now.lease.driver == 0, f"seed {seed}"
        assert now.pose[:2] == pytest.approx(before.pose[:2], abs=0.1), f"seed {seed}"
    assert said > seconds
    until(lambda: welcomed(server), WITHIN)


def welcomed(server: Server) -> bool:
    with suppress(ConnectionClosed, InvalidHandshake, OSError), opened(server) as page:
        return json.loads(page.recv(WITHIN))["type"] == "welcome"
    return False


@contextmanager
def driven(server: Server, robot: Robot) -> Iterator[None]:
    """A page that turns the robot to the left, over and over."""
    with opened(server) as page:
        beat, end, lock = [0.0], threading.Event(), threading.Lock()

        def tell(**message: object) -> None:
            with lock:
                page.send(json.dumps(message))

        def hear() -> None:
            with suppress(ConnectionClosed):
                for text in page:
                    if isinstance(text, bytes):
                        continue
                    message = json.loads(text)
                    if message["type"] == "beat":
                        beat[0] = message["at_ms"]
                    elif message["type"] == "Status":
                        tell(type="got", stream="state")

        def steer() -> None:
            n = 0
            with suppress(ConnectionClosed):
                while not end.wait(0.02):
                    n += 1
                    status = robot.status()
                    turns = status is not None and status.mode == Mode.MANUAL and armed.is_set()
                    command = STICK["command"] | {"stick": [0.0, 1.0 * turns]}
                    tell(**STICK | {"n": n, "echo_ms": beat[0], "command": command})

        armed = threading.Event()
        threads = [threading.Thread(target=hear), threading.Thread(target=steer)]
        for thread in threads:
            thread.start()

        def asks(what: str, seen: object) -> None:
            def again() -> None:
                tell(type="do", what=what, value=0)
                time.sleep(0.2)

            until(seen, WITHIN, again)  # type: ignore[arg-type]

        try:
            asks("take", lambda: robot.status().lease.driver != 0)
            asks("manual", lambda: robot.status().mode == Mode.MANUAL)
            until(lambda: robot.status().arming == 2, WITHIN)
            armed.set()
            until(lambda: robot.status().applied.omega > 0.2, WITHIN)
            yield
        finally:
            end.set()
            threads[1].join(WITHIN)
            asks("hold", lambda: robot.status().mode == Mode.HOLD)
            asks("give", lambda: robot.status().lease.driver == 0)
            page.close()
            threads[0].join(WITHIN)


@pytest.mark.parametrize("how", first(["handshakes", "slow-loris", "requests"]))
def test_the_driver_continues_while_the_port_is_flooded(
    robot: Robot, server: Server, how: str
) -> None:
    with driven(server, robot):
        left: list[socket.socket] = []
        turned = robot.status().pose.psi
        end = time.monotonic() + 2.0
        while time.monotonic() < end or len(left) < 40:
            with suppress(OSError):
                one = socket.create_connection(("127.0.0.1", server.port), WITHIN)
                if how == "slow-loris":
                    one.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ")
                elif how == "requests":
                    one.sendall(b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n" * 20)
                else:
                    one.sendall(b"GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
                                b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                                b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n")  # fmt: skip
                left.append(one)
            time.sleep(0.01)
        status = robot.status()
        assert status.stopped == ""
        assert status.applied.omega > 0.2
        until(lambda: abs(robot.status().pose.psi - turned) > 0.2, WITHIN)
        for one in left:
            one.close()
    until(lambda: welcomed(server), WITHIN)


def test_pages_that_disconnect_early_leave_no_resources(
    server: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(app, "GRACE", 0.1)
    here = f"127.0.0.1:{server.port}"
    hello = (
        f"GET /ws HTTP/1.1\r\nHost: {here}\r\nOrigin: http://{here}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Protocol: cohelm, {visitor.session(server)}\r\n\r\n"
    ).encode()
    said = b'{"type":"got","stream":"state"}'
    words = 40 * (bytes((0x81, 0x80 | len(said), 0, 0, 0, 0)) + said)
    for number in range(20):
        with socket.create_connection(("127.0.0.1", server.port), WITHIN) as page:
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            page.sendall(hello + words)
            if number % 2:
                page.recv(1)  # the server has said yes
                time.sleep(0.004 * number)
    until(lambda: not server.station.operators, WITHIN)
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.ERROR] == []
    assert welcomed(server)


def test_messages_of_a_disconnected_page_are_ignored(robot: Robot) -> None:
    operator = PageOperator("key", "operator 1", robot.connect(""), 0.25)
    heard, sent, gone = [0], [0], asyncio.Event()

    async def receive() -> dict[str, object]:
        heard[0] += 1
        if heard[0] == 1:
            return {"type": "websocket.connect"}
        await gone.wait()
        return {"type": "websocket.receive", "text": '{"type": "got", "stream": "state"}'}

    async def send(_: object) -> None:
        sent[0] += 1
        if sent[0] > 3:  # accepted, welcomed, a beat; then the way is cut
            gone.set()
            raise OSError

    async def attended() -> None:
        page = WebSocket({"type": "websocket", "headers": []}, receive, send)
        await page.accept()
        await operator.attend(page)

    with ThreadPoolExecutor(1) as own:  # this thread may have a loop already, of a browser's
        try:
            own.submit(asyncio.run, attended()).result(WITHIN)
        finally:
            own.submit(operator.link.close).result(WITHIN)
    assert operator.socket is None
