"""What both ends of the Foxglove WebSocket protocol agree on: its names, and its binary messages.

It is `foxglove.websocket.v1`, which newer servers call `foxglove.sdk.v1`
(https://github.com/foxglove/ws-protocol, docs/spec.md).
"""

from __future__ import annotations

import struct

from websockets.typing import Subprotocol

PROTOCOLS = [Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1")]
DATA = 1
"""Opcode of a message's data, in both directions."""
FROM_SERVER, TO_SERVER = struct.Struct("<BIQ"), struct.Struct("<BI")
"""Before the message's bytes: opcode, subscription and time [ns]; opcode and channel."""
ERROR = 2
"""Level of a status message."""
