"""The transport for any robot that runs `foxglove_bridge`: a client over WebSocket, whatever
middleware, machine and Python there is.
"""

from __future__ import annotations

import contextlib
import json
import select
import threading
import time
from functools import partial
from typing import Any, NamedTuple

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection

from cohelm.core.errors import CohelmError
from cohelm.ros.bridge_connection import OPENS, URL, listed, opened, understood
from cohelm.ros.foxglove_protocol import DATA, ERROR, FROM_SERVER, TO_SERVER
from cohelm.ros.port import Callback, End, Endpoint, Publisher, Qos, Received, ensure_open
from cohelm.ros.types import known, packed, unpacked

_NODE = "foxglove_bridge"
"""Of the bridge, unless it is started under another name."""
_AGAIN = 0.5
"""After so long a lost connection is tried again [s]."""
_REFUSED = 0.1
"""After so long what may have been refused is requested again [s]: a bridge advertises a new
channel a moment before it takes subscriptions of it."""
_ANYTHING = Qos(reliable=True, transient_local=True, depth=0)
"""The bridge forwards what it receives, with whatever quality the publisher offers."""


class _Channel(NamedTuple):
    topic: str
    kind: str
    encoding: str


class _Subscriber(NamedTuple):
    topic: str
    kind: str
    callback: Callback


class FoxgloveTransport:
    """A client of a bridge. See `port.Transport`. A lost bridge is looked for until it is back."""

    unseen = (
        "the bridge sees none either: is the ROS_DOMAIN_ID it was started with the robot's, and "
        "does its parameter topic_whitelist let topics through?"
    )

    def __init__(self, url: str = URL) -> None:
        """Raises CohelmError where no bridge answers, or it lacks what is needed."""
        self.name, self._url = f"foxglove_bridge, {url}", url
        self._lock = threading.RLock()
        self.closed = threading.Event()
        self._channels: dict[int, _Channel] = {}
        self._subscribers: list[_Subscriber] = []
        self._subscribed: dict[int, int] = {}
        self._spoke: set[int] = set()
        """Channels on which something has come."""
        self._retry: threading.Timer | None = None
        self._writers: list[_Writer] = []
        self._graph: dict[bool, dict[str, list[str]]] = {True: {}, False: {}}
        self._number = 0
        self._socket: ClientConnection | None
        self._socket, self._bridge = opened(url)
        self._thread = threading.Thread(target=self._listen, name="foxglove", daemon=True)
        self._thread.start()

    def publish(self, topic: str, kind: str, qos: Qos) -> Publisher:
        """A publisher; the bridge decides its quality of service. What is transient local is sent
        again when a new node subscribes: the bridge reports no more than that."""
        with self._lock:
            ensure_open(self.closed)
            writer = _Writer(self, len(self._writers) + 1, topic, known(kind), qos)
            self._writers.append(writer)
            self._advertise([writer])
        return writer

    def subscribe(self, topic: str, kind: str, qos: Qos, callback: Callback) -> End:
        """A subscriber, and what ends it; the bridge decides its quality of service, by the
        publishers'."""
        with self._lock:
            ensure_open(self.closed)
            subscriber = _Subscriber(topic, known(kind), callback)
            self._subscribers.append(subscriber)
            self._match(list(self._channels), [subscriber])
        return partial(self._leave, subscriber)

    def endpoints(self) -> list[Endpoint]:
        """As the bridge reports them: with their nodes, without their quality of service. The
        bridge's own are left out: it has them on behalf of its clients, this one among them."""
        found: set[Endpoint] = set()
        with self._lock:
            ensure_open(self.closed)
            for channel in self._channels.values():
                for publishes, topics in self._graph.items():
                    qos = _ANYTHING if publishes else Qos(False, False, 0)
                    found |= {
                        Endpoint(channel.topic, channel.kind, qos, publishes, node)
                        for node in topics.get(channel.topic, ())
                        if node.rpartition("/")[2] not in (_NODE, self._bridge)
                    }
        return sorted(found)

    def lost(self) -> str:
        """That the bridge is gone, in a sentence; empty: it is there."""
        if self._socket is not None:
            return ""
        return f"foxglove_bridge at {self._url} is gone: is it still running, and the network up?"

    def close(self) -> None:
        """Leave."""
        self.closed.set()
        with self._lock:
            there, self._socket = self._socket, None
        if there is not None:
            there.close()
        if threading.current_thread() is not self._thread:
            self._thread.join(OPENS)

    def send(self, data: bytes | str, must: bool) -> None:
        """To the bridge, now or never. must: also where that has to wait."""
        there = self._socket
        if there is None:
            return
        with contextlib.suppress(WebSocketException, OSError, ValueError), self._lock:
            if must or select.select([], [there.socket], [], 0.0)[1]:
                there.send(data)

    def _listen(self) -> None:
        """All that the bridge sends, until the end; and the way back to a bridge that was lost."""
        while not self.closed.is_set():
            there = self._socket
            try:
                if there is None:
                    there, self._bridge = opened(self._url)
                    self._back(there)
                self._take(there.recv(), time.monotonic())
            except (WebSocketException, OSError, CohelmError):
                with self._lock:
                    self._socket = None
                    self._channels.clear()
                    self._subscribed.clear()
                    self._spoke.clear()
                    self._graph = {True: {}, False: {}}
                self.closed.wait(_AGAIN)

    def _back(self, there: ClientConnection) -> None:
        with self._lock:
            if self.closed.is_set():
                there.close()
                return
            self._socket = there
            self._advertise(self._writers)

    def _take(self, data: str | bytes, stamp: float) -> None:
        if isinstance(data, bytes):
            if len(data) >= FROM_SERVER.size and data[0] == DATA:
                subscription = FROM_SERVER.unpack_from(data)[1]
                with self._lock:
                    number = self._subscribed.get(subscription, -1)
                    channel = self._channels.get(number)
                    self._spoke.add(number)
                    to = [] if channel is None else [
                        one for one in self._subscribers if (one.topic, one.kind) == channel[:2]
                    ]  # fmt: skip
                if to:
                    message, damage = unpacked(data[FROM_SERVER.size :], to[0].kind)
                    for one in to:
                        one.callback(Received(message, stamp, damage))
            return
        operation = understood(data)
        with contextlib.suppress(KeyError, TypeError, ValueError), self._lock:
            match operation.get("op"):
                case "advertise":
                    new: list[int] = []
                    for one in operation["channels"]:
                        kind = str(one["schemaName"])
                        self._channels[int(one["id"])] = _Channel(
                            str(one["topic"]), kind, str(one["encoding"])
                        )
                        new.append(int(one["id"]))
                    self._match(new, self._subscribers)
                case "unadvertise":
                    for one in operation["channelIds"]:
                        self._channels.pop(int(one), None)
                        self._spoke.discard(int(one))
                case "status" if operation["level"] >= ERROR and self._retry is None:
                    self._retry = threading.Timer(_REFUSED, self._retry_subscriptions)
                    self._retry.daemon = True
                    self._retry.start()
                case "connectionGraphUpdate":
                    self._update(operation)
                case _:
                    pass

    def _update(self, operation: dict[str, Any]) -> None:
        """What has changed in the graph."""
        for publishes, key, ids in (
            (True, "publishedTopics", "publisherIds"), (False, "subscribedTopics", "subscriberIds"),
        ):  # fmt: skip
            there = self._graph[publishes]
            for one in listed(operation.get(key)):
                topic, nodes = str(one["name"]), [str(node) for node in one[ids]]
                fresh = set(nodes) - set(there.get(topic, ()))
                there[topic] = nodes
                if fresh and not publishes:
                    for writer in self._writers:
                        if writer.topic == topic:
                            writer.again()
            for topic in listed(operation.get("removedTopics")):
                there.pop(str(topic), None)

    def _match(self, channels: list[int], subscribers: list[_Subscriber]) -> None:
        for number in channels:
            channel = self._channels[number]
            if not any((one.topic, one.kind, "cdr") == channel for one in subscribers):
                continue
            before = [own for own, at in self._subscribed.items() if at == number]
            for own in before:  # a bridge grants one per channel; a new one brings latched ones
                del self._subscribed[own]
                self._send({"op": "unsubscribe", "subscriptionIds": [own]})
            self._subscribe(number)

    def _subscribe(self, number: int) -> None:
        self._number += 1
        self._subscribed[self._number] = number
        wanted = {"id": self._number, "channelId": number}
        self._send({"op": "subscribe", "subscriptions": [wanted]})

    def _leave(self, subscriber: _Subscriber) -> None:
        """One subscriber; unsubscribes from the channel where it was the last."""
        with self._lock:
            if subscriber not in self._subscribers:
                return
            self._subscribers.remove(subscriber)
            wanted = {one[:2] for one in self._subscribers}
            for own, number in list(self._subscribed.items()):
                channel = self._channels.get(number)
                if channel is None or channel[:2] not in wanted:
                    del self._subscribed[own]
                    self._spoke.discard(number)
                    self._send({"op": "unsubscribe", "subscriptionIds": [own]})

    def _retry_subscriptions(self) -> None:
        """The bridge has refused something: of which channels nothing has come, once more."""
        with self._lock:
            self._retry = None
            for number in sorted(set(self._subscribed.values()) - self._spoke):
                if number in self._channels:
                    self._subscribe(number)  # where it counted, this one is ignored

    def _advertise(self, writers: list[_Writer]) -> None:
        made = [
            {"id": one.number, "topic": one.topic, "encoding": "cdr", "schemaName": one.kind}
            for one in writers
        ]
        if made:
            self._send({"op": "advertise", "channels": made})

    def _send(self, message: dict[str, Any]) -> None:
        self.send(json.dumps(message), True)


class _Writer:
    """See `port.Publisher`."""

    def __init__(
        self, transport: FoxgloveTransport, number: int, topic: str, kind: str, qos: Qos
    ) -> None:
        self.number, self.topic, self.kind = number, topic, kind
        self._lasting = qos.transient_local
        self._waits = qos.transient_local or qos.depth > 1
        self._transport, self._last = transport, b""

    def send(self, message: Any) -> None:
        """Raises CohelmError for what is no message of the type, or when the transport is closed;
        to a bridge that is gone nothing is sent, and where only the newest counts neither to one
        that takes nothing more just now."""
        ensure_open(self._transport.closed)
        data = TO_SERVER.pack(DATA, self.number) + packed(message, self.kind)
        if self._lasting:
            self._last = data
        self._transport.send(data, self._waits)

    def again(self) -> None:
        """To late subscribers."""
        if self._last:
            self._transport.send(self._last, True)
