"""`cohelm drive`: a local stick joins, and the end of the robot process is reported."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Stick
from cohelm.link.local_credentials import credentials_of_drive
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.station_end import StationEnd
from cohelm.link.sticks.port import Feel, Reading
from cohelm.link.sticks.stick_client import drive as at_helm
from cohelm.record.messages import messages
from cohelm.station.app import pages
from tests.drive.faults import CORRIDOR
from tests.link.ends import until

pytestmark = pytest.mark.xdist_group("realtime")
STARTED = 240.0  # with nothing compiled, on a busy machine [s]
PATIENT = 30.0


class Drive:
    """The command, in a process of its own; what it says is kept."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "cohelm", "drive", str(CORRIDOR), "--kinematic"]
        self.folder = folder
        self.process = subprocess.Popen(
            [*command, "--port", "0"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, env=os.environ | {"NO_COLOR": "1"},
        )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self.said = ""
        self._reader = threading.Thread(target=self._read, args=(self.process.stderr,))
        self._reader.start()
        until(lambda: "robot is ready" in self.said or self.process.poll() is not None, STARTED)
        self.address = self.process.stdout.readline().strip()

    def _read(self, stream) -> None:
        for line in stream:
            self.said += line

    def robot(self) -> int:
        """The robot's process."""
        for status in Path("/proc").glob("[0-9]*/status"):
            try:
                text = status.read_text()
                command = (status.parent / "cmdline").read_bytes()
            except OSError:
                continue
            if f"PPid:\t{self.process.pid}\n" in text and b"spawn_main" in command:
                return int(status.parent.name)
        raise AssertionError("there is no robot")

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait(60.0)
        self._reader.join()
        self.process.stdout.close()
        self.process.stderr.close()


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """One for all tests; the last one ends it."""
    try:
        pages()
    except CohelmError as error:
        pytest.skip(str(error))
    folder = tmp_path_factory.mktemp("drive")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COHELM_KEYS", str(folder / "keys"))
        made = Drive(folder)
        yield made
        made.close()


class Hand:
    """A stick that a test holds."""

    name, kind, force, repeats = "hand", Device.SCRIPT, False, False

    def __init__(self) -> None:
        self.stick, self.there = CENTRED, True

    def read(self) -> Reading:
        return Reading(self.stick, self.there, "" if self.there else "let go", ())

    def feel(self, feel: Feel) -> None:
        pass

    def close(self) -> None:
        pass


def test_a_local_stick_joins_the_drive_and_takes_the_lease(drive):
    assert "cohelm stick --drive" in drive.said
    own, to = credentials_of_drive()
    hand, said = Hand(), []
    with StationEnd(own, *to) as watching:
        stick = threading.Thread(target=at_helm, args=(hand, own, to, 5.0, said.append))
        stick.start()
        try:
            until(watching.status, PATIENT)
            told = lambda: watching.status().message  # noqa: E731

            until(lambda: told().lease.driver_name == "stick", PATIENT)
            until(lambda: "you drive" in said, PATIENT)
            until(lambda: told().arming == Arming.ARMED, PATIENT)
            hand.stick = Stick(-0.8, 0.0)  # in hold, it must be centred before a mode uses it
            until(lambda: told().arming == Arming.WAITING, PATIENT)
            assert told().stick == CENTRED
            hand.stick = CENTRED
            until(lambda: told().arming == Arming.ARMED, PATIENT)
        finally:
            hand.there = False
            stick.join(PATIENT)
        until(lambda: told().arming == Arming.ABSENT, PATIENT)


@pytest.mark.slow
def test_a_record_started_at_rest_has_the_events_of_the_gate(drive):
    own, to = credentials_of_drive()
    with StationEnd(own, *to) as station:
        told = lambda: station.status().message  # noqa: E731
        steer = partial(station.steer, Command(CENTRED, True, True, Device.SCRIPT))

        def ask(what: RequestKind, value: int, done) -> None:
            """Again and again: on a busy machine it may come too late, or not be granted yet."""
            end = time.monotonic() + 2 * PATIENT
            while not done():
                assert time.monotonic() < end, what
                number = station.ask(what, value)
                until(lambda n=number: station.answer(n) or done(), PATIENT, steer)

        until(station.status, PATIENT)
        ask(RequestKind.TAKE, 0, lambda: told().lease.driver == told().lease.you)
        ask(RequestKind.RECORD, 1, lambda: told().recording)
        ask(
            RequestKind.MODE,
            Mode.AUTOMATIC,
            lambda: told().mode == Mode.AUTOMATIC or told().stopped,
        )
        ask(RequestKind.STOP, 0, lambda: told().stopped)
        logs = lambda: "".join(p.read_text() for p in drive.folder.glob("out/records/*.log"))  # noqa: E731
        until(lambda: "gate: stands, " in logs(), 2 * PATIENT, steer)  # the recorder starts slowly
        ask(RequestKind.RECORD, 0, lambda: not told().recording)
        until(lambda: list(drive.folder.glob("out/records/*.mcap")), 2 * PATIENT, steer)
    (record,) = drive.folder.glob("out/records/*.mcap")
    said = [m.msg for _, _, m in messages(record, ("/rosout",)) if m.name == "gate"]
    assert said[:2] == ["IDLE", "IDLE -> AUTOMATIC"]
    latched = [line for line in said if re.match("AUTOMATIC -> (STOPPED|FAULTED): .", line)]
    assert len(latched) == 1  # a stop, or on a very busy machine the watchdog
    assert [line for line in said[said.index(latched[0]) :] if line.startswith("stands, ")]


@pytest.mark.slow
def test_when_the_robot_process_dies_the_drive_reports_it_and_ends(drive):
    os.kill(drive.robot(), signal.SIGKILL)
    assert drive.process.wait(2 * PATIENT) == 2
    drive.close()
    last = drive.said.strip().splitlines()[-1]
    assert re.match("error: the robot's process has ended: killed by SIGKILL", last)
    with pytest.raises(CohelmError, match="no `cohelm drive` runs"):
        credentials_of_drive()
