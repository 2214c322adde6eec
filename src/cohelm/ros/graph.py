"""Which node has which publishers and subscribers, as ROS 2 nodes publish it.

`ros2 node list` and `ros2 topic info -v` know names from the topic `ros_discovery_info`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cohelm.ros.types import store

GRAPH = "ros_discovery_info"
"""The topic, to DDS."""
INFO = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_ID = 16
"""Bytes of an endpoint's identity (GUID); Humble's messages have room for 24."""


class Graph:
    """What this participant, which is one node, publishes of itself."""

    def __init__(self, participant: bytes, node: str, namespace: str) -> None:
        self._participant, self._node, self._namespace = participant, node, namespace
        self.readers: list[bytes] = []
        self.writers: list[bytes] = []

    def message(self) -> Any:
        """An `INFO`."""
        types = store().types
        node = types["rmw_dds_common/msg/NodeEntitiesInfo"](
            node_namespace=self._namespace,
            node_name=self._node,
            reader_gid_seq=[_gid(one) for one in self.readers],
            writer_gid_seq=[_gid(one) for one in self.writers],
        )
        return types[INFO](gid=_gid(self._participant), node_entities_info_seq=[node])


def described(message: Any) -> tuple[bytes, list[tuple[str, list[bytes]]]]:
    """Of another participant's `INFO`: its identity, and names of its nodes with the identities of
    their endpoints."""
    return _bytes(message.gid), [
        (
            f"{node.node_namespace.rstrip('/')}/{node.node_name}",
            [_bytes(gid) for gid in (*node.reader_gid_seq, *node.writer_gid_seq)],
        )
        for node in message.node_entities_info_seq
    ]


def _gid(identity: bytes) -> Any:
    room = store().fielddefs["rmw_dds_common/msg/Gid"][1][0][1][1][1]
    data = np.zeros(int(room), dtype=np.uint8)  # pyright: ignore[reportArgumentType]
    data[:_ID] = np.frombuffer(identity[:_ID], dtype=np.uint8)
    return store().types["rmw_dds_common/msg/Gid"](data=data)


def _bytes(gid: Any) -> bytes:
    return bytes(np.asarray(gid.data, dtype=np.uint8)[:_ID])
