"""A `RobotLink` over the network: datagrams and bulk of one operator."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from cohelm.link.bulk_messages import Fetch, Waypoints
from cohelm.link.keys import Keys
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import FRESH, LinkState, StationEnd
from cohelm.station.robot_link import News


class Linked:
    """`RobotLink` over the network. The robot's clock is known after its first message."""

    def __init__(
        self, keys: Keys, host: str, port: int, over: Callable[[], str] = lambda: "",
        fresh: float = FRESH,
    ) -> None:  # fmt: skip
        """over: returns why the robot has ended, where that is known; else empty.
        fresh: as in `StationEnd`."""
        self._over = over
        self._end = StationEnd(keys, host, port, fresh=fresh)
        self.steer, self.ask, self.answer = self._end.steer, self._end.ask, self._end.answer
        self._bulk = StationBulk(keys, host, port, self._end.session)
        self._proposals = 0
        self._status: object = None
        self._scans: dict[int, object] = {}
        self._discs: object = None

    def news(self) -> list[News]:
        """New messages since the last call."""
        out: list[News] = []
        received, scans, discs = self._end.status(), self._end.scans(), self._end.discs()
        now = math.nan if received is None else received.stamp + received.age
        if received is not None and received.status is not self._status:
            self._status = received.status
            out.append(News(received.status, received.stamp, received.age))
        for scan in scans:
            if scan is not self._scans.get(scan.lidar):
                self._scans[scan.lidar] = scan
                out.append(News(scan, scan.taken, now - scan.taken))
        if discs is not None and discs is not self._discs:
            self._discs = discs
            out.append(News(discs, now, 0.0))
        picture = self._bulk.picture()
        if picture is not None:
            out.append(News(picture, picture.taken, now - picture.taken))
        return out + [News(message, now, 0.0) for message in self._bulk.news()]

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Waypoints."""
        self._proposals += 1
        way = np.array(points, dtype=np.float64).reshape(-1, 2)
        self._bulk.send(Waypoints(self._proposals, way, only_check))
        return self._proposals

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """Part of a record, its hash, or the list of them."""
        self._bulk.send(Fetch(name, offset, size))

    def state(self) -> LinkState:
        """State of the link."""
        state, over = self._end.state(), self._over()
        return state._replace(connected=False, why=over) if over else state

    def close(self) -> None:
        """Close the link."""
        self._end.close()
        self._bulk.close()
