"""A robot that is only its end of the link, for tests without driving."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Self

from cohelm.link import keys
from cohelm.link.messages import RequestKind, Status
from cohelm.link.robot_bulk import both_ends
from cohelm.station.robot_link import Linked
from tests.link.ends import STATUS


class Bare:
    """Tells its status 20 times a second; its records are those in `folder`."""

    def __init__(self, folder: Path, status: Status = STATUS) -> None:
        self.status = status
        """What it tells."""
        self.robot_keys, self.keys = keys.pair_here()
        self.end, self.bulk = both_ends(self.robot_keys, "127.0.0.1", 0, folder, stale=5.0)
        self.port = self.end.address[1]
        self.requests: list[RequestKind] = []
        """What was requested of it."""
        self.acknowledged: set[int] = set()
        """The numbers of the alarms among it."""
        self.over = ""
        """Why its process has ended, where the station knows that."""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.die()

    def connect(self, _: str) -> Linked:
        """One more operator's link."""
        return Linked(self.keys, "127.0.0.1", self.port, lambda: self.over)

    def die(self) -> None:
        """Away with it."""
        if not self._over.is_set():
            self._over.set()
            self._thread.join()
            self.bulk.close()
            self.end.close()

    def _tell(self) -> None:
        while not self._over.wait(0.05):
            self.end.send_status(self.status)
            for asked in self.end.receive().requests:
                self.requests.append(asked.request.what)
                if asked.request.what is RequestKind.ACKNOWLEDGE:
                    self.acknowledged.add(asked.request.value)
