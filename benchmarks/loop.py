"""How well the loop keeps time beside a busy second process: `python -m benchmarks.loop`.

    python -m benchmarks.loop [--seconds 60] [--rate 50 200] [--busy 1] [--twin]

Drives the lab over and over; reports lateness, overruns and the share of one core that each of the
loop's processes uses. 99.9 % of periods within 2 ms is what is asked of 50 Hz.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from cohelm.drive.session import Plan, Session
from cohelm.drive.simulated import simulated
from cohelm.link.messages import Mode

TICK = os.sysconf("SC_CLK_TCK")


def burn() -> None:
    """A busy process: arithmetic and memory, for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    block = bytearray(8 << 20)
    k = 0
    while True:
        k = (k * 48271 + 1) % len(block)
        block[k] = k & 255


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


def children(pid: int) -> dict[str, int]:
    """The loop's helpers by name."""
    found = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            text = status.read_text()
        except OSError:
            continue
        name = text.split("\n")[0].partition("\t")[2]
        if f"PPid:\t{pid}\n" in text and name.startswith("cohelm"):
            found[name] = int(status.parent.name)
    return found


def measure(rate: float, seconds: float, twin: bool, folder: Path) -> dict[str, object]:
    """One session; it turns in AUTOMATIC, and stands at the route's end for the rest."""
    robot = simulated("lab-guard", "twin" if twin else "kinematic")
    with Session(Plan(robot, rate, folder / f"loop-{rate:g}.mcap")) as session:
        helpers = children(os.getpid())
        begun, clock = {n: used(p) for n, p in helpers.items()}, time.monotonic()
        own = time.process_time()
        session.run(lambda _: time.monotonic() - clock > seconds, Mode.AUTOMATIC)
        wall = time.monotonic() - clock
        shares = {name: (used(pid) - begun[name]) / wall for name, pid in helpers.items()}
        shares["loop"] = (time.process_time() - own) / wall
        kept, gate = session.loop.timing.kept(), session.loop.keeper.gate
        return {
            "rate_hz": rate, "seconds": wall, "scheduling": session.scheduling,
            **kept._asdict(), "core_share": shares, "mode": gate.mode.name,
            "reason": gate.reason, "dropped": session.loop.dropped,
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
