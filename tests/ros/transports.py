"""Every transport of ROS 2 messages, for the conformance suite; a new one adds itself here."""

from __future__ import annotations

import atexit
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
    """Whether each sees quality of service and node of the other, and can insist on the former."""


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


TRANSPORTS = {
    "dds": Kind(dds, dds),
    "from_foxglove": Kind(foxglove, dds, False),
    "to_foxglove": Kind(dds, foxglove, False),
}
