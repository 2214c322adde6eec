"""A viewer as Foxglove: a real client over a real socket."""

from __future__ import annotations

import json
import struct
import time
from collections import defaultdict

from websockets.sync.client import connect

HEAD = struct.Struct("<BIQ")


class Onlooker:
    """Subscribes to topics, and keeps what comes: for each the stamps [ns] and bytes."""

    def __init__(self, address: str, topics: list[str] | None = None, **options) -> None:
        """topics: by default all; [] for none. Waits until the server is there."""
        end = time.monotonic() + 60.0
        while True:
            try:
                self.connection = connect(
                    address, subprotocols=["foxglove.sdk.v1"], max_size=None, compression=None,
                    proxy=None, open_timeout=60.0, legacy=True, **options,
                )  # fmt: skip
                break
            except TimeoutError:
                assert time.monotonic() < end
        self.info = json.loads(self.connection.recv(60.0))
        self.channels = json.loads(self.connection.recv(60.0))["channels"]
        self.heard: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        self.told: list[dict] = []
        self._topics = {one["id"]: one["topic"] for one in self.channels}
        wanted = [n for n, topic in self._topics.items() if topics is None or topic in topics]
        if wanted:
            self.say(op="subscribe", subscriptions=[{"id": n, "channelId": n} for n in wanted])

    def say(self, **what) -> None:
        self.connection.send(json.dumps(what))

    def listen(self, until, within: float = 60.0) -> None:
        """Until `until()`, or the server has closed the connection: then nothing more comes."""
        end = time.monotonic() + within
        while not until():
            assert time.monotonic() < end
            self.take(0.05)

    def take(self, within: float) -> bool:
        """One message, if one comes."""
        try:
            said = self.connection.recv(within)
        except TimeoutError:
            return False
        if isinstance(said, str):
            self.told.append(json.loads(said))
        else:
            kind, number, stamp = HEAD.unpack_from(said)
            assert kind == 1
            self.heard[self._topics[number]].append((stamp, said[HEAD.size :]))
        return True

    def close(self) -> None:
        self.connection.close()
