"""A bridge behind TLS: read by one thread and written to by others, nothing is lost."""

from __future__ import annotations

import asyncio
import json
import socket
import ssl
import struct
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import pytest
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from cohelm.core.errors import CohelmError
from cohelm.ros.bridge_connection import opened
from cohelm.ros.foxglove import FoxgloveTransport
from cohelm.ros.port import Qos
from cohelm.ros.types import packed, unpacked
from cohelm.station.tls import certificate
from tests.ros.stage import until

STRING = "std_msgs/msg/String"
COUNT, WRITERS = 120, 3


class Turns:
    """Whether two threads were in one TLS connection at once."""

    met: ClassVar[list[str]] = []

    @contextmanager
    def one(self, name: str) -> Iterator[None]:
        turn = self.__dict__.setdefault("turn", threading.Lock())
        if not (mine := turn.acquire(blocking=False)):
            self.met.append(name)
        try:
            yield
        finally:
            if mine:
                turn.release()


class Between(Turns, ssl.SSLObject):
    """One between two buffers."""

    def read(self, *given):
        with self.one("read"):
            return super().read(*given)

    def write(self, *given):
        with self.one("write"):
            return super().write(*given)


class OnSocket(Turns, ssl.SSLSocket):
    """One on a socket."""

    def recv(self, *given):
        with self.one("recv"):
            return super().recv(*given)

    def send(self, *given):
        with self.one("send"):
            return super().send(*given)


@contextmanager
def bridge(folder: Path, talk: Callable[[ServerConnection], Awaitable[None]]) -> Iterator[str]:
    """What looks like one, in a thread: it offers /out; `talk` is what it does. Its address."""
    path, key, _ = certificate(folder, "127.0.0.1")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(path, key)
    loop, ended = asyncio.new_event_loop(), asyncio.Event()
    begun: list[int] = []

    async def told(there: ServerConnection) -> None:
        await there.send(json.dumps({
            "op": "serverInfo", "name": "tls", "supportedEncodings": ["cdr"],
            "capabilities": ["clientPublish", "connectionGraph"],
        }))  # fmt: skip
        channel = {"id": 5, "topic": "/out", "encoding": "cdr", "schemaName": STRING}
        await there.send(json.dumps({"op": "advertise", "channels": [channel]}))
        await talk(there)

    async def run() -> None:
        protocols = [Subprotocol("foxglove.sdk.v1")]
        async with serve(told, "127.0.0.1", 0, ssl=context, subprotocols=protocols) as server:
            begun.append(next(iter(server.sockets)).getsockname()[1])
            await ended.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(run()))
    thread.start()
    assert until(lambda: bool(begun))
    try:
        yield f"wss://127.0.0.1:{begun[0]}"
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join()
        loop.close()


def test_traffic_in_both_directions_arrives_whole_and_in_order(tmp_path, monkeypatch):
    came: list[bytes] = []

    async def pour(there: ServerConnection, subscription: int) -> None:
        for k in range(COUNT):
            text = packed(String(f"{k} " + "x" * (k % 7 * 20_000)), STRING)
            await there.send(struct.pack("<BIQ", 1, subscription, 0) + text)

    async def talk(there: ServerConnection) -> None:
        tasks = []
        async for data in there:
            if isinstance(data, bytes):
                came.append(data)
            elif "subscriptions" in (told := json.loads(data)):
                tasks.append(asyncio.create_task(pour(there, told["subscriptions"][0]["id"])))

    monkeypatch.setattr("cohelm.ros.bridge_connection._SILENT", 60.0)  # of a busy machine
    monkeypatch.setattr(ssl.SSLContext, "sslobject_class", Between)
    monkeypatch.setattr(ssl.SSLContext, "sslsocket_class", OnSocket)
    with bridge(tmp_path, talk) as url:
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "station-web.pem"))
        transport = FoxgloveTransport(url)
        every = Qos(True, False, 500)
        outs = [transport.publish(f"/in_{k}", STRING, every) for k in range(WRITERS)]
        heard: list[str] = []
        transport.subscribe("/out", STRING, every, lambda one: heard.append(one.message.data))

        def write(out) -> None:
            for k in range(COUNT):
                out.send(String(f"{k} " + "y" * (k % 9 * 20_000)))

        threads = [threading.Thread(target=write, args=(out,)) for out in outs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert until(lambda: len(heard) == COUNT and len(came) == COUNT * WRITERS), (
            len(heard), len(came),
        )  # fmt: skip
        transport.close()
    assert not Turns.met
    assert heard == [f"{k} " + "x" * (k % 7 * 20_000) for k in range(COUNT)]
    for out in outs:
        mine = [data[5:] for data in came if struct.unpack_from("<BI", data)[1] == out.number]
        said = [unpacked(data, STRING)[0].data for data in mine]
        assert said == [f"{k} " + "y" * (k % 9 * 20_000) for k in range(COUNT)]


def test_a_certificate_without_a_trusted_issuer_is_refused(tmp_path):
    async def talk(there: ServerConnection) -> None:
        await there.wait_closed()

    with (
        bridge(tmp_path, talk) as url,
        pytest.raises(
            CohelmError,
            match=r"certificate of .* not accepted \(certificate verify failed: .*SSL_CERT_FILE",
        ),
    ):
        FoxgloveTransport(url)


def test_a_bridge_without_tls_is_named_as_one():
    """And not as one that does not answer."""
    with socket.create_server(("127.0.0.1", 0)) as there:

        def answers() -> None:
            client, _ = there.accept()
            with client:
                client.recv(1000)
                client.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        threading.Thread(target=answers, daemon=True).start()
        port = there.getsockname()[1]
        with pytest.raises(CohelmError, match=rf"wss://127.0.0.1:{port} does no TLS: write ws://"):
            opened(f"wss://127.0.0.1:{port}")
