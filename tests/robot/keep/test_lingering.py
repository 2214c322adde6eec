"""A driver that does not let go: its gate process ends, and lets go of the hardware."""

import contextlib
import functools
import importlib
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import cohelm
from cohelm.core import waiting
from cohelm.core.errors import CohelmError
from cohelm.robot.adapter import AdaptedMaker
from cohelm.robot.keep import process, serve
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.process import RemoteGatedRobot
from cohelm.robot.port import RobotPort
from tests.few import first
from tests.patience import looks
from tests.robot.keep.test_processes import WITHIN, alive

pytestmark = pytest.mark.xdist_group("realtime")

LINGERS = "the robot's driver does not end"


@functools.cache
def sally() -> cohelm.RobotModel:
    """Not when this file is imported, as every gate process does: that takes half a second."""
    return cohelm.load_robot("sally")


class Still(cohelm.Robot):
    def read(self) -> cohelm.Readings:
        return cohelm.Readings(self.odometry(cohelm.Pose(0, 0, 0), cohelm.Twist(0, 0)))

    def send(self, twist: cohelm.Twist) -> None: ...

    def stop(self) -> None: ...


class Hangs(Still):
    def close(self) -> None:
        time.sleep(1000.0)


class Threaded(Still):
    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model)
        threading.Thread(target=time.sleep, args=(1000.0,)).start()


class Holds(Still):
    """Its port can be had by one program at a time, as a serial line."""

    def __init__(self, model: cohelm.RobotModel, port: int) -> None:
        super().__init__(model)
        self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.port.bind(("127.0.0.1", port))
        self.reads = 0


class ReadHangs(Holds):
    def read(self) -> cohelm.Readings:
        self.reads += 1
        if self.reads > 5:
            time.sleep(1000.0)
        return super().read()


class ReadForks(Holds):
    """A child that stays, and one that goes on with what its parent does."""

    def read(self) -> cohelm.Readings:
        self.reads += 1
        if self.reads == 5 and not os.fork():
            time.sleep(1000.0)
        if self.reads == 6:
            os.fork()
        return super().read()


def hurried(made: AdaptedMaker) -> RobotPort:
    """A driver that hangs is waited for less long in its gate process."""
    serve.CLOSING = 0.5
    return made()


@pytest.fixture
def port() -> int:
    """One that is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def held(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return True
        return False


def until(true) -> None:
    for _ in looks(WITHIN, 0.05, 0.2):
        if true():
            return
    raise AssertionError("it did not come about")


def group(leader: int) -> list[int]:
    """The processes of a group that run."""
    found = []
    for one in [int(path.name) for path in Path("/proc").glob("[0-9]*")]:
        with contextlib.suppress(OSError):
            if os.getpgid(one) == leader and alive(one):
                found.append(one)
    return found


@pytest.mark.parametrize(
    ("make", "how"),
    first([
        (ReadHangs, "closed"), (ReadForks, "the loop is killed"),
        (ReadHangs, "the gate process is killed"), (ReadForks, "closed"),
        (ReadHangs, "the loop is killed"), (ReadForks, "the gate process is killed"),
    ], 3),
)  # fmt: skip
def test_the_hardware_is_free_again_whatever_a_read_has_done(make, how, port, monkeypatch):
    if how == "closed":
        monkeypatch.setattr(process, "_ANSWER", 1.0)
    made = AdaptedMaker(functools.partial(make, port=port), sally())
    made = functools.partial(hurried, made)
    gated = RemoteGatedRobot(made, rules(sally(), 0.02))
    assert held(port)
    time.sleep(0.5)  # it reads by itself
    if make is ReadForks:  # and is driven by one process all the same
        until(lambda: len(group(gated.pid)) == 2)  # itself, and the child that stays
        for _ in range(20):
            gated.read()
        assert len(group(gated.pid)) == 2
    if how == "the loop is killed":
        gated._line.close()
    else:
        if how == "the gate process is killed":
            os.kill(gated.pid, signal.SIGKILL)
        if make is ReadHangs:  # nothing answers
            gated._within = 0.2
        gated.close()
    until(lambda: not held(port))
    until(lambda: not alive(gated.pid))


class Unmade(Holds):
    """It has started what holds its port, and finds no robot there."""

    def __init__(self, model: cohelm.RobotModel, port: int) -> None:
        super().__init__(model, port)
        if not os.fork():
            time.sleep(1000.0)
        raise ConnectionError("no robot there")


def test_the_hardware_is_free_again_where_the_robot_can_not_be_made(port):
    made = AdaptedMaker(functools.partial(Unmade, port=port), sally())
    with pytest.raises(CohelmError, match="no robot there"):
        RemoteGatedRobot(made, rules(sally(), 0.02))
    until(lambda: not held(port))


def ended(gated: RemoteGatedRobot) -> bool:
    """Whether the gate process does."""
    return any(not alive(gated.pid) for _ in looks(WITHIN, 0.05, 0.2))


@pytest.mark.parametrize("make", first([Hangs, Threaded]))
def test_no_driver_keeps_the_gate_process_alive(make, capfd):
    made = AdaptedMaker(make, sally())
    if make is Hangs:  # the other one is waited for as long as drivers are
        made = functools.partial(hurried, made)
    gated = RemoteGatedRobot(made, rules(sally(), 0.02))
    gated.close()
    assert ended(gated)
    assert LINGERS in capfd.readouterr().err


def test_a_gate_process_that_was_stopped_says_so_and_is_continued_to_end():
    gated = RemoteGatedRobot(AdaptedMaker(Still, sally()), rules(sally(), 0.02))
    gated._within = 0.2
    os.kill(gated.pid, signal.SIGSTOP)
    with pytest.raises(CohelmError, match=r"it was stopped \(SIGSTOP\), and is continued"):
        gated.read()
    gated.close()
    assert not alive(gated.pid)


class Waits(Still):
    """One of its calls never returns."""

    def __init__(self, model: cohelm.RobotModel, call: str) -> None:
        super().__init__(model)
        self.call, self.calls = call, 0

    def waits(self, call: str) -> None:
        self.calls += call == self.call
        if self.calls > 3:
            time.sleep(1000.0)

    def read(self) -> cohelm.Readings:
        self.waits("read")
        return super().read()

    def send(self, twist: cohelm.Twist) -> None:
        self.waits("send")


@pytest.mark.parametrize("call", first(["send", "read"]))
def test_the_call_in_which_a_driver_hangs_is_named(call, monkeypatch):
    """Whatever the loop asked for: the gate process reads and sends by itself too."""
    monkeypatch.setattr(process, "_ANSWER", 1.0)
    with pytest.raises(CohelmError, match=f"answer: {call} of the robot's driver waits; the robot"):
        driven(AdaptedMaker(functools.partial(Waits, call=call), sally()), kills=True)


class WaitsAtOnce(Still):
    """In its constructor, and in the first read."""

    def __init__(self, model: cohelm.RobotModel) -> None:
        time.sleep(0.5)
        super().__init__(model)
        self.reads = 0

    def read(self) -> cohelm.Readings:
        self.reads += 1
        if self.reads == 1:
            time.sleep(0.5)
        return super().read()


def impatient() -> RobotPort:
    waiting.WAITS = 0.1
    return AdaptedMaker(WaitsAtOnce, sally())()


@pytest.mark.slow  # what is told while nothing moves yet
def test_a_driver_that_waits_at_the_start_is_named_meanwhile(capfd):
    """It is not taken for compiling."""
    RemoteGatedRobot(impatient, rules(sally(), 0.02)).close()
    said = capfd.readouterr().err
    assert said.count("has not returned") == 2
    for call in ("the constructor", "read"):
        assert f"{call} of the robot's driver has not returned for 0.1 s" in said


class Prints(Still):
    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model)
        print("made")
        subprocess.run(["echo", "from another process"], check=True)

    def read(self) -> cohelm.Readings:
        print("read")
        return super().read()


def test_what_a_driver_prints_is_no_result_of_the_command(capfd):
    """That of `--json` is exactly one object. A driver that lets go is not said to linger."""
    gated = RemoteGatedRobot(AdaptedMaker(Prints, sally()), rules(sally(), 0.02))
    gated.read()
    gated.close()
    assert ended(gated)
    said = capfd.readouterr()
    assert said.out == ""
    assert LINGERS not in said.err
    assert all(what in said.err for what in ("made", "from another process", "read"))


class Crashes(Still):
    """As a library in C does, or one that ends the process itself."""

    def __init__(self, model: cohelm.RobotModel, how: str, at: int) -> None:
        super().__init__(model)
        self.how, self.left = how, at
        self.fails()

    def fails(self) -> None:
        self.left -= 1
        if self.left < 0:
            os.kill(os.getpid(), signal.SIGSEGV) if self.how == "crashes" else os._exit(3)

    def read(self) -> cohelm.Readings:
        self.fails()
        return super().read()


def driven(made: AdaptedMaker, kills: bool = False) -> None:
    """kills: at last, as how one that hangs is closed is asked for above."""
    gated = RemoteGatedRobot(made, rules(sally(), 0.02))
    try:
        for _ in range(100):
            gated.read()
            time.sleep(0.02)
    finally:
        if kills:
            os.kill(gated.pid, signal.SIGKILL)
        gated.close()


@pytest.mark.parametrize(
    ("how", "said", "at"),
    first([
        ("crashes", "killed by SIGSEGV", 5), ("exits", "it exited with code 3", 0),
        ("crashes", "killed by SIGSEGV", 0), ("exits", "it exited with code 3", 5),
    ], 2),
)  # fmt: skip
def test_how_the_gate_process_has_ended_is_said(at, how, said):
    made = AdaptedMaker(functools.partial(Crashes, how=how, at=at), sally())
    then = (
        "; the robot must stop by its own"
        if at
        else f" while it made {__name__}:Crashes: run that alone"
    )
    with pytest.raises(CohelmError, match=rf"the gate process has ended \({said}\){then}"):
        driven(made)


def test_a_driver_that_only_the_gate_process_can_not_import_is_named(tmp_path, monkeypatch):
    """As one that opens the hardware when it is imported, which another process has by then."""
    once = "import cohelm, multiprocessing\nassert not multiprocessing.parent_process(), 'busy'\n"
    (tmp_path / "opens_once.py").write_text(f"{once}class Cart(cohelm.Robot): ...\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    made = AdaptedMaker(importlib.import_module("opens_once").Cart, sally())
    with pytest.raises(CohelmError, match=r"opens_once:Cart can not be imported by .*: busy"):
        RemoteGatedRobot(made, rules(sally(), 0.02))


@pytest.mark.slow  # few do
def test_a_driver_that_reads_the_terminal_is_told_no_and_stops_no_process():
    ours, theirs = pty.openpty()
    try:
        said = subprocess.run(
            [sys.executable, "-m", "tests.robot.keep.at_a_terminal"], stdin=theirs,
            capture_output=True, text=True, timeout=60.0, start_new_session=True, check=False,
        )  # fmt: skip
    finally:
        os.close(theirs)
        os.close(ours)
    assert "read failed: OSError: [Errno 5]" in said.stdout, said
