"""Ctrl-C is delayed while numba converts results, and is not reported as an error."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from cohelm.cli.app import interrupted
from cohelm.core.interrupts import INTERRUPTS
from cohelm.drive import robot_process
from tests.few import first


@pytest.fixture(autouse=True)
def handled():
    before = {s: signal.signal(s, interrupted) for s in (*INTERRUPTS, signal.SIGALRM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def frames_of(file: str) -> dict:
    """A function whose code is in this file: it is interrupted at once, and stays for a while."""
    names: dict = {"signal": signal, "time": time}
    source = """
def busy(seconds):
    end = time.monotonic() + seconds
    signal.raise_signal(signal.SIGINT)
    while time.monotonic() < end:
        sum(range(50))
"""
    exec(compile(source, file, "exec"), names)
    return names


def test_an_interrupt_in_our_own_code_is_raised_at_once():
    with pytest.raises(KeyboardInterrupt):
        interrupted(signal.SIGINT, sys._getframe())


@pytest.mark.parametrize("file", ["<string>", "/somewhere/site-packages/numba/core/serialize.py"])
def test_an_interrupt_inside_numba_is_delayed_and_never_lost(file):
    busy, done = frames_of(file)["busy"], False
    try:
        busy(0.1)
        done = True
        time.sleep(5.0)
    except KeyboardInterrupt:
        assert done
    else:
        pytest.fail("it was lost")


def test_an_interrupt_in_a_finalizer_is_delayed_and_not_lost_with_its_exception():
    """As in llvmlite's, at any moment of a collection of garbage."""
    done = []

    class Freed:
        def __del__(self) -> None:
            frames_of(__file__)["busy"](0.1)
            done.append(True)

    def freed() -> None:
        Freed()
        time.sleep(5.0)

    with pytest.raises(KeyboardInterrupt):
        freed()
    assert done


def test_an_interrupt_while_a_class_is_made_is_delayed_and_not_reported_as_another_error():
    """As at any moment of an import; Python 3.11 makes a RuntimeError of it."""
    done = []

    class Named:
        def __set_name__(self, owner: type, name: str) -> None:
            frames_of(__file__)["busy"](0.1)
            done.append(True)

    def made() -> None:
        type("Made", (), {"one": Named()})
        time.sleep(5.0)

    with pytest.raises(KeyboardInterrupt):
        made()
    assert done


def test_numbas_compiler_is_interrupted_at_once_but_for_what_llvm_calls_back():
    compiler: dict = {}
    source = "def run(passes):\n    passes()\ndef _raw_object_cache_notify(passes):\n    passes()"
    exec(compile(source, "/x/numba/core/compiler_machinery.py", "exec"), compiler)
    busy, done = frames_of("/x/numba/core/typeinfer.py")["busy"], []
    with pytest.raises(KeyboardInterrupt):
        compiler["run"](lambda: done.append(busy(0.1)))
    assert not done

    def called_back() -> None:
        compiler["_raw_object_cache_notify"](lambda: done.append(busy(0.1)))
        time.sleep(5.0)

    with pytest.raises(KeyboardInterrupt):
        called_back()
    assert done


PRESSED = """
import os, signal, sys
from cohelm.__main__ import main
def press(frame, event, what):
    name = frame.f_code.co_name if event == "call" else getattr(what, "__name__", "")
    if name == os.environ["PRESSED_IN"] and frame.f_code is not main.__code__ and patient():
        sys.setprofile(None)
        signal.raise_signal(signal.SIGINT)
def patient():
    return "cohelm.cli.app" in sys.modules and signal.getsignal(signal.SIGINT) != signal.SIG_DFL
sys.argv = ["cohelm", "--version"]
sys.setprofile(press)
main()
"""


def pressed_in(function: str, file: str) -> subprocess.CompletedProcess[str]:
    """`cohelm --version`, and Ctrl-C at the first call of a function, seen from code of a file."""
    source = f"exec(compile({PRESSED!r}, {file!r}, 'exec'))"
    return subprocess.run(
        [sys.executable, "-c", source], capture_output=True, text=True,
        env=os.environ | {"PRESSED_IN": function},
    )  # fmt: skip


@pytest.mark.parametrize(
    "function", first(["get_command", "flush", "get_params_from_function", "main"], 2)
)
def test_ctrl_c_never_prints_a_traceback(function):
    ran = pressed_in(function, "press.py")
    assert ran.returncode == 130
    assert "Traceback" not in ran.stderr, ran.stderr


def test_an_interrupt_delayed_beyond_the_command_is_dropped():
    ran = pressed_in("flush", "<string>")
    assert (ran.returncode, ran.stderr) == (0, "")


def test_few_modules_are_imported_before_ctrl_c_is_handled():
    source = (
        "import sys; old = {*sys.modules}; import cohelm.__main__; print(*{*sys.modules} - old)"
    )
    ran = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True)
    assert not {"typing", "importlib", "re", "numpy"} & {*ran.stdout.split()}


class Starting:
    """In place of the robot's process: it starts, until it is killed by what a person pressed."""

    pid, host, port, over = 0, "", 0, ""
    stopped = False

    def __init__(self, *_: object, **__: object) -> None:
        self.ready, self.killed = threading.Event(), threading.Event()

    def __enter__(self) -> "Starting":
        threading.Thread(target=self._press, args=(self.signals,)).start()
        return self

    def __exit__(self, *_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)  # once more, while it is stopped
        self.waiting()
        os.kill(os.getpid(), signal.SIGINT)  # and again, once it is said that this helps

    def kill(self) -> None:
        Starting.stopped = True

    def when_ready(self, then: object) -> None: ...

    def when_waiting(self, then) -> None:
        self.waiting = then

    def afterwards(self, then) -> None:
        def dies() -> None:
            self.killed.wait()
            self.over = "the robot's process ended before it was ready: killed by SIGINT"
            then()

        threading.Thread(target=dies).start()

    def _press(self, signals: tuple[signal.Signals, ...]) -> None:
        while "handle_exit" not in str(signal.getsignal(signal.SIGINT)):
            time.sleep(0.01)  # the page is not served yet
        for one in signals:
            os.kill(os.getpid(), one)
        self.killed.set()


@pytest.mark.parametrize(
    ("handler", "signals", "code"),
    [
        *((signal.default_int_handler, (one,), 130) for one in INTERRUPTS),
        (signal.SIG_IGN, (signal.SIGINT,), 0), (signal.SIG_IGN, (), 2),
    ],
)  # fmt: skip
def test_only_without_ctrl_c_is_the_end_of_a_starting_robot_an_error(
    cohelm, monkeypatch, handler, signals, code
):
    """The terminal sends it to the robot's process too. Ignored is it in the background."""
    signal.signal(signal.SIGINT, handler)
    for one in INTERRUPTS[1:]:
        signal.signal(one, signal.SIG_DFL)
    monkeypatch.setattr(Starting, "signals", signals, raising=False)
    monkeypatch.setattr(Starting, "stopped", False)
    monkeypatch.setattr(robot_process, "RobotProcess", Starting)
    said = cohelm("drive", "--kinematic", "--port", "0")
    assert said.code == code
    assert ("error:" in said.err) == (code == 2)
    assert "the station is closed" in said.err
    assert Starting.stopped
