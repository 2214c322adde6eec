"""Stick to loop on this machine, and ages over a bad network: `python -m benchmarks.link`.

The loop polls as often as it can, so the link alone is measured: from `steer` to the first `heard`
with the new deflection. The bad network needs namespaces (tests/link/net.py).
"""

from __future__ import annotations

import argparse
import math
import threading
import time

from cohelm.core.types import Stick
from cohelm.link.keys import pair_here
from cohelm.link.messages import Command, Device, RequestKind
from cohelm.link.robot_end import RobotEnd
from cohelm.link.station_end import StationEnd
from tests.link import net
from tests.link.ends import STATUS, until


def spread(seconds: list[float]) -> str:
    """Median, 99 % and maximum, in milliseconds."""
    s = sorted(seconds)
    parts = (s[len(s) // 2], s[int(0.99 * len(s))], s[-1])
    return "median {:.1f}, 99 % {:.1f}, most {:.1f} ms".format(*(1e3 * part for part in parts))


def loopback(count: int) -> str:
    """Wait for each deflection; the next one follows a period later."""
    robot_keys, keys = pair_here()
    took: list[float] = []
    with (
        RobotEnd(robot_keys, "127.0.0.1", 0) as robot,
        StationEnd(keys, "127.0.0.1", robot.address[1]) as station,
    ):
        _drives(robot, station)
        for number in range(count):
            wanted = Stick((number % 1000) / 1024, 0.0)
            began = time.perf_counter()
            station.steer(Command(wanted, True, True, Device.SCRIPT))
            while (command := robot.receive().command) is None or command.stick != wanted:
                time.sleep(0.0001)
            took.append(time.perf_counter() - began)
            robot.send_status(STATUS)
            time.sleep(0.01)
    return spread(took)


def impaired(seconds: float, **bad: float) -> str:
    """True age of each command that a 50 Hz loop uses, by a clock that both ends share."""
    robot_keys, keys = pair_here()
    made: dict[float, float] = {}
    ages: list[float] = []
    without = 0
    with net.Network() as network:
        with network.robot():
            robot = RobotEnd(robot_keys, net.ROBOT)
        with network.station():
            station = StationEnd(keys, net.ROBOT)
        with robot, station:
            network.be(**bad)
            _drives(robot, station)
            stop = threading.Event()

            def person() -> None:
                number = 0
                while not stop.wait(0.02):
                    number += 1
                    x = number % 4096 / 4096
                    made[x] = time.monotonic()
                    station.steer(Command(Stick(x, 0.0), True, True, Device.SCRIPT))

            thread = threading.Thread(target=person)
            thread.start()
            time.sleep(1.0)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                command = robot.receive().command
                at = made.get(command.stick.x, math.nan) if command else math.nan
                if math.isnan(at):
                    without += 1
                else:
                    ages.append(time.monotonic() - at)
                robot.send_status(STATUS)
                time.sleep(0.02)
            state = station.state()
            stop.set()
            thread.join()
    return (
        f"age used: {spread(ages)}; {without} of {len(ages) + without} steps without a command; "
        f"round trip {1e3 * state.round_trip:.0f} ms, {100 * state.lost:.0f} % lost"
    )


def _drives(robot: RobotEnd, station: StationEnd) -> None:
    until(station.status, 20.0, lambda: robot.send_status(STATUS))
    number = station.ask(RequestKind.TAKE)
    until(lambda: station.answer(number), 20.0, lambda: robot.send_status(STATUS))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    print("stick to loop, loopback:", loopback(1000))
    why_not = net.why_not()
    if why_not:
        print("no bad network:", why_not)
    else:
        path = {"delay": 0.05, "jitter": 0.01, "rate": 4e6}
        for name, bad in {
            "good network": {},
            "50 +- 10 ms, 4 Mbit/s, 2 % lost": {**path, "loss": 0.02},
            "50 +- 10 ms, 4 Mbit/s, 10 % lost": {**path, "loss": 0.10},
            "75 +- 10 ms, 5 % doubled": {"delay": 0.075, "jitter": 0.01, "duplicate": 0.05},
        }.items():
            print(f"{name}:", impaired(options.seconds, **bad))
