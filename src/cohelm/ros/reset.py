"""A topic (std_msgs/msg/Empty) on which a reset is requested, once."""

from __future__ import annotations

import math
from collections.abc import Callable

from cohelm.ros.port import End, Qos, Received, Transport

EMPTY = "std_msgs/msg/Empty"
ONCE = Qos(reliable=True, depth=1)
APART = 2.0
"""A message so soon after another one is not a deliberate request [s]."""


def resets(
    transport: Transport, topic: str, reset: Callable[[float], None], log: Callable[[str], None]
) -> End:
    """Subscribes; what is returned ends that. reset: called with the arrival by this machine's
    monotonic clock [s]. log: receives why a message does not count."""
    last, logged = -math.inf, -math.inf

    def on_message(received: Received) -> None:
        nonlocal last, logged
        stamp, before = received.stamp, last
        last = stamp
        if stamp - before > APART:
            if received.message is not None:  # nor bytes that are none
                reset(stamp)
        elif stamp - logged > 10.0 * APART:
            logged = stamp
            log(f"{topic} is published continuously: publish it once (ros2 topic pub --once)")

    return transport.subscribe(topic, EMPTY, ONCE, on_message)
