"""Every transport of ROS 2 messages, for the conformance suite; a new one adds itself here."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest

from cohelm.ros.dds import DdsTransport
from cohelm.ros.port import Transport
from tests.ros.stage import alone


class Kind(NamedTuple):
    make: Callable[[str, str], Transport]
    """A new participant, by node and namespace; two of them meet."""


def dds(node: str, namespace: str) -> Transport:
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    alone()
    return DdsTransport(node, namespace)


TRANSPORTS = {"dds": Kind(dds)}
