"""Adapts a user's `Robot` to the port: limits, time-out, closing, and exceptions as faults.

Whatever it raises: nobody but the driver ends a gate process, which hears no Ctrl-C.
"""

from __future__ import annotations

import contextlib
import inspect
import math
import os
import pickle
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.others_code import others_traceback
from cohelm.core.scalars import is_finite
from cohelm.core.types import Floats, Pose, Twist
from cohelm.core.waiting import said_if_it_waits
from cohelm.robot.achievable import achievable
from cohelm.robot.base import Robot
from cohelm.robot.limits import unbraked
from cohelm.robot.model import RobotModel
from cohelm.robot.port import (
    Contact,
    FailedCall,
    Frame,
    Health,
    Odometry,
    Readings,
    RobotPort,
    Scan,
)

Make = Callable[[RobotModel], Robot] | Robot
"""A class or function that makes a robot of its model; or a robot that can be pickled."""

_STILL = Twist(0.0, 0.0)
_SAME = 0.005  # stamps of one reading, read twice with its age, differ by less [s]
_AGAIN = 0.1  # a stop is repeated after this time, in case one was lost [s]
_LOOK = 0.05  # period of the watchdog [s]
_MOST, _LONGEST = 16, 400  # faults at a time, and letters of each
_MOST_TRACEBACKS, _LONGEST_TRACEBACK = 50, 6000  # of a drive, and letters of one: its end
_HANGS = 0.1  # a call that takes longer is not waited for before stopping [s]


def _again(new: Odometry, old: Odometry | None) -> bool:
    """Whether it is the same reading as before."""
    if old is None or (new.pose, new.twist) != (old.pose, old.twist):
        return False
    return abs(new.stamp - old.stamp) < _SAME


class RobotAdapter:
    """A `robot.port.RobotPort` made of a `robot.base.Robot`."""

    def __init__(self, robot: Robot) -> None:
        """Raises CohelmError for what is no robot."""
        if not isinstance(robot, Robot):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise CohelmError(
                f"a robot must be a subclass of cohelm.Robot, got {type(robot).__name__}"
            )
        if not isinstance(getattr(robot, "model", None), RobotModel):
            raise CohelmError(
                f"{type(robot).__name__} has no model: call super().__init__(load_robot(...)) first"
            )
        self._robot, self._free = robot, unbraked(robot.model.bounds())
        self._newest = Readings()
        self._first: contextlib.AbstractContextManager[None] = said_if_it_waits(
            "read of the robot's driver"
        )
        self._calls = threading.Lock()  # into the robot: one at a time
        self._commanded = self._stopped = -math.inf
        self._moves = False
        self._failed: dict[str, tuple[FailedCall, str]] = {}  # by call, each with its sentence
        self._raised: set[tuple[object, ...]] = set()
        self._tracebacks: deque[tuple[str, BaseException]] = deque()
        self._closed = threading.Event()
        self._pid = os.getpid()
        if robot.real_time:
            threading.Thread(target=self._watch, name="robot time-out", daemon=True).start()

    @property
    def model(self) -> RobotModel:
        """Outline, limits, sensors."""
        return self._robot.model

    def now(self) -> float:
        """The robot's clock [s]."""
        self._open()
        return self._robot.now()

    def wait(self, until: float) -> None:
        """Let time pass; a robot without commands is stopped meanwhile."""
        self._open()
        due = self._commanded + self._robot.timeout
        if self._moves and due < until:
            self._robot.wait(due)
            with self._calls:
                self._brake()
        self._robot.wait(until)

    def read(self) -> Readings:
        """The newest of everything; an exception in the robot's code becomes a fault."""
        self._open()
        with self._calls:
            try:
                first, self._first = self._first, contextlib.nullcontext()
                with first:
                    given = self._robot.read()
                given = _in_place(_checked(given), self.model)
                if given.odometry is not None and _again(given.odometry, self._newest.odometry):
                    given = given._replace(odometry=None)
                given = given._replace(outline=self._outline(given.outline))
                self._newest = _newest(given, self._newest)
            except BaseException as error:
                self._fails("read", error)
            self._alone()
        health = self._newest.health or Health(self._robot.now(), math.nan, ())
        failed, self._failed = tuple(self._failed.values()), {}
        faults = tuple(map(_brief, (*health.faults, *(said for _, said in failed))[:_MOST]))
        first = failed[0][0] if failed and not health.faults else None
        return self._newest._replace(health=health._replace(faults=faults, failed=first))

    def send(self, twist: Twist) -> Twist:
        """Send a twist, limited to the speeds; one that is not finite is a stop."""
        self._open()
        self._commanded = self._robot.now()
        if not (is_finite(twist.v) and is_finite(twist.omega)):
            self.stop()
            return _STILL
        possible = achievable(twist, _STILL, self._free, 1.0)
        with self._calls:
            self._moves = True
            try:
                self._robot.send(possible)
            except BaseException as error:
                self._fails("send", error)
            self._alone()
            self._moves = True  # a stop while it hung came before it
        return possible

    def stop(self) -> None:
        """Brake; sent at once, and repeated."""
        self._open()
        with self._calls:
            self._brake()

    def close(self) -> None:
        """Stop, and release the hardware."""
        if self._closed.is_set():
            return
        with self._calls:
            self._moves = True
            self._brake()
            self._closed.set()
            try:
                self._robot.close()
            except BaseException as error:
                self._fails("close", error)

    def traceback(self) -> str:
        """As in `port.Traced`; also printed on stderr, by a thread: a terminal may not take it."""
        if not self._tracebacks:
            return ""
        call, error = self._tracebacks.popleft()
        text = _traceback(call, error)
        threading.Thread(target=_print, args=(text,), name="traceback", daemon=True).start()
        return text

    def _fails(self, call: str, error: BaseException) -> None:
        """An exception in the robot's code becomes a fault; its traceback is kept, once for each
        kind and place."""
        ours = isinstance(error, CohelmError)  # a sentence already
        why = str(error) if ours else _named(error)
        said = why if ours else f"{call} failed: {why}"
        self._failed[call] = FailedCall(call, _brief(why)), said
        at = error.__traceback__
        while at is not None and at.tb_next is not None:
            at = at.tb_next
        where = () if at is None else (at.tb_frame.f_code, at.tb_lineno)
        kind = (call, type(error), *where)
        if kind not in self._raised and len(self._raised) < _MOST_TRACEBACKS:
            self._raised.add(kind)
            self._tracebacks.append((call, error))

    def _outline(self, reported: Floats | None) -> Floats | None:
        """The newest outline, the same array as long as it is the same. CohelmError for none."""
        before = self._newest.outline
        if reported is None or (before is not None and np.array_equal(reported, before)):
            return before
        return self.model.checked_outline(reported)

    def _brake(self) -> None:
        now = self._time()
        if not self._moves and now - self._stopped < _AGAIN:
            return
        try:
            self._robot.stop()
            self._moves, self._stopped = False, now if now < math.inf else -math.inf
        except BaseException as error:
            self._fails("stop", error)
            with contextlib.suppress(BaseException):
                self._robot.send(_STILL)  # else the last twist stays until the hardware notices

    def _alone(self) -> None:
        """Of a driver that forks, the child that comes back here ends: one process drives."""
        if os.getpid() != self._pid:
            os._exit(0)

    def _time(self) -> float:
        """The robot's clock; infinite where that fails, as then any command is too old [s]."""
        try:
            return self._robot.now()
        except BaseException:
            return math.inf

    def _late(self) -> bool:
        return self._moves and self._time() - self._commanded >= self._robot.timeout - 1e-9

    def _watch(self) -> None:
        """In real time: apply the time-out also without calls, or while a call hangs."""
        while not self._closed.wait(_LOOK):
            if self._late():
                free = self._calls.acquire(timeout=_HANGS)
                try:
                    if self._late():
                        self._brake()
                finally:
                    if free:
                        self._calls.release()

    def _open(self) -> None:
        if self._closed.is_set():
            raise CohelmError("the robot is closed: make a new one")


_MADE = {
    "odometry": (Odometry, "made by self.odometry(...)"),
    "scan": (Scan, "made by self.scan(...)"),
    "further": (Scan, "made by self.scan(...)"),
    "contacts": (Contact, "made by self.contact(...)"),
    "frame": (Frame, "a cohelm.robot.port.Frame"),
    "health": (Health, "a cohelm.robot.port.Health"),
}


def _checked(given: object) -> Readings:
    """What a robot's `read` returned; CohelmError for what gate and monitors can not look at."""
    if not isinstance(given, Readings):
        raise CohelmError(f"read must return cohelm.Readings(...), got {type(given).__name__}")
    for name, (kind, how) in _MADE.items():
        value: Any = getattr(given, name)
        several = name in ("further", "contacts")
        if several and type(value) not in (tuple, list):  # a Scan is a tuple too
            got = type(value).__name__
            raise CohelmError(f"{name} must be a tuple, {name}=(...,), got {got}")
        for one in value if several else (value,):
            if (one is not None or several) and not (isinstance(one, kind) and _sound(one)):
                raise CohelmError(f"{name} must be {how}, got {type(one).__name__}")
    return given


def _in_place(given: Readings, model: RobotModel) -> Readings:
    """The same, if each scan is where those of its LiDAR belong; CohelmError if not, as it would
    count where another one is mounted."""
    names = [lidar.name for lidar in model.lidars]
    first, others = next(iter(names), ""), names[1:]
    if given.scan is not None and given.scan.sensor in others:
        raise CohelmError(f"scan is one of {given.scan.sensor!r}: give it in further=(...,)")
    for name in (scan.sensor for scan in given.further):
        if name in others:
            continue
        if not name:
            how = "no LiDAR's name: make it by self.scan(..., sensor=NAME)"
        elif name == first:
            how = f"{name!r}: give it as scan"
        else:
            how = f"{name!r}, and {model.name} has no such LiDAR: describe it in the robot's YAML"
        raise CohelmError(f"further has a scan of {how}")
    return given


def _sound(one: Any) -> bool:
    """Whether a reading holds numbers where there have to be some; finite or not."""
    numbers = [one.stamp]
    if isinstance(one, Odometry):
        pose, twist = cast("tuple[Any, Any]", (one.pose, one.twist))
        if not (isinstance(pose, Pose) and isinstance(twist, Twist)):
            return False
        numbers += (*pose, *twist)
    if isinstance(one, Scan):
        ranges = cast("NDArray[Any]", one.ranges)
        if not isinstance(cast("Any", ranges), np.ndarray):
            return False
        if ranges.ndim != 1 or ranges.dtype.kind != "f":
            return False
        edges = cast("Any", one.edges)
        if edges is not None and getattr(edges, "shape", None) != ranges.shape:
            return False
        numbers += (one.duration, one.number)
    if isinstance(one, Health):
        numbers.append(one.battery)
        faults = cast("Any", one.faults)
        if not (isinstance(faults, tuple | list) and all(isinstance(f, str) for f in faults)):  # pyright: ignore
            return False
    return all(isinstance(number, (int, float, np.floating, np.integer)) for number in numbers)


def _newest(new: Readings, old: Readings) -> Readings:
    """The new readings, and the old ones where there is no new one."""
    scans = {scan.sensor: scan for scan in (*old.further, *new.further)}
    contacts = {one.sensor: one for one in (*old.contacts, *new.contacts)}
    both = zip(new, old, strict=True)
    newest = Readings._make(one if one is not None else was for one, was in both)
    return newest._replace(further=tuple(scans.values()), contacts=tuple(contacts.values()))


def _traceback(call: str, error: BaseException) -> str:
    text = others_traceback(error)
    if len(text) > _LONGEST_TRACEBACK:
        text = f"…{text[-_LONGEST_TRACEBACK:]}"
    return f"{call} of the robot's driver failed:\n{text}"


def _print(text: str) -> None:
    with contextlib.suppress(Exception):  # the driver may have closed it
        print(text, file=sys.stderr, flush=True)


def _named(error: BaseException) -> str:
    name = type(error).__name__
    try:
        text = " ".join(str(error).split())
    except Exception:  # its author's mistake, too
        return name
    return f"{name}: {text}" if text else name


def _brief(text: str) -> str:
    """No longer than a person reads, and than the line to the loop has room for."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1].rstrip()}…"


class AdaptedMaker(NamedTuple):
    """Makes a user's robot in the process that is to hold it."""

    make: Make
    model: RobotModel

    def __reduce__(self) -> tuple[type[_Unimported], tuple[bytes, str, RobotModel]]:
        return _Unimported, (pickle.dumps(self.make), self.driver, self.model)

    @property
    def driver(self) -> str:
        """The name of what makes it, package:Class."""
        func = getattr(self.make, "func", self.make)  # of functools.partial
        name = getattr(func, "__qualname__", type(func).__qualname__)
        return f"{func.__module__}:{name}"

    def __call__(self) -> RobotPort:
        """Raises CohelmError if that fails, or if its model differs."""
        make, model = self
        try:
            with said_if_it_waits("the constructor of the robot's driver"):
                robot = make if isinstance(make, Robot) else _made(make, model)
        except CohelmError:
            raise
        except BaseException as error:
            raise CohelmError(_brief(f"the robot can not be made: {_named(error)}")) from error
        adapted = RobotAdapter(robot)
        if adapted.model != model:
            raise CohelmError(
                f"the robot's model is not the model of {model.name} that it was given: let "
                "it keep that one, def __init__(self, model): super().__init__(model)"
            )
        return adapted


class _Unimported(NamedTuple):
    """An `AdaptedMaker` in another process, which imports the driver when it is to make it."""

    pickled: bytes
    driver: str
    model: RobotModel

    def __call__(self) -> RobotPort:
        """Raises CohelmError also if the driver can not be imported there."""
        try:
            with said_if_it_waits(f"the import of {self.driver}"):
                make = pickle.loads(self.pickled)
        except BaseException as error:
            why = f"{self.driver} can not be imported by the gate process: {_named(error)}"
            raise CohelmError(_brief(why)) from error
        return AdaptedMaker(make, self.model)()


def _made(make: Callable[..., Any], model: RobotModel) -> Robot:
    """Call `make`, with the model if it takes one. CohelmError if it takes more."""
    try:
        parameters = inspect.signature(make).parameters
    except (TypeError, ValueError):
        return make(model)
    star = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    needed = [p.name for p in parameters.values() if p.default is p.empty and p.kind not in star]
    if len(needed) > 1:
        raise CohelmError(
            "the robot is made of its model alone, or of nothing, and not of "
            f"{' and '.join(needed)}: give all but the first a default"
        )
    return make(model) if parameters else make()
