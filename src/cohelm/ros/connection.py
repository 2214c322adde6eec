"""Which transport to take: DDS where it can be had, else the robot's `foxglove_bridge`."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.ros.port import Transport

AUTO, DDS, FOXGLOVE = "auto", "dds", "foxglove"


class Connection(NamedTuple):
    """A way to the robot, for each process that needs one. Can be pickled."""

    kind: str = DDS
    url: str = ""
    """Of the bridge."""
    why: str = ""
    """This one and no other."""

    def open(self, node: str, namespace: str = "/") -> Transport:
        """A new transport. CohelmError where it can not begin."""
        if self.kind == FOXGLOVE:
            from cohelm.ros.foxglove import FoxgloveTransport

            return FoxgloveTransport(self.url)
        from cohelm.ros.dds import DdsTransport

        return DdsTransport(node, namespace)


def connection(kind: str = AUTO, url: str = "") -> Connection:
    """The transport that is meant. CohelmError for one that there is not.

    auto: the bridge where its address is given, the robot's middleware is not DDS, or cyclonedds is
    not installed; else DDS.
    """
    from cohelm.ros.foxglove import URL

    if kind not in (AUTO, DDS, FOXGLOVE):
        raise CohelmError(f"--transport {kind!r}: there are {AUTO}, {DDS} and {FOXGLOVE}")
    if kind == DDS and url:
        raise CohelmError("--url is of a foxglove_bridge: leave it out, or --transport dds")
    if kind == DDS:
        return Connection(DDS, why="as asked")
    if url:
        return Connection(FOXGLOVE, url, "its address was given")
    if kind == FOXGLOVE:
        return Connection(FOXGLOVE, URL, "as asked, on this machine as no --url was given")
    middleware = os.environ.get("RMW_IMPLEMENTATION", "")
    if "zenoh" in middleware:
        return Connection(FOXGLOVE, URL, f"RMW_IMPLEMENTATION is {middleware}, which is no DDS")
    if find_spec("cyclonedds") is None:
        return Connection(FOXGLOVE, URL, "cyclonedds is not installed")
    return Connection(DDS, why="cyclonedds is installed, and no --url was given")
