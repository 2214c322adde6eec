"""Real processes, killed, stopped and starved: the robot stops in time, and the record says why.

What the robot did is read from the record: the gate process and the recorder outlive the loop.
"""

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cohelm.link import keys
from cohelm.loop.stick import BACK_WITHIN
from cohelm.record.messages import messages
from tests.drive.faults import CORRIDOR, FAULTS, JUMPS, NOTICED

pytestmark = pytest.mark.xdist_group("realtime")

LATE = 0.5
"""What a loop among many busy processes may be later than in simulated time, which the tests of
`test_losing` hold to; later than that its watchdog would have said something else [s]."""
STARTED = 3600.0
"""With nothing compiled and next to no processor time left by others [s]: 23 minutes were seen.
It compiles before it drives; no test counts it."""
LOGGED = 60.0
"""The recorder comes after all others: on a busy machine what the loop had said was written four
seconds later than what the gate had [s]. All is stamped when it happens."""


class Drive:
    """`cohelm robot` on the corridor in a process of its own; or with a sensor that breaks."""

    def __init__(self, folder: Path, *more: str, breaks: str = "") -> None:
        self.record = folder / "drive.mcap"
        self.log = folder / "drive.log"
        self.now = folder / "now"
        """The sensor breaks once this file is there, and writes into it when that was."""
        command = [sys.executable, "-m", "cohelm", "robot", str(CORRIDOR), "--json"]
        command += ["--record", str(self.record), *more]
        if breaks:
            command = [sys.executable, "-m", "tests.drive.broken", breaks]
            command += [str(self.now), str(self.record)]

        def before() -> None:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where pytest is under nohup

        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=before, start_new_session=True,
        )  # fmt: skip

    def said(self, pattern: str, within: float) -> re.Match[str]:
        """Wait until the log says so."""
        end = time.monotonic() + within
        text = ""
        while time.monotonic() < end:
            text = self.log.read_text() if self.log.exists() else ""
            found = re.search(pattern, text)
            if found:
                return found
            if self.process.poll() is not None and end - time.monotonic() > 8.0:
                end = time.monotonic() + 8.0  # the others may still write
            time.sleep(0.05)
        raise AssertionError(f"the log never says {pattern!r}:\n{text}")

    def driving(self) -> None:
        """Wait until it has driven for two seconds."""
        self.said("IDLE -> AUTOMATIC", STARTED)
        time.sleep(2.0)

    def ended(self) -> tuple[dict, str]:
        """Wait for its end; what it printed, and the log."""
        out, err = self.process.communicate(timeout=STARTED)
        assert out, err
        return json.loads(out), self.log.read_text()

    def stopped(self, why: str) -> float:
        """How long after its latched stop the robot stood."""
        self.said(f"AUTOMATIC -> (FAULTED|STOPPED): {why}", LOGGED)
        return float(self.said(r"stands, (\d+\.\d+) s after", LOGGED)[1])


@pytest.fixture
def drive(tmp_path):
    made = []

    def start(*more: str, folder: Path = tmp_path, breaks: str = "") -> Drive:
        made.append(Drive(folder, *more, breaks=breaks))
        return made[-1]

    yield start
    for one in made:
        if one.process.poll() is None:
            one.process.send_signal(signal.SIGCONT)
            one.process.kill()
        one.process.wait()
        for pipe in (one.process.stdout, one.process.stderr):
            pipe.close()


BRAKED = 0.6
"""From 0.5 m/s at 2 m/s^2, after the robot's 50 ms, shown by 50 Hz odometry [s]."""


def braked_in_time(took: float) -> None:
    assert 0.05 < took < BRAKED


def test_a_killed_loop_does_not_leave_the_robot_moving(drive):
    going = drive()
    going.driving()
    going.process.kill()
    braked_in_time(going.stopped("(the loop's process has ended|no valid command)"))
    end = time.monotonic() + 15.0
    while (going.record.with_suffix(".reserve")).exists():  # removed when the record is finished
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.slow
def test_a_blocked_loop_makes_the_robot_stop_before_it_continues(drive):
    going = drive("--for", "8")
    going.driving()
    going.process.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    braked_in_time(going.stopped("no valid command for more than 100 ms"))
    going.process.send_signal(signal.SIGCONT)
    summary, log = going.ended()
    assert summary["mode"] == "FAULTED"
    assert summary["overruns"] >= 1
    assert summary["late_worst"] > 0.7
    assert going.process.returncode == 1
    assert log.count("-> AUTOMATIC") == 1  # it never started again by itself


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (signal.SIGINT, "Ctrl-C"),
        (signal.SIGHUP, "the terminal was closed"),
        (signal.SIGTERM, "received SIGTERM"),
    ],
)
def test_a_signal_to_all_processes_stops_the_robot_first(drive, number, reason):
    going = drive()
    going.driving()
    os.killpg(going.process.pid, number)  # as a terminal does, or systemd
    braked_in_time(going.stopped(reason))
    summary, _ = going.ended()
    assert going.process.returncode == 0
    assert summary["reason"] == reason
    assert going.record.read_bytes().endswith(b"\x89MCAP0\r\n")


@pytest.mark.slow
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_sensor_that_breaks_stops_the_robot_and_is_named_in_the_record(drive, fault):
    going = drive(breaks=fault)
    going.driving()
    going.now.touch()
    summary, log = going.ended()
    latched = re.search(r"(\d+\.\d+) ! gate: AUTOMATIC -> FAULTED", log)
    assert latched, log
    noticed = float(latched[1]) - JUMPS.get(fault, 0.0) - float(going.now.read_text())
    assert -0.001 < noticed < NOTICED.get(fault, 0.04) + LATE
    assert summary["stood_after_s"] < BRAKED
    assert summary["mode"] == "FAULTED"
    assert log.count("-> AUTOMATIC") == 1
    # where the clock jumps on, the watchdog barks at once, and the loop alone says why
    who = "loop" if fault == "clock jumps on" else "gate"
    said = [m.msg for _, _, m in messages(going.record, ("/rosout",)) if m.name == who]
    assert any(FAULTS[fault] in line for line in said)


@pytest.mark.slow
def test_when_the_driver_s_process_is_killed_the_robot_stops(drive, tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    keys.pair("killed", tmp_path / "killed.pair")
    keys.install(tmp_path / "killed.pair")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    going = drive("--listen", f"127.0.0.1:{port}")
    driver = subprocess.Popen([sys.executable, "-m", "tests.drive.steers", port])
    try:
        going.said("IDLE -> SHARED", STARTED)
        time.sleep(1.0)
    finally:
        driver.kill()
        driver.wait()
    lost = r"the (?:stick|driver) is lost: no command for (\d+) ms"
    latched = going.said(rf"(\d+\.\d+) ! gate: SHARED -> STOPPED: {lost}", LOGGED)
    silent = going.said(rf"(\d+\.\d+) +loop: stands: [^\n]*for {latched[2]} ms", LOGGED)
    stood = going.said(r"(\d+\.\d+) +gate: stands, \d+\.\d+ s after", LOGGED)
    assert 250 <= int(latched[2]) < 260 + 1000.0 * LATE
    assert float(latched[1]) - float(silent[1]) < BACK_WITHIN + LATE
    assert float(stood[1]) - float(latched[1]) < 0.1  # it had braked before
    going.process.send_signal(signal.SIGINT)
    summary, _ = going.ended()
    assert summary["least_clearance_moving_m"] > 0.1


@pytest.mark.slow
def test_a_full_disk_stops_the_record_but_not_the_robot(drive):
    going = drive("--for", "8")
    going.said("IDLE -> AUTOMATIC", STARTED)
    limit = going.record.stat().st_size + 30_000
    recorder = child(going.process.pid, "recorder")  # alone: no other writes to the disk
    resource.prlimit(recorder, resource.RLIMIT_FSIZE, (limit, limit))
    summary, log = going.ended()
    assert "recording stopped: File too large" in log
    assert summary["reason"] == "the drive is over"
    assert "AUTOMATIC -> STOPPED: the drive is over" in log  # the log still grows
    assert going.record.stat().st_size <= limit


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a tiny file system needs root")
def test_the_stop_reason_is_recorded_though_the_file_system_is_full(drive, tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        summary, log = drive("--for", "12", folder=small).ended()
        assert "recording stopped: No space left on device" in log
        assert "AUTOMATIC -> STOPPED: the drive is over" in log
        assert summary["reason"] == "the drive is over"
    finally:
        subprocess.run(["umount", str(small)], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("who", ["recorder", "planner"])
def test_the_loop_continues_without_planner_and_recorder(drive, who):
    going = drive("--for", "6")
    going.driving()
    os.kill(child(going.process.pid, who), signal.SIGKILL)
    if who == "planner":
        going.said("the path planner has ended", 10.0)
    out, _ = going.process.communicate(timeout=STARTED)
    summary = json.loads(out)
    assert summary["reason"] == "the drive is over"
    assert summary["mode"] == "STOPPED"


@pytest.mark.slow
def test_a_killed_gate_ends_the_loop_with_one_sentence(drive):
    """The robot itself stops by its own time-out, as the port says; the simulated one is gone."""
    going = drive()
    going.driving()
    os.kill(child(going.process.pid, "gate"), signal.SIGKILL)
    _, err = going.process.communicate(timeout=STARTED)
    assert going.process.returncode == 2
    assert "the gate process has ended" in err


def child(parent: int, who: str) -> int:
    """The process that `cohelm robot` started for this, told by what each has open or runs."""
    for status in Path("/proc").glob("[0-9]*/status"):
        text = status.read_text()
        if f"PPid:\t{parent}\n" in text and f"Name:\tcohelm {who}"[:21] in text:
            return int(status.parent.name)
    raise AssertionError(f"there is no {who}")
