"""How well the loop keeps time beside a busy second process: `python -m benchmarks.loop`.

    python -m benchmarks.loop [--seconds 60] [--rate 50 200] [--busy 1] [--twin]

Drives the lab, lap after lap; reports lateness, overruns and the share of one core that each of the
loop's processes uses. 99.9 % of periods within 2 ms is what is asked of 50 Hz. In the same run a
bare process that does nothing but wake up on time says what the machine itself allows: on a shared
one that is the limit.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

from cohelm.drive.session import Plan, Session
from cohelm.drive.simulated import simulated
from cohelm.link.messages import Mode
from cohelm.loop.timing import Kept, Timing
from cohelm.robot.keep.priority import urgent
from cohelm.robot.keep.processes import children
from cohelm.scenario import load

TICK = os.sysconf("SC_CLK_TCK")


def burn() -> None:
    """A busy process: arithmetic and memory, until whoever began it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    block, parent = bytearray(8 << 20), os.getppid()
    k = 0
    while os.getppid() == parent:
        for _ in range(1 << 16):
            k = (k * 48271 + 1) % len(block)
            block[k] = k & 255


def wake(rate: float, said: Connection) -> None:
    """Nothing but waking up so often, before the loop in rank; tells how that went when asked."""
    urgent()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(11))
    timing, due = Timing(), time.monotonic()
    while not said.poll():
        due += 1.0 / rate
        time.sleep(max(due - time.monotonic(), 0.0))
        now = time.monotonic()
        timing.add(now, now - due, 0.0, False)
        due = max(due, now - 1.0 / rate)
    said.send(timing.kept())


@contextmanager
def beside(busy: int) -> Generator[None]:
    """So many busy processes, meanwhile."""
    context = multiprocessing.get_context("spawn")
    others = [context.Process(target=burn, daemon=True) for _ in range(busy)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.kill()


def used(pid: int) -> float:
    """Processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


BACK = [[3.5, -1.2], [1.5, -2.6], [0.3, -2.7], [0.0, -1.75]]
"""From the end of the lab's route to its start, past the cones [m]."""
LAP = 60.0
"""No lap takes less [s]."""


def laps(seconds: float) -> str:
    """The change of the lab that makes its route long enough to be driven for so long."""
    once = [list(point) for point in load.scenario("lab-guard").reference.waypoints_m]
    points = once + (BACK + once[1:]) * math.ceil(seconds / LAP)
    return f"reference.waypoints_m={json.dumps(points)}"


def measure(rate: float, seconds: float, twin: bool, folder: Path) -> dict[str, object]:
    """One session in AUTOMATIC, driving all the time."""
    kind = "twin" if twin else "kinematic"
    robot = simulated("lab-guard", kind, changes=[laps(seconds)])
    with Session(Plan(robot, rate, folder / f"loop-{rate:g}.mcap")) as session:
        helpers = children(os.getpid())
        begun, clock = {n: used(p) for n, p in helpers.items()}, time.monotonic()
        own = time.process_time()
        ours, theirs = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        context.Process(target=wake, args=(rate, theirs), daemon=True).start()
        session.run(lambda _: time.monotonic() - clock > seconds, Mode.AUTOMATIC)
        wall = time.monotonic() - clock
        shares = {name: (used(pid) - begun[name]) / wall for name, pid in helpers.items()}
        shares["loop"] = (time.process_time() - own) / wall
        ours.send("enough")
        bare: Kept = ours.recv()
        kept, gate = session.loop.timing.kept(), session.loop.keeper.gate
        return {
            "rate_hz": rate, "seconds": wall, "scheduling": session.scheduling,
            **kept._asdict(), "bare_timer": bare._asdict(), "core_share": shares,
            "mode": gate.mode.name, "reason": gate.reason, "dropped": session.loop.dropped,
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, nargs="*", default=[50.0, 200.0])
    parser.add_argument("--busy", type=int, default=1, help="busy processes beside it")
    parser.add_argument("--twin", action="store_true")
    given = parser.parse_args()
    with beside(given.busy), TemporaryDirectory() as folder:
        for rate in given.rate:
            found = measure(rate, given.seconds, given.twin, Path(folder))
            print(json.dumps(found, indent=1, default=float), flush=True)


if __name__ == "__main__":
    main()
