"""A driving robot with its desk, in simulated time, and what watches it from outside.

`Rule` follows one sentence: no motion without a mode chosen since the last stop, hold, release or
fault, by somebody who drives. It knows nothing of loop and desk, only what was answered, who holds
the lease, what the gate says, and what the wheels were sent.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

from cohelm.core.types import Twist
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.on_topics import OnTopics
from cohelm.drive.operator_requests import OperatorRequests
from cohelm.drive.path_check import NONE, CheckedPath
from cohelm.drive.path_check_process import InlineChecking
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode, RequestKind
from cohelm.loop.loop import LoopParams
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.robot.gate.modes import latched
from cohelm.robot.keep.record_pipe import line
from cohelm.robot.port import Health
from tests.drive.faults import CORRIDOR
from tests.drive.simulated_link import SimulatedLink, Station
from tests.drive.wrapped import wrapped

DOCKS = (RequestKind.DOCK, RequestKind.UNDOCK)
STANDS_WITHIN = 1.5
"""From full speed at the gate's deceleration, with the robot's delay, and room [s]."""


class Wheels:
    """The robot, and what its wheels were sent last."""

    def __init__(self, robot) -> None:
        self.robot, self.sent, self.bumped, self.held = robot, Twist(0.0, 0.0), False, None
        self.outline = None

    def __getattr__(self, name):
        return getattr(self.robot, name)

    def read(self):
        readings = self.robot.read()
        if self.held is not None:  # the scan stops
            readings = readings._replace(scan=self.held)
        if self.outline is not None:
            readings = readings._replace(outline=self.outline.copy())
        if self.bumped:
            said = ("the bumper is pressed",)
            readings = readings._replace(health=Health(self.robot.now(), float("nan"), said))
        return readings

    def send(self, twist: Twist) -> Twist:
        self.sent = self.robot.send(twist)
        return self.sent

    def stop(self) -> None:
        self.sent = Twist(0.0, 0.0)
        self.robot.stop()


@dataclass(frozen=True)
class Watched(Simulated):
    def maker(self):
        return wrapped(super().maker(), Wheels)


class Later:
    """Jobs that take some periods; a test says how many."""

    def __init__(self) -> None:
        self.takes, self._due = 0, []

    def do(self, job) -> None:
        self._due.append([self.takes, job])

    def turn(self) -> None:
        for one in self._due:
            one[0] -= 1
        if self._due and self._due[0][0] < 0:
            self._due.pop(0)[1]()

    def close(self, within: float) -> bool:
        return True


class Slow(InlineChecking):
    """Each check takes so many periods."""

    def __init__(self, judge) -> None:
        super().__init__(judge)
        self.takes = self._left = 0

    def begin(self, now, points, pose) -> None:
        super().begin(now, points, pose)
        self._left = self.takes

    def result(self, now):
        self._left -= 1
        return super().result(now) if self._left < 0 else None


class FakeRecording:
    """Lines without a process."""

    def __init__(self, path: Path, model, scenario: str) -> None:
        self.path = path
        path.touch()
        self.loop, self._loop = line()
        self.gated, self._gated = line()

    def begin(self, epoch: int) -> None:
        pass

    def keep(self) -> None:
        pass

    def close(self, within: float = 0.0) -> bool:
        for end in (self.loop, self.gated, self._loop, self._gated):
            end.close()
        return True


class SessionJobs:
    """What works beside the loop, in the test's hands."""

    def __init__(self, judge, real_time: bool) -> None:
        self.judge, self.fails = judge, ""
        self.checking = Slow(self._judged)
        self.paths, self.records, self.make = Later(), Later(), FakeRecording

    def _judged(self, points, pose) -> CheckedPath:
        if self.fails == "check":
            return CheckedPath(None, "no", NONE)
        if self.fails == "mistake":
            raise ValueError("a mistake in the check")
        return self.judge(points, pose)

    def turn(self) -> None:
        self.paths.turn()
        self.records.turn()


class Rule:
    """Whether a mode is in force, as one sentence has it."""

    def __init__(self) -> None:
        self.mode = Mode.HOLD
        self.driver = 0
        self.since = -1e9
        self.stops: list[tuple[float, int, int]] = []
        """When, by which client (0: the robot, -1: the lease), and which request of his."""
        self.latched: object = None
        self.before = Twist(0.0, 0.0)
        self.given = self.undocked = 0
        """Modes chosen, and dockings that ended by themselves."""
        self._docking = False

    def end(self, now: float, who: int, number: int = 0) -> None:
        self.since = now if self.mode != Mode.HOLD else self.since
        self.mode = Mode.HOLD
        self.stops.append((now, who, number))

    def follow(self, now: float, log: list[tuple], gate, docking: bool = False) -> None:
        """docking: whether that goes on, or undocking; it ends by itself."""
        given, reset = self.given, False
        for what, *rest in log:
            if what == "lease":
                before, self.driver = rest
                assert before != self.driver
                self.end(now, -1)
                continue
            station, request, granted, _ = rest
            if not granted:
                continue
            reset = reset or request.what == RequestKind.RESET
            mode = Mode.AUTOMATIC if request.what in DOCKS else None
            if request.what == RequestKind.MODE:
                mode = Mode(request.value)
            if request.what == RequestKind.STOP or (
                request.what == RequestKind.MODE and request.value == Mode.HOLD
            ):
                self.end(now, station.number, request.number)
            elif mode is not None:
                assert station.number == self.driver, "a mode by somebody who does not drive"
                for at, who, number in self.stops:
                    own = who == station.number
                    after = request.number > number if own else who == -1 or request.made > at
                    assert after, "asked before a stop"
                self.mode, self.given = mode, self.given + 1
        state = (gate.mode, gate.reason) if latched(gate.mode) else None
        chose = self.given > given  # a stop after that, in the same period, is another one
        again = chose and (reset or state != self.latched)
        known = state == self.latched or any(at == now for at, *_ in self.stops)
        if state is not None and (again or not known):
            self.end(now, 0)
        self.latched = state
        if self._docking and not docking and self.given == given and self.mode != Mode.HOLD:
            self.end(now, 0)
            self.undocked += 1
        self._docking = docking
        assert state is None or self.mode == Mode.HOLD
        self.stops = self.stops[-50:]

    def holds(self, now: float, sent: Twist) -> None:
        before, self.before = self.before, sent
        if self.mode != Mode.HOLD:
            return
        assert abs(sent.v) <= abs(before.v) + 1e-9, f"sets off: {before} -> {sent}"
        assert abs(sent.omega) <= abs(before.omega) + 1e-9, f"sets off: {before} -> {sent}"
        if now > self.since + STANDS_WITHIN:
            assert sent == Twist(0.0, 0.0), f"still moves: {sent}"


class Drive:
    """Robot, loop, desk and link; `run` turns them and holds the rule after each period."""

    def __init__(
        self, folder: Path, ways: LoopParams | None = None, changes: list[str] | None = None,
        topics: OnTopics | None = None,
    ) -> None:  # fmt: skip
        """topics: what a ROS 2 robot hears beside."""
        made = simulated(CORRIDOR, real_time=False, seed=2, changes=changes)
        robot = made.model
        few = robot.lidar.model_copy(update={"beams": 120})
        coarse = robot.model_copy(update={"lidar": few, "camera": None})
        scenario = made.scenario.model_copy(update={"robot": coarse})
        made = Watched(scenario, made.kind, False, made.seed)
        known = map_from_geometry(scenario.walls(), made.start)
        self.link = SimulatedLink(coarse, folder)
        self.session = Session(
            SessionConfig(made, known=known, loop=ways or LoopParams()), self.link.end
        )
        self.gated, self.loop = self.session.loop.gated, self.session.loop
        self.link.clock = self.gated.now
        self.wheels: Wheels = self.gated._robot
        self.rule = Rule()
        self.moved = self.docked = 0
        """Periods in which it moved, and docked or undocked."""
        self.topics = topics
        self.desk = OperatorRequests(
            self.session, self.link, folder, SessionJobs, () if topics is None else (topics,)
        )
        self.beside: SessionJobs = self.desk._jobs
        self._build = self.desk._rerouting._build
        self.desk._rerouting._build = self._built
        self.periods = itertools.count()

    def __enter__(self) -> Drive:
        return self

    def __exit__(self, *_: object) -> None:
        self.desk.close()
        self.session.close()
        self.link.close()

    def station(self, name: str, delay: float = 0.02) -> Station:
        return Station(self.link, name, delay)

    def _built(self, reference):
        if self.beside.fails == "build":
            raise RuntimeError("a mistake in the build")
        return self._build(reference)

    def each(self) -> None:
        """After each period."""
        loop = self.loop
        self.desk.turn(loop)
        if self.topics is not None:
            self.topics.turn(loop)
        on = self.loop.supervisor.docking.on
        self.rule.follow(self.gated.now(), self.link.log, self.gated.gate, on)
        self.docked += on
        self.link.log.clear()
        self.rule.holds(self.gated.now(), self.wheels.sent)
        self.moved += self.wheels.sent != Twist(0.0, 0.0)
        self.beside.turn()
        self.link.turn()

    def run(self, script) -> None:
        """script: yields after whatever it does, once for each period."""
        steps = iter(script)

        def until(_) -> bool:
            self.each()
            return next(steps, "over") == "over"

        self.session.run(until)
