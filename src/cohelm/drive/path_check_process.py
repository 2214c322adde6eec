"""Checks requested paths in a process of its own, so that the loop is not delayed.

A check is up to a second of compiled code that holds the interpreter's lock (GIL); in a thread it
would block the loop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import numpy as np

from cohelm.core.types import Floats, Pose
from cohelm.drive.jobs import ThreadJobs
from cohelm.drive.path_check import NONE, CheckedPath, PathChecker
from cohelm.plan.path_planner import Goal
from cohelm.robot.keep.child import Child

WITHIN = 5.0
"""A check that takes longer is given up [s]."""
_AGAIN = 2.0  # after a process that failed, the next one is started so much later [s]
_ENDS = 3.0  # how long ending a process is waited for [s]
_WARM = np.array([(1.0, 0.0), (2.0, 0.0)])


class InlineChecking:
    """Checks inline: for simulated time."""

    def __init__(self, judge: Callable[[Floats | Goal, Pose], CheckedPath]) -> None:
        self._judge = judge
        self._made: CheckedPath | None = None

    @property
    def ready(self) -> bool:
        """Whether the last result has been taken."""
        return self._made is None

    def begin(self, now: float, points: Floats | Goal, pose: Pose) -> None:
        """Check it now."""
        self._made = safely(self._judge, points, pose)

    def result(self, now: float) -> CheckedPath | None:
        """What came out."""
        made, self._made = self._made, None
        return made

    def set_checker(self, judge: PathChecker) -> None:
        """From the next one on."""
        self._judge = judge

    def close(self) -> None:
        """Nothing to close."""


class RemoteChecking:
    """Checks in a process of the lowest priority, which is replaced when it dies or hangs."""

    def __init__(self, judge: PathChecker) -> None:
        self._judge = judge
        self._jobs = ThreadJobs("checking")
        self._child: Child | None = _started(judge)
        self._given_up: Child | None = None
        self._up = self._busy = self._outdated = False
        self._closing = threading.Event()
        self._since = 0.0

    @property
    def ready(self) -> bool:
        """Whether the process is up and idle."""
        child = self._child
        if child is None or self._busy:
            return False
        if self._outdated:
            self._outdated = False
            self._replace(child, after=0.0)
            return False
        if not self._up:
            self._up = child.received() is not None  # its first message reports that it is up
            if child.gone:
                self._replace(child, _AGAIN)
        return self._up

    def begin(self, now: float, points: Floats | Goal, pose: Pose) -> None:
        """Send it over."""
        if self._child is not None:
            self._busy, self._since = True, now
            self._child.send((points, pose))

    def result(self, now: float) -> CheckedPath | None:
        """The result; or a refusal after the time limit."""
        child = self._child
        if not self._busy or child is None:
            return None
        made: CheckedPath | None = child.received()
        if made is None and child.gone:
            made = CheckedPath(None, "it could not be checked: send it again", NONE)
        elif made is None and now - self._since > WITHIN:
            made = CheckedPath(None, f"it could not be checked within {WITHIN:.0f} s", NONE)
            child.gone = True
        if made is not None:
            self._busy = False
        if child.gone:
            self._replace(child, _AGAIN)
        return made

    def set_checker(self, judge: PathChecker) -> None:
        """Use another checker, in a new process."""
        self._judge, self._outdated = judge, True

    def close(self) -> None:
        """End the process."""
        self._closing.set()
        child, self._child = self._child, None
        self._jobs.close(_ENDS)
        for one in {child, self._child, self._given_up}:  # its replacing may not have begun
            if one is not None:
                one.end()

    def _replace(self, child: Child, after: float) -> None:
        """By one that is started so much later [s]."""
        self._child, self._given_up, self._up, self._busy = None, child, False, False

        def again() -> None:
            child.end()
            if self._closing.wait(after):
                return
            self._child = made = _started(self._judge)
            if self._closing.is_set():  # it took so long that `close` did not wait for it
                made.end()

        self._jobs.do(again)


Checking = InlineChecking | RemoteChecking
"""One check at a time. All calls come from one thread and return at once."""


def safely(
    judge: Callable[[Floats | Goal, Pose], CheckedPath], points: Floats | Goal, pose: Pose
) -> CheckedPath:
    """The result of a check; an exception in it is a refusal."""
    try:
        return judge(points, pose)
    except Exception as error:
        return CheckedPath(None, f"it could not be checked: {error}", NONE)


def _answer(judge: PathChecker, request: tuple[Floats | Goal, Pose]) -> CheckedPath:
    """The worker's function for each path."""
    return safely(judge, *request)


def _warm(judge: PathChecker) -> str:
    for what in (_WARM, Goal(1.0, 0.0)):
        safely(judge, what, Pose(0.0, 0.0, 0.0))
    return "up"


def _started(judge: PathChecker) -> Child:
    return Child("cohelm checking", partial(_answer, judge), partial(_warm, judge))
