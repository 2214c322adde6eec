"""A topic (std_msgs/msg/Empty) on which somebody asks for a reset, once."""

from __future__ import annotations

import math
from collections.abc import Callable

from cohelm.ros.port import End, Qos, Received, Transport

EMPTY = "std_msgs/msg/Empty"
ONCE = Qos(reliable=True, depth=1)
APART = 2.0
"""What comes so soon after another one is said by nobody who has looked [s]."""


def resets(
    transport: Transport, topic: str, ask: Callable[[float], None], say: Callable[[str], None]
) -> End:
    """Hear it; what is returned ends that. ask: hears when it came, by this machine's monotonic
    clock [s]. say: hears why one does not count."""
    last, told = -math.inf, -math.inf

    def heard(received: Received) -> None:
        nonlocal last, told
        stamp, before = received.stamp, last
        last = stamp
        if stamp - before > APART:
            if received.message is not None:  # nor bytes that are none
                ask(stamp)
        elif stamp - told > 10.0 * APART:
            told = stamp
            say(f"{topic} comes again and again: publish it once (ros2 topic pub --once)")

    return transport.subscribe(topic, EMPTY, ONCE, heard)
