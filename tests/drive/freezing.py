"""Freeze one process of a drive at random moments, again and again, and see what the robot does.

    python -m tests.drive.freezing [loop gate planner recorder] [--rounds 500] [--seed 1]

The lab is driven lap after lap by real processes in real time. Each round one process is stopped
(SIGSTOP) at a random moment for a random time, and goes on (SIGCONT); then somebody resets what was
latched and chooses the mode anew. How far the robot came after the freeze is its simulated world's
word: its wheels go on with the last command while its process stands still, up to its own time-out.
"""

from __future__ import annotations

import argparse
import json
import math
import mmap
import multiprocessing
import os
import random
import signal
import struct
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from benchmarks.loop import laps
from cohelm.core.types import Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.loop.planning import MAX_PLAN_AGE
from cohelm.robot.gate.modes import GateMode, latched
from cohelm.robot.keep.record_pipe import HUNG_AFTER
from cohelm.robot.port import Readings
from tests.drive.wrapped import wrapped
from tests.robot.keep.test_processes import children

PROCESSES = ("loop", "gate", "planner", "recorder")
STARTED = 900.0  # with nothing compiled, on a busy machine [s]
WATCHDOG, LOOK, TIMEOUT, BRAKES = 0.1, 0.02, 0.5, 2.0
"""Of the gate, between two looks of its process, the robot's own [s]; and its brakes [m/s^2]."""
SLACK = 0.05
"""So long a busy machine may keep a process waiting that comes before all others [s]."""
_TRACE = struct.Struct("=dddd")


class Trace(NamedTuple):
    """The robot's world, as far as it has been worked out."""

    t: float
    way: float
    """Driven since the start [m]."""
    v: float
    least: float
    """The smallest clearance while it moved [m]."""


@dataclass(frozen=True)
class Traced(Simulated):
    """A simulated robot that leaves its trace in a file."""

    trace: Path = Path()

    def maker(self) -> Any:
        return wrapped(super().maker(), _Leaving, self.trace)


class _Leaving:
    def __init__(self, robot: Any, trace: Path) -> None:
        self._robot = robot
        with trace.open("r+b") as file:
            self._trace = mmap.mmap(file.fileno(), _TRACE.size)
        self._way, self._at = 0.0, robot.truth().pose

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot, name)

    def read(self) -> Readings:
        readings = self._robot.read()
        self._leave()
        return readings

    def send(self, twist: Twist) -> Twist:
        done = self._robot.send(twist)
        self._leave()
        return done

    def _leave(self) -> None:
        truth = self._robot.truth()
        self._way += math.dist(self._at[:2], truth.pose[:2])
        self._at = truth.pose
        self._trace[:] = _TRACE.pack(truth.stamp, self._way, truth.twist.v, truth.least_moving)


class State(NamedTuple):
    """What the loop says of itself, when it changes."""

    mode: str
    reason: str
    alarms: tuple[str, ...]


def _drive(line: Connection, made: Traced, record: Path) -> None:
    """The loop's process: tells its state, and drives anew when it is told to."""
    os.setpgid(0, 0)
    with Session(SessionConfig(made, record=record)) as session:
        line.send(children(os.getpid()))
        last: State | None = None
        wanted = True

        def until(loop: Any) -> bool:
            nonlocal last, wanted
            if line.poll():
                if line.recv() == "end":
                    return True
                wanted = True
            gate = loop.gated.gate
            if wanted and latched(gate.mode):
                loop.gated.reset()
            elif wanted:
                wanted = bool(loop.supervisor.choose(Mode.AUTOMATIC))
            told = tuple(alarm.text for alarm in loop.alarms.worst() if alarm.active)
            state = State(gate.mode.name, gate.reason, told)
            if state != last:
                last = state
                line.send(state)
            return False

        session.run(until)
        session.end("enough")


class Drive:
    """A drive in processes of its own, seen from outside."""

    def __init__(self, folder: Path, record: str = "drive.mcap") -> None:
        self._path = folder / "trace"
        self._path.write_bytes(bytes(_TRACE.size))
        lab = simulated("lab-guard", changes=[laps(3600.0)])
        made = Traced(lab.scenario, lab.kind, True, lab.seed, self._path)
        context = multiprocessing.get_context("spawn")
        self._line, theirs = context.Pipe()
        self._process = context.Process(target=_drive, args=(theirs, made, folder / record))
        self._process.start()
        theirs.close()
        if not self._line.poll(STARTED):
            self.kill()
            raise AssertionError("the drive has not begun")
        self.state = State("IDLE", "", ())
        found = self._line.recv()
        self.pids = {name.removeprefix("cohelm "): pid for name, pid in found.items()}
        self.pids["loop"] = self._process.pid

    def trace(self) -> Trace:
        return Trace(*_TRACE.unpack(self._path.read_bytes()))

    def again(self) -> None:
        """Have it reset and driven."""
        self._line.send("again")

    def wait(self, what: Any, within: float) -> float | None:
        """How long it took until this was so of state and trace; None: it never was."""
        begun = time.monotonic()
        while (passed := time.monotonic() - begun) < within:
            while self._line.poll(0.002):
                self.state = self._line.recv()
            if what(self.state, self.trace()):
                return passed
        return None

    @contextmanager
    def frozen(self, who: str) -> Iterator[None]:
        os.kill(self.pids[who], signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(self.pids[who], signal.SIGCONT)

    def end(self) -> None:
        self._line.send("end")
        self._process.join(30.0)
        self.kill()

    def kill(self) -> None:
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._line.close()


def allowed(who: str, v: float) -> float:
    """How far a robot of this speed may come from the freeze to standing [m]."""
    faster = v + BRAKES * (LOOK + 0.05)  # what was on its way to the wheels
    late = TIMEOUT if who == "gate" else WATCHDOG + LOOK
    return faster * (late + 0.05 + SLACK) + faster**2 / (2.0 * BRAKES)


def moved(drive: Drive, who: str, chance: random.Random) -> dict[str, Any]:
    """One round for loop or gate process."""
    went = drive.wait(lambda s, t: s.mode == "AUTOMATIC" and t.v > 0.2, 20.0)
    if went is None:
        return {"who": who, "wrong": f"it does not drive: {drive.state}"}
    time.sleep(chance.uniform(0.0, 0.5))
    long = math.exp(chance.uniform(math.log(0.06), math.log(1.2)))
    with drive.frozen(who):
        before = drive.trace()
        time.sleep(long)
        during = drive.trace()
    after_thaw = drive.wait(lambda s, t: t.t > before.t + long, 5.0)
    found: dict[str, Any] = {"who": who, "for": long, "v": before.v, "wrong": ""}
    if long < WATCHDOG - 0.04 and drive.wait(lambda s, t: s.mode != "AUTOMATIC", 0.15) is None:
        return found | {"went_on": True}
    stood = drive.wait(lambda s, t: latched(GateMode[s.mode]) and t.v == 0.0, 3.0)
    found["way"] = drive.trace().way - before.way
    found["reason"] = drive.state.reason
    if after_thaw is None or stood is None:
        if long > WATCHDOG + LOOK + SLACK:
            found["wrong"] = f"it does not stand: {drive.state} {drive.trace()}"
        return found | {"went_on": True}
    if found["way"] > allowed(who, before.v):
        found["wrong"] = f"it went {found['way']:.3f} m, not {allowed(who, before.v):.3f}"
    if who == "loop" and long > 0.8 and during.v != 0.0:
        found["wrong"] = f"frozen for {long:.2f} s and it does not stand: {during}"
    time.sleep(0.3)
    if drive.trace().v != 0.0 or drive.state.mode == "AUTOMATIC":
        found["wrong"] = "it set off again by itself"
    drive.again()
    return found


def helped(drive: Drive, who: str, chance: random.Random) -> dict[str, Any]:
    """One round for planner or recorder."""
    within, says = {
        "planner": (MAX_PLAN_AGE, "planner does not answer"),
        "recorder": (HUNG_AFTER, "recorder is too slow"),
    }[who]
    found: dict[str, Any] = {"who": who, "wrong": ""}
    if drive.wait(lambda s, t: s.mode == "AUTOMATIC" and t.v > 0.1, 20.0) is None:
        return found | {"wrong": f"it does not drive: {drive.state}"}
    time.sleep(chance.uniform(0.0, 0.5))
    with drive.frozen(who):
        before = drive.trace()
        took = drive.wait(lambda s, _: any(says in a for a in s.alarms), within + 3.0)
        found["alarm_after"] = took
        found["way"] = drive.trace().way - before.way
    if took is None or took > within + 0.5:
        found["wrong"] = f"the alarm came after {took}"
    if drive.state.mode != "AUTOMATIC":
        found["wrong"] = f"it drives no more: {drive.state}"
        drive.again()
    found["over_after"] = drive.wait(lambda s, _: not s.alarms, 5.0)
    if found["over_after"] is None:
        found["wrong"] = f"the alarm stays: {drive.state}"
    return found


def rounds(who: str, number: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """So many with one process; a drive that ended is begun anew, and counted as wrong."""
    chance, found = random.Random(f"{who} {seed}"), []
    drive = Drive(folder)
    try:
        for _ in range(number):
            one = moved if who in ("loop", "gate") else helped
            found.append(one(drive, who, chance) | {"least": drive.trace().least})
            if found[-1]["wrong"]:
                print(found[-1], file=sys.stderr, flush=True)
    finally:
        drive.end()
    return found


def summary(found: list[dict[str, Any]]) -> dict[str, Any]:
    ways = sorted(one["way"] for one in found if "went_on" not in one and "way" in one)
    alarms = sorted(one["alarm_after"] for one in found if one.get("alarm_after") is not None)
    return {
        "rounds": len(found), "wrong": [one for one in found if one["wrong"]],
        "went_on": sum("went_on" in one for one in found),
        "farthest_m": max(ways, default=None),
        "latest_alarm_s": max(alarms, default=None),
        "latest_over_s": max((o["over_after"] or 99.0 for o in found if "over_after" in o),
                             default=None),
        "least_clearance_m": min(one["least"] for one in found),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("who", nargs="*", default=PROCESSES)
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for who in given.who:
        with TemporaryDirectory() as folder:
            found = rounds(who, given.rounds, given.seed, Path(folder))
        print(json.dumps({"who": who, "seed": given.seed} | summary(found)), flush=True)


if __name__ == "__main__":
    main()
