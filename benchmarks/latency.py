"""Stick to wheel command over the real link on this machine: `python -m benchmarks.latency`.

    python -m benchmarks.latency [--count 300] [--rate 50] [--busy 0] [--twin]

Station and robot are processes of their own, as in `cohelm drive`; both read the same clock. The
stick goes to and fro in manual mode at a time unrelated to the loop's; what is timed is from
`steer` to the first command to the wheels, behind guard and gate, that follows it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import struct
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from cohelm.core.types import Stick, Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.session import SessionConfig
from cohelm.drive.teleop_server import TeleopConfig, serve
from cohelm.link.keys import Keys, pair_here
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.station_end import StationEnd

SENT = struct.Struct("dd")
SCENARIO = Path(__file__).parent.parent / "tests" / "drive" / "corridor.yaml"
BEAT = 0.02  # a page sends its stick 50 times a second [s]


@dataclass(frozen=True)
class Timed(Simulated):
    """Logs the wheel commands and their times."""

    log: str = ""

    def maker(self):
        return partial(_noting, super().maker(), self.log)


def _noting(maker, log: str):
    return _Noting(maker(), log)


class _Noting:
    def __init__(self, robot, log: str) -> None:
        self._robot, self._log = robot, os.open(log, os.O_WRONLY | os.O_APPEND)

    def __getattr__(self, name: str):
        return getattr(self._robot, name)

    def send(self, twist: Twist) -> Twist:
        os.write(self._log, SENT.pack(time.monotonic(), twist.v))
        return self._robot.send(twist)


def drive(line: Connection, made: Timed, rate: float, keys: Keys) -> None:
    """The robot's process."""
    serve(
        SessionConfig(made, rate), TeleopConfig(keys, "127.0.0.1", 0),
        lambda address: line.send(address),
        lambda: "measured" if line.poll() else "",
    )  # fmt: skip


class BenchStick:
    """Steers 50 times a second, as a page does, and collects the commands meanwhile."""

    def __init__(self, station: StationEnd, log: Path) -> None:
        self.station, self.log = station, log.open("rb")
        self.stick = Stick(0.0, 0.0)
        self.due = time.monotonic()

    def hold(self, seconds: float) -> None:
        """Keep the same deflection."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.station.steer(Command(self.stick, True, True, Device.SCRIPT))
            time.sleep(BEAT)

    def ask(self, what: RequestKind, value: int, done) -> None:
        """Request, and wait until it is done."""
        end = time.monotonic() + 60.0
        while not done():
            if time.monotonic() > end:
                raise SystemExit(f"{what.name} is not done: {self.station.status()}")
            self.station.ask(what, value)
            self.hold(0.3)

    def sent(self) -> list[tuple[float, float]]:
        """Commands to the wheels since the last call: time [s] and speed [m/s]."""
        data = self.log.read()
        return list(SENT.iter_unpack(data[: len(data) // SENT.size * SENT.size]))

    def step(self, x: float) -> float:
        """Set a new deflection; time until the wheels are commanded [s]."""
        before = self.sent()[-1][1]
        self.stick = Stick(x, 0.0)
        began = time.monotonic()
        end = began + 2.0
        while time.monotonic() < end:
            self.hold(BEAT)
            for at, v in self.sent():
                if at > began and (v - before) * x > 1e-4:
                    return at - began
        raise SystemExit(f"the robot does not follow: {self.station.status()}")


def measure(count: int, rate: float, twin: bool) -> list[float]:
    """Times from stick to wheels [s]."""
    robot_keys, keys = pair_here()
    of = simulated(SCENARIO, "twin" if twin else "kinematic")
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "sent"
        log.touch()
        made = Timed(of.scenario, of.kind, of.real_time, of.seed, str(log))
        context = multiprocessing.get_context("spawn")
        line, theirs = context.Pipe()
        robot = context.Process(target=drive, args=(theirs, made, rate, robot_keys))
        robot.start()
        theirs.close()
        host, port = line.recv()[:2]
        with StationEnd(keys, host, port) as station:
            stick = BenchStick(station, log)
            while station.status() is None:
                stick.hold(0.1)
            status = lambda: station.status().message  # noqa: E731
            stick.ask(RequestKind.TAKE, 0, lambda: status().lease.driver == status().lease.you)
            stick.ask(RequestKind.MODE, Mode.MANUAL, lambda: status().mode == Mode.MANUAL)
            while status().arming != Arming.ARMED:
                stick.hold(0.1)
            took = []
            for number in range(count):
                stick.hold(0.45 + 0.1 * rng.random())
                took.append(stick.step(0.4 if number % 2 == 0 else -0.4))
        line.send("enough")
        robot.join(30.0)
    return took


def main() -> None:
    from benchmarks.loop import beside

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--rate", type=float, default=50.0, help="of the robot's loop")
    parser.add_argument("--busy", type=int, default=0, help="busy processes beside it")
    parser.add_argument("--twin", action="store_true")
    given = parser.parse_args()
    with beside(given.busy):
        took = sorted(measure(given.count, given.rate, given.twin))
    parts = (took[len(took) // 2], took[int(0.99 * len(took))], took[-1])
    text = "median {:.1f}, 99 % {:.1f}, most {:.1f} ms".format(*(1e3 * part for part in parts))
    load = os.getloadavg()[0]
    print(f"stick to wheels at {given.rate:g} Hz: {text}; {len(took)} steps, load {load:.1f}")


if __name__ == "__main__":
    main()
