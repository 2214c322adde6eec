"""The transport for robots whose middleware is rmw_zenoh: eclipse-zenoh with its key expressions.

`ROS_DOMAIN_ID`, `ZENOH_SESSION_CONFIG_URI`, `ZENOH_CONFIG_OVERRIDE` and, where it is negative,
`ZENOH_ROUTER_CHECK_ATTEMPTS` count as for rmw_zenoh itself.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import threading
import time
from collections import deque
from functools import cache, partial
from importlib import import_module
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.extras import missing
from cohelm.ros import tokens
from cohelm.ros.dds import domain_id
from cohelm.ros.names import namespace_of
from cohelm.ros.port import Callback, End, Endpoint, Publisher, Qos, Received, ensure_open
from cohelm.ros.types import known, packed, unpacked

URL = "tcp/localhost:7447"
"""Of the router on this machine, as `rmw_zenohd` is started by default."""
_ADDRESS = re.compile(r"[a-z_-]+/[^/]+\Z")
_LOCAL = ("localhost", "127.", "[::1]")
_OPEN = 3.0
"""So long it may take to find the router [s]."""
_HEARTBEAT = 0.5
"""Heartbeat period of publishers that are transient local [s], as rmw_zenoh's."""
_ANYTHING, _NOTHING = Qos(True, True, 0), Qos(False, False, 0)
"""What every publisher offers and every subscriber wants: zenoh refuses nobody."""


class ZenohTransport:
    """A node on the network. See `port.Transport`. A lost router is looked for until it is back."""

    unseen = (
        "is ROS_DOMAIN_ID the robot's, is RMW_IMPLEMENTATION=rmw_zenoh_cpp there too, and is this "
        "router the one that its nodes use, or connected to it?"
    )

    def __init__(self, node: str = "cohelm", namespace: str = "/", url: str = "") -> None:
        """url: of the router; empty: from the environment, else `URL`. Raises CohelmError where
        zenoh is not installed, or no router answers."""
        self.domain, self._zenoh = domain_id(), _zenoh()
        config, self._url = self._config(url)
        self.name = f"zenoh, {self._url}, domain {self.domain}"
        self._lock = threading.RLock()
        self._closed, self._arrived = threading.Event(), threading.Event()
        self._subscribers: list[_Subscriber] = []
        self._publishers: list[Any] = []
        self._ends: dict[str, Endpoint] = {}
        self._count = 0
        try:
            self._session = self._zenoh.open(config)
        except self._zenoh.ZError as error:
            raise self._unreached() from error
        try:
            self._reach()
            self._owner = tokens.Owner(
                self.domain, str(self._session.zid()), node, namespace_of(namespace)
            )
            direct = partial(self._zenoh.handlers.Callback, indirect=False)
            self._direct = direct
            live = self._session.liveliness()
            self._graph = live.declare_subscriber(
                tokens.everything(self.domain), direct(self._seen), history=True
            )
            self._tokens = [live.declare_token(self._owner.token())]
        except BaseException:
            self._session.close()
            raise
        self._thread = threading.Thread(target=self._listen, name="zenoh", daemon=True)
        self._thread.start()

    def publish(self, topic: str, kind: str, qos: Qos) -> Publisher:
        """A publisher, which others see by its token. What is transient local is cached for late
        subscribers, as rmw_zenoh does."""
        zenoh, ext, how = self._zenoh, self._zenoh.ext, self._zenoh.Reliability
        with self._lock:
            ensure_open(self._closed)
            self._count += 1
            token = self._owner.of(self._count, True, topic, known(kind), qos)
            lasting: dict[str, Any] = {}
            if qos.transient_local:
                lasting = {
                    "cache": ext.CacheConfig(max_samples=qos.depth), "publisher_detection": True,
                    "sample_miss_detection": ext.MissDetectionConfig(
                        heartbeat=None, sporadic_heartbeat=_HEARTBEAT
                    ) if qos.reliable else None,
                }  # fmt: skip
            made = ext.declare_advanced_publisher(
                self._session, tokens.data_key(self.domain, topic, kind),
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=how.RELIABLE if qos.reliable else how.BEST_EFFORT, **lasting,
            )  # fmt: skip
            self._publishers.append(made)
            self._tokens.append(self._session.liveliness().declare_token(token))
        return _Writer(made, kind, tokens.identity(token), self._closed)

    def subscribe(self, topic: str, kind: str, qos: Qos, callback: Callback) -> End:
        """A subscriber, and what ends it. One that is transient local queries the publishers'
        caches; others are received as well."""
        ext = self._zenoh.ext
        with self._lock:
            ensure_open(self._closed)
            self._count += 1
            token = self._owner.of(self._count, False, topic, known(kind), qos)
            subscriber = _Subscriber(kind, qos.depth, callback, self._arrived)
            lasting: dict[str, Any] = {}
            if qos.transient_local:
                lasting = {
                    "history": ext.HistoryConfig(
                        detect_late_publishers=True, max_samples=qos.depth
                    ),
                    "recovery": ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
                    if qos.reliable else None,
                    "subscriber_detection": True,
                }  # fmt: skip
            self._subscribers.append(subscriber)
            subscriber.declared = ext.declare_advanced_subscriber(
                self._session, tokens.data_key(self.domain, topic, kind),
                self._direct(subscriber.came), **lasting,
            )  # fmt: skip
            subscriber.token = self._session.liveliness().declare_token(token)
        return partial(self._leave, subscriber)

    def endpoints(self) -> list[Endpoint]:
        """Of other sessions."""
        with self._lock:
            ensure_open(self._closed)
            return sorted(
                one._replace(qos=_ANYTHING if one.publishes else _NOTHING)
                for one in self._ends.values()
            )

    def lost(self) -> str:
        """That neither router nor peers are connected, in a sentence; empty: one is."""
        info = self._session.info
        if self._closed.is_set() or info.routers_zid() or info.peers_zid():
            return ""
        return (
            f"the zenoh router at {self._url} is gone: is rmw_zenohd still running, and the "
            "network up?"
        )

    def close(self) -> None:
        """Leave the network."""
        with self._lock:
            if self._closed.is_set():
                return
            self._closed.set()
        self._arrived.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(2.0)
        self._session.close()

    def _leave(self, subscriber: _Subscriber) -> None:
        """One subscriber."""
        with self._lock:
            if self._closed.is_set() or subscriber not in self._subscribers:
                return
            self._subscribers.remove(subscriber)
        subscriber.ended = True
        subscriber.token.undeclare()
        subscriber.declared.undeclare()

    def _listen(self) -> None:
        """Everything that came is handed on here, in the order in which it came per topic."""
        while not self._closed.is_set():
            self._arrived.wait()
            self._arrived.clear()
            with self._lock:
                there = list(self._subscribers)
            for subscriber in there:
                subscriber.deliver()

    def _seen(self, sample: Any) -> None:
        """A token that was held up or taken down."""
        token = str(sample.key_expr)
        found = tokens.read(token)
        if found is None or found[0] == str(self._session.zid()):
            return
        with self._lock:
            if sample.kind == self._zenoh.SampleKind.PUT:
                self._ends[token] = found[1]
            else:
                self._ends.pop(token, None)

    def _config(self, url: str) -> tuple[Any, str]:
        """A session's configuration: rmw_zenoh's default, the environment's before that, and `url`
        before all."""
        zenoh, file = self._zenoh, os.environ.get("ZENOH_SESSION_CONFIG_URI", "")
        try:
            config = zenoh.Config.from_file(file) if file else _default(zenoh)
            for key, _, value in (
                one.strip().partition("=")
                for one in os.environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")
                if one.strip()
            ):
                config.insert_json5(key, value)
        except zenoh.ZError as error:
            raise CohelmError(
                f"zenoh can not be configured by ZENOH_SESSION_CONFIG_URI={file!r} and "
                f"ZENOH_CONFIG_OVERRIDE: {_plain(error)}; fix them, or unset them"
            ) from error
        if not url:
            there = config.get_json("connect/endpoints")
            return config, ", ".join(_addresses(there)) or "no router"
        try:
            if not _ADDRESS.match(url):
                raise zenoh.ZError("no address")
            config.insert_json5("connect/endpoints", json.dumps([url]))
        except zenoh.ZError as error:
            raise CohelmError(f"--url {url!r}: give the router's address, such as {URL}") from error
        if not url.partition("/")[2].startswith(_LOCAL):
            # Nodes at the router listen to their own machine only: all goes through it.
            config.insert_json5("mode", '"client"')
        return config, url

    def _reach(self) -> None:
        """Wait for the router."""
        if os.environ.get("ZENOH_ROUTER_CHECK_ATTEMPTS", "").startswith("-"):
            return
        end = time.monotonic() + _OPEN
        while not self._session.info.routers_zid():
            if time.monotonic() > end:
                raise self._unreached()
            time.sleep(0.02)

    def _unreached(self) -> CohelmError:
        sealed = self._url.startswith(("tls/", "quic/"))
        certified = (
            "; or its certificate is not accepted: name who signed it, or the certificate "
            "itself, as transport/link/tls/root_ca_certificate in ZENOH_CONFIG_OVERRIDE"
        )
        return CohelmError(
            f"no zenoh router answers at {self._url}: start it on the robot (ros2 run "
            "rmw_zenoh_cpp rmw_zenohd), or name its address with --url tcp/ROBOT:7447"
            + (certified if sealed else "")
        )


class _Subscriber:
    """Of one topic: what came, until it is handed on; of more than counts the newest."""

    def __init__(self, kind: str, depth: int, callback: Callback, arrived: threading.Event) -> None:
        self._kind, self._callback, self._arrived = kind, callback, arrived
        self._waiting: deque[tuple[float, Any, Any]] = deque(maxlen=max(depth, 1))
        self.declared: Any = None
        self.token: Any = None
        self.ended = False

    def came(self, sample: Any) -> None:
        """From zenoh's own thread."""
        self._waiting.append((time.monotonic(), sample.payload, sample.attachment))
        self._arrived.set()

    def deliver(self) -> None:
        """All of it, from the transport's thread."""
        with contextlib.suppress(IndexError):  # there is no more
            while not self.ended:
                stamp, payload, attachment = self._waiting.popleft()
                message, damage = unpacked(payload.to_bytes(), self._kind)
                sender = "" if attachment is None else tokens.sender(attachment.to_bytes())
                self._callback(Received(message, stamp, damage, sender))


class _Writer:
    """See `port.Publisher`."""

    def __init__(self, made: Any, kind: str, identity: bytes, closed: threading.Event) -> None:
        self._made, self._kind, self._identity, self._closed = made, kind, identity, closed
        self._lock, self._number = threading.Lock(), 0

    def send(self, message: Any) -> None:
        """Raises CohelmError for what is no message of the type, or when the transport is closed;
        what the network does with it is not known."""
        ensure_open(self._closed)
        data = packed(message, self._kind)
        with self._lock:
            self._number += 1
            with_it = tokens.attachment(self._number, time.time_ns(), self._identity)
            try:
                self._made.put(data, attachment=with_it)
            except _zenoh().ZError as error:
                raise CohelmError(f"a {self._kind} can not be sent: {error}") from error


def _plain(error: Exception) -> str:
    """What zenoh says, without the place in its sources."""
    return re.split(r"\s+at /", str(error))[0].rstrip(".")


def _default(zenoh: Any) -> Any:
    """rmw_zenoh's default for sessions, where it differs from zenoh's own: peers discover each
    other by the router, and on one machine communicate directly."""
    strategy = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
    return zenoh.Config.from_json5(json.dumps({
        "mode": "peer",
        "connect": {
            "endpoints": [URL],
            "timeout_ms": {"router": -1, "peer": -1, "client": 0},
            "exit_on_failure": {"router": False, "peer": False, "client": True},
        },
        "listen": {"endpoints": ["tcp/localhost:0"]},
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {
                "enabled": True, "target": {"router": ["router", "peer"], "peer": ["router"]},
                "autoconnect": {"router": [], "peer": ["router", "peer"]},
                "autoconnect_strategy": strategy,
            },
        },
        "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
        # Its threads are real-time ones, and stay until the process ends.
        "transport": {"shared_memory": {"enabled": False}},
    }))  # fmt: skip


def _addresses(there: Any) -> list[str]:
    """Of a configuration's list of endpoints, which may be one list for each mode."""
    made = json.loads(there) if isinstance(there, str) else there
    lists: list[Any] = list(made.values()) if isinstance(made, dict) else [made]  # pyright: ignore
    return [str(one) for some in lists for one in some]


@cache
def _zenoh() -> Any:
    """With its extensions. CohelmError where it is not installed."""
    try:
        import_module("zenoh.ext")
        import_module("zenoh.handlers")
        return import_module("zenoh")
    except ImportError as error:
        raise missing("ROS 2 over zenoh", "zenoh") from error
