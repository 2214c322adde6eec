"""Chooses the transport: the robot's middleware where it can be used, else its
`foxglove_bridge`."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.extras import pip_line
from cohelm.ros.port import Transport

AUTO, DDS, FOXGLOVE, ZENOH = "auto", "dds", "foxglove", "zenoh"


class Connection(NamedTuple):
    """A way to the robot, for each process that needs one. Can be pickled."""

    kind: str = DDS
    url: str = ""
    """Of the bridge or router; of a router also empty: from the environment."""
    why: str = ""
    """This one and no other."""

    def open(self, node: str, namespace: str = "/") -> Transport:
        """A new transport. CohelmError where it can not begin, with why it was this one."""
        try:
            if self.kind == FOXGLOVE:
                from cohelm.ros.foxglove import FoxgloveTransport

                return FoxgloveTransport(self.url)
            if self.kind == ZENOH:
                from cohelm.ros.zenoh import ZenohTransport

                return ZenohTransport(node, namespace, self.url)
            from cohelm.ros.dds import DdsTransport

            return DdsTransport(node, namespace)
        except CohelmError as error:
            why = f" ({self.kind} was taken because {self.why})" if self.why else ""
            raise CohelmError(f"{error}{why}") from error


def connection(kind: str = AUTO, url: str = "") -> Connection:
    """The transport that is meant. CohelmError for one that there is not.

    auto: bridge or router where its address is given; zenoh where the robot's middleware is
    rmw_zenoh and eclipse-zenoh is installed; the bridge where what is needed is not; else DDS.
    """
    from cohelm.ros.bridge_connection import URL

    if kind not in (AUTO, DDS, FOXGLOVE, ZENOH):
        raise CohelmError(f"--transport {kind!r}: there are {AUTO}, {DDS}, {FOXGLOVE} and {ZENOH}")
    if kind == DDS and url:
        raise CohelmError(
            "--url is of a foxglove_bridge or a zenoh router: leave it out, or --transport dds"
        )
    if kind == DDS:
        return Connection(DDS, why="it was asked for")
    if kind == ZENOH:
        return Connection(ZENOH, url, "it was asked for")
    if url:
        of = FOXGLOVE if kind == FOXGLOVE or "://" in url or "/" not in url else ZENOH
        return Connection(of, url, "its address was given")
    if kind == FOXGLOVE:
        return Connection(FOXGLOVE, URL, "it was asked for, on this machine as no --url was given")
    middleware = os.environ.get("RMW_IMPLEMENTATION", "")
    if "zenoh" in middleware:
        if find_spec("zenoh") is not None:
            return Connection(ZENOH, why=f"RMW_IMPLEMENTATION is {middleware}")
        return Connection(
            FOXGLOVE, URL, f"RMW_IMPLEMENTATION is {middleware}, which is no DDS, and "
            f"eclipse-zenoh is not installed ({pip_line('zenoh')})",
        )  # fmt: skip
    if find_spec("cyclonedds") is None:
        return Connection(FOXGLOVE, URL, "cyclonedds is not installed")
    return Connection(DDS, why="cyclonedds is installed, and no --url was given")
