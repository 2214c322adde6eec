"""A bridge between DDS and Foxglove's own server (foxglove-sdk), as `foxglove_bridge` is one.

It is a process of its own. foxglove-sdk 0.30 for Python locks itself up, for good, where one thread
holds the interpreter and waits for a lock of the server's, and another the reverse:

- where a graph is published while the last client that looks at it leaves. So one looks at it until
  the end;
- where a channel is closed while the server logs that somebody has asked for one that it does not
  have yet. So it logs nothing.

Whoever hangs all the same is ended and begins again on the same port, and clients come back to it
as they would to a bridge that was restarted.

All that its clients publish is one participant's. cyclonedds 11 sometimes never hears what a new
participant has where, as that is found, another of its own process just leaves: so none does.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import threading
import traceback
from collections.abc import Callable
from functools import wraps
from multiprocessing import get_context
from typing import Any

import foxglove
from foxglove.websocket import Capability, ConnectionGraph, ServerListener
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from cohelm.ros import dds
from cohelm.ros.dds import DdsTransport
from cohelm.ros.port import End, Qos
from cohelm.ros.types import packed, store, unpacked
from tests.ros.stage import alone

HANGS = 3.0
"""A bridge that has not looked round for so long is ended [s]."""
BEGINS = 15.0
"""So is one that has not begun by then [s]."""
TRIES = 5


class Bridge:
    """A handle on it. Its node is /bridge."""

    def __init__(self, graph: bool = True, domain: int | None = None) -> None:
        """graph: whether it tells who publishes what. domain: by default all tests' own."""
        alone()
        self.errors: list[str] = []
        """Of what its server calls, which keeps them to itself."""
        self._options, self._closed = (graph, domain), threading.Event()
        self._begin(0)
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self._port}"

    def close(self) -> None:
        self._closed.set()
        self._thread.join()
        self._line.send("end")
        self._process.join(5.0)
        self._process.kill()

    def _begin(self, port: int) -> None:
        context = get_context("spawn")
        for _ in range(TRIES):
            self._line, theirs = context.Pipe()
            self._process = context.Process(
                target=serve, args=(theirs, port, *self._options), daemon=True
            )
            self._process.start()
            theirs.close()
            with contextlib.suppress(EOFError):  # it has ended instead
                self._port: int = self._line.recv()
                return
        raise RuntimeError("the bridge does not begin")

    def _watch(self) -> None:
        while not self._closed.is_set():
            with contextlib.suppress(EOFError, ConnectionError):
                if self._line.poll(0.05):
                    self.errors.append(self._line.recv())
                continue
            self._begin(self._port)  # that one has ended


def serve(line: Any, port: int, graph: bool, domain: int | None) -> None:
    """The bridge's process, until it is told to end."""
    faulthandler.dump_traceback_later(BEGINS, exit=True)
    foxglove.set_log_level("CRITICAL")
    made = Served(port, graph, domain, line.send)
    line.send(made.server.port)
    with contextlib.suppress(EOFError):
        line.recv()
    made.close()


def looking_on(port: int) -> ClientConnection:
    """Who looks at a bridge's graph until it is closed."""
    there = connect(
        f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], compression=None,
        proxy=None,
    )  # fmt: skip
    there.send(json.dumps({"op": "subscribeConnectionGraph"}))
    while "connectionGraphUpdate" not in str(there.recv(5.0)):
        pass

    def read() -> None:
        with contextlib.suppress(ConnectionClosed):
            for _ in there:
                pass

    threading.Thread(target=read, daemon=True).start()
    return there


def watched(call: Callable[..., None]) -> Callable[..., None]:
    """A method that the server calls, of which it would tell no error."""

    @wraps(call)
    def watching(served: Served, *arguments: Any) -> None:
        try:
            call(served, *arguments)
        except Exception:
            served.failed(traceback.format_exc())

    return watching


class Served(ServerListener):
    """One process's. It looks at the graph ten times a second."""

    def __init__(
        self, port: int, graph: bool, domain: int | None, failed: Callable[[str], None],
        name: str = "bridge",
    ) -> None:  # fmt: skip
        """failed: is told of errors in what the server calls."""
        alone()
        self.failed = failed
        capabilities = [Capability.ClientPublish]
        capabilities += [Capability.ConnectionGraph] if graph else []
        self._context = foxglove.Context()
        self._dds = DdsTransport(name, domain=domain)
        self._clients = Publishing(name, domain=domain)
        self._channels: dict[tuple[str, str], Any] = {}
        self._subscribed: dict[tuple[str, str], End] = {}
        self._new: set[tuple[str, str]] = set()
        self._last: dict[tuple[str, str], bytes] = {}
        self._lock = threading.RLock()
        self._writers: dict[tuple[int, int], tuple[Any, str]] = {}
        self._over = threading.Event()
        self.server = foxglove.start_server(
            name=name, host="127.0.0.1", port=port, capabilities=capabilities,
            server_listener=self, supported_encodings=["cdr"], context=self._context,
        )  # fmt: skip
        self._onlooker = looking_on(self.server.port) if graph else None
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        if self._onlooker is not None:
            self._onlooker.close()
        self.server.stop()
        self._clients.close()
        self._dds.close()

    def _look(self) -> None:
        before: Any = None
        while not self._over.wait(0.1):
            faulthandler.dump_traceback_later(HANGS, exit=True)
            for key in list(self._new):  # its subscription may not have counted yet when it came
                self._new.discard(key)
                if key in self._last and key in self._channels:
                    self._channels[key].log(self._last[key])
            seen = self._dds.endpoints()
            if seen == before:
                continue
            before = seen
            graph = ConnectionGraph()
            for topic in {e.topic for e in seen}:
                ends = [e for e in seen if e.topic == topic]
                graph.set_published_topic(topic, sorted({e.node for e in ends if e.publishes}))
                graph.set_subscribed_topic(topic, sorted({e.node for e in ends if not e.publishes}))
            for topic, kind in {(e.topic, e.type) for e in seen} - set(self._channels):
                self._offer(topic, kind)
            for key in set(self._channels) - {(e.topic, e.type) for e in seen}:
                with self._lock:  # a client that subscribes just then looks through them
                    gone = self._channels.pop(key)
                    self._last.pop(key, None)
                    end = self._subscribed.pop(key, None)
                gone.close()
                if end is not None:
                    end()
            if self._onlooker is not None:
                self.server.publish_connection_graph(graph)
        faulthandler.cancel_dump_traceback_later()

    def _offer(self, topic: str, kind: str) -> None:
        text, _ = store().generate_msgdef(kind, ros_version=2)
        with self._lock:  # clients subscribe before the new channel is written down
            self._channels[topic, kind] = foxglove.Channel(
                topic, message_encoding="cdr", context=self._context,
                schema=foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode()),
            )  # fmt: skip

    @watched
    def on_subscribe(self, client: Any, channel: Any) -> None:
        with self._lock:
            found = [(k, made) for k, made in self._channels.items() if made.id() == channel.id]
        if not found:
            return  # its publisher has gone meanwhile
        key, made = found[0]
        self._new.add(key)
        if key in self._last:
            made.log(self._last[key])
        if key in self._subscribed:
            return
        offered = [e.qos for e in self._dds.endpoints() if (e.topic, e.type) == key and e.publishes]
        lasting = bool(offered) and all(qos.transient_local for qos in offered)

        def heard(received: Any) -> None:
            data = packed(received.message, key[1])
            if lasting:
                self._last[key] = data
            there = self._channels.get(key)
            if there is not None:
                there.log(data)

        sure = bool(offered) and all(qos.reliable for qos in offered)
        self._subscribed[key] = self._dds.subscribe(*key, Qos(sure, lasting, 500), heard)

    @watched
    def on_client_advertise(self, client: Any, channel: Any) -> None:
        kind = channel.schema_name
        made = self._clients.publish(channel.topic, kind, Qos(True, False, 500))
        self._writers[client.id, channel.id] = made, kind

    @watched
    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        self._clients.unpublish(self._writers.pop((client.id, client_channel_id))[0])

    @watched
    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        writer, kind = self._writers[client.id, client_channel_id]
        writer.send(unpacked(data, kind)[0])


class Publishing(DdsTransport):
    """A node whose publishers can end, as those of a bridge's clients do."""

    def unpublish(self, out: Any) -> None:
        with dds._LOCK:
            self._writers.remove(out._writer)
            self._graph.writers.remove(out._writer.guid.bytes)
            self._publish_graph()
        out._writer.__del__()  # waits a little for who has not heard all
