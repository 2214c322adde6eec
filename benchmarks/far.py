"""The lab driven manually from far away, on the twin: `python -m benchmarks.far [--delay 0.075]`.

`cohelm robot --twin --listen` in a network namespace of its own, and a scripted operator at the
other end of a bad network of real packets (tests/link/net.py), 150 ms round trip by default. The
operator receives the link's delayed messages, predicts by their age, and steers in manual mode
along the reference, around the obstacles in them, 50 times a second; the guard on the robot keeps
clear. Contacts are counted from the truth.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose, Stick
from cohelm.link import keys
from cohelm.link.bulk_messages import LineKind, Polyline
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind, ScanPart
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StationEnd
from cohelm.robot.kinematics import arc
from tests.drive.far import PORT, FarRobot
from tests.link import net

BEAT = 0.02
LOOK_AHEAD = 0.45  # where on the line the person aims [m]
BERTH = 0.5  # half the robot's width, and some more: so far from what stands on the line [m]
ON_THE_LINE = 0.33  # what is nearer to it stands on it [m]
BESIDE = 1.2  # so long before and after it the line is left [m]
AHEAD, BEHIND = 40, 10  # rows of the line, of 0.1 m, that he looks ahead, and remembers
SAME = 0.5  # what is seen so near to where it was is what it was [m]
NEAR = 0.35  # the end is reached [m]
STUCK = 4.0  # held for so long, the person backs out a little [s]


class Thing(NamedTuple):
    """An obstacle on the line."""

    at: Floats
    row: int
    """Where on the line it stands."""
    side: float
    """1: the robot passes on its left, -1: on its right."""
    far: float
    """Lateral offset from the line there [m]."""


class Person:
    """A scripted operator: pure pursuit of the line, slower the more it must turn.

    It passes obstacles on the line on the side chosen when first seen.
    """

    def __init__(self, line: Floats) -> None:
        """line: (n, 2) of the reference [m]."""
        self.reference = self.line = line
        self.row = 0
        along = np.gradient(line, axis=0)
        self._left = np.column_stack((-along[:, 1], along[:, 0])) / np.hypot(*along.T)[:, None]
        self._obstacles: list[Thing] = []
        self.free = math.nan  # when the robot last went on
        self.back_until = -math.inf

    def sees(self, points: Floats) -> None:
        """points: (n, 2) of the newest scan, in the map [m]."""
        first = max(self.row - BEHIND, 0)
        window = self.reference[first : self.row + AHEAD]
        k = first + np.argmin(np.hypot(*(points[:, None] - window).T).T, axis=1)
        off = np.sum((points - self.reference[k]) * self._left[k], axis=1)
        inside = (np.abs(off) < ON_THE_LINE) & (k > first) & (k < first + len(window) - 1)
        points, k, off = points[inside], k[inside], off[inside]
        before = self._obstacles
        # beside the robot it remembers; farther ahead, an obstacle not seen any more has left
        self._obstacles = [
            obstacle for obstacle in before if first <= obstacle.row < self.row + BEHIND
        ]
        while len(points):
            one = np.hypot(*(points - points[0]).T) < SAME
            at, mean = points[one].mean(axis=0), float(off[one].mean())
            known = [obstacle for obstacle in before if np.hypot(*(obstacle.at - at)) < SAME]
            side = known[0].side if known else math.copysign(1.0, -mean)
            far = BERTH + float((side * off[one]).max())
            self._obstacles = [
                obstacle for obstacle in self._obstacles if np.hypot(*(obstacle.at - at)) >= SAME
            ]
            self._obstacles.append(Thing(at, int(np.median(k[one])), side, far))
            points, k, off = points[~one], k[~one], off[~one]
        shift = np.zeros(len(self.reference))
        for obstacle in self._obstacles:
            near = np.hypot(*(self.reference - self.reference[obstacle.row]).T)
            shift += (
                obstacle.side
                * obstacle.far
                * (0.5 + 0.5 * np.cos(np.pi * np.minimum(near / BESIDE, 1.0)))
            )
        self.line = self.reference + shift[:, None] * self._left

    def stick(self, now: float, pose: Pose, v: float) -> Stick:
        """The deflection for the newest scan."""
        if not abs(v) < 0.02 or math.isnan(self.free):
            self.free = now
        if now - self.free > STUCK:
            self.back_until, self.free = now + 1.5, now + 1.5
        if now < self.back_until:
            return Stick(-0.7, 0.0)
        ahead = self.line[self.row : self.row + 40]
        self.row += int(np.argmin(np.hypot(*(ahead - pose[:2]).T)))
        far = np.hypot(*(self.line[self.row :] - pose[:2]).T) > LOOK_AHEAD
        aim = self.line[self.row + (int(np.argmax(far)) if far.any() else len(far) - 1)]
        turn = wrap(math.atan2(aim[1] - pose.y, aim[0] - pose.x) - pose.psi)
        if abs(turn) > 0.9:  # on the spot: x just outside its dead band
            return Stick(0.12, math.copysign(0.9, turn))
        x = 0.95 - 0.5 * abs(turn)
        return Stick(x, min(max(2.2 * turn, -0.9), 0.9))

    def done(self, pose: Pose) -> bool:
        """Whether the end of the line is reached."""
        return math.hypot(*(self.line[-1] - pose[:2])) < NEAR


def points(scan: ScanPart) -> Floats:
    """Points of a scan, in the map, (n, 2) [m]."""
    hit = (scan.ranges > 0) & (scan.ranges < 65535)
    angles = scan.sensor.psi + scan.first + scan.step * np.flatnonzero(hit)
    away = 1e-3 * scan.ranges[hit, None]
    return scan.sensor[:2] + away * np.column_stack((np.cos(angles), np.sin(angles)))


def drive(path: dict[str, float], scenario: str, limit: float) -> dict[str, object]:
    """One drive and its result."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["COHELM_KEYS"] = str(folder / "keys")
        with net.Network() as network:
            robot = FarRobot(network, scenario, folder, "--twin", "--pictures", "0")
            try:
                with network.station():
                    own = keys.station()
                    station = StationEnd(own, net.ROBOT, PORT)
                    bulk = StationBulk(own, net.ROBOT, PORT, station.session)
                with station, bulk:
                    network.be(**path)
                    took, stops, arrived, caps = _drive_manually(station, bulk, limit)
                    state = station.state()
            finally:
                summary = robot.end()
    return {
        "arrived": arrived, "seconds": took, "stops": stops, "least_cap_mps": caps,
        "round_trip_ms": 1e3 * state.round_trip,
        "least_clearance_moving_m": summary["least_clearance_moving_m"],
        "contact": summary["least_clearance_moving_m"] <= 0.0, "overruns": summary["overruns"],
        "within_2ms": summary["within_2ms"], "load": os.getloadavg()[0],
    }  # fmt: skip


def _drive_manually(
    station: StationEnd, bulk: StationBulk, limit: float
) -> tuple[float, list[str], bool, float]:
    """Seconds driven, reasons of stops, whether it arrived, the least speed cap."""
    person: Person | None = None
    requested, stops, least, wanted = -math.inf, [], math.inf, Stick(0.0, 0.0)
    began = math.nan
    start = time.monotonic()
    while (now := time.monotonic()) - start < limit:
        for message in bulk.news():
            if isinstance(message, Polyline) and message.what is LineKind.REFERENCE:
                person = Person(np.asarray(message.points, dtype=np.float64))
        station.steer(Command(wanted, True, True, Device.SCRIPT))
        time.sleep(BEAT)
        received = station.status()
        if received is None or person is None:
            continue
        status = received.message
        ready = status.mode == Mode.MANUAL and status.arming == Arming.ARMED and not status.stopped
        if not ready:
            wanted = Stick(0.0, 0.0)
            if now - requested > 0.5:
                requested = now
                if status.stopped:
                    stops += [status.stopped] if not math.isnan(began) else []
                    station.ask(RequestKind.RESET)
                elif status.lease.driver != status.lease.you:
                    station.ask(RequestKind.TAKE)
                elif status.arming == Arming.ARMED:
                    station.ask(RequestKind.MODE, Mode.MANUAL)
            continue
        began = now if math.isnan(began) else began
        least = min(least, status.speed_cap)
        here = arc(status.pose, status.measured, max(received.age, 0.0))  # an operator predicts
        if person.done(here):
            return now - began, stops, True, least
        scan = station.scan()
        if scan is not None:
            person.sees(points(scan))
        wanted = person.stick(now, here, status.measured.v)
    return limit, stops, False, least


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--delay", type=float, default=0.075, help="each way [s]")
    parser.add_argument("--jitter", type=float, default=0.005, help="its deviation [s]")
    parser.add_argument("--loss", type=float, default=0.01)
    parser.add_argument("--rate", type=float, default=4e6, help="[bit/s]")
    parser.add_argument("--scenario", default="lab-guard")
    parser.add_argument("--limit", type=float, default=300.0, help="[s]")
    args = parser.parse_args()
    why_not = net.why_not()
    if why_not:
        raise SystemExit(f"no bad network can be made: {why_not}")
    path = {key: getattr(args, key) for key in ("delay", "jitter", "loss", "rate")}
    print(json.dumps({**path, **drive(path, args.scenario, args.limit)}, indent=1))


if __name__ == "__main__":
    main()
