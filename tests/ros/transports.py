"""Every transport of ROS 2 messages, for the conformance suite; a new one adds itself here."""

from __future__ import annotations

import atexit
import json
import socket
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import pytest

from cohelm.ros.dds import DdsTransport
from cohelm.ros.foxglove import FoxgloveTransport
from cohelm.ros.port import Transport
from tests.ros.bridge import Bridge
from tests.ros.stage import alone

Make = Callable[[str, str], Transport]
"""Of a new participant, by node and namespace."""


class Kind(NamedTuple):
    """Two that meet: the one publishes, the other hears."""

    one: Make
    two: Make
    graph: bool = True
    """Whether each sees the other's node, and what is transient local lasts for each."""
    insists: bool = True
    """Whether each sees the other's quality of service, and can refuse it."""


def dds(node: str, namespace: str) -> Transport:
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    alone()
    return DdsTransport(node, namespace)


@cache
def bridge() -> Bridge:
    made = Bridge()
    atexit.register(made.close)
    return made


def foxglove(node: str, namespace: str) -> Transport:
    pytest.importorskip("cyclonedds", reason="what the bridge bridges has no wheel here")
    return FoxgloveTransport(bridge().url)


class Router:
    """Zenoh's, such as rmw_zenohd is one: the same program inside, listening on this machine."""

    def __init__(self, port: int = 0) -> None:
        zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
        if not port:
            with socket.create_server(("127.0.0.1", 0)) as free:
                port = free.getsockname()[1]
        self.port, self.url = port, f"tcp/127.0.0.1:{port}"
        config = {
            "mode": "router", "listen": {"endpoints": [self.url]},
            "scouting": {"multicast": {"enabled": False}},
            "transport": {"shared_memory": {"enabled": False}},
        }  # fmt: skip
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))

    def close(self) -> None:
        self._session.close()


@cache
def router() -> Router:
    made = Router()
    atexit.register(made.close)
    return made


def zenoh(node: str, namespace: str) -> Transport:
    alone()
    url = router().url
    from cohelm.ros.zenoh import ZenohTransport

    return ZenohTransport(node, namespace, url)


TRANSPORTS = {
    "dds": Kind(dds, dds),
    "from_foxglove": Kind(foxglove, dds, False, False),
    "to_foxglove": Kind(dds, foxglove, False, False),
    "zenoh": Kind(zenoh, zenoh, True, False),
}
