"""`cohelm drive` as its user meets it: a stick joins it, and when its robot dies it says so."""

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.link.lent import borrowed
from cohelm.link.messages import Device, Mode
from cohelm.link.station_end import StationEnd
from cohelm.link.sticks.at_helm import drive as at_helm
from cohelm.link.sticks.port import CENTRED, Button, Feel, Reading
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
        self.process = subprocess.Popen(
            [*command, "--port", "0"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, env=os.environ | {"NO_COLOR": "1"},
        )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self.said = ""
        self._reader = threading.Thread(target=self._read, args=(self.process.stderr,))
        self._reader.start()
        until(lambda: "Ctrl-C ends" in self.said or self.process.poll() is not None, STARTED)
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

    name, kind, force = "hand", Device.SCRIPT, False

    def __init__(self) -> None:
        self.stick, self.there = CENTRED, True
        self.buttons: list[Button] = []

    def read(self) -> Reading:
        pressed, self.buttons = tuple(self.buttons), []
        return Reading(self.stick, self.there, "" if self.there else "let go", pressed)

    def feel(self, feel: Feel) -> None:
        pass

    def close(self) -> None:
        pass


def test_a_stick_of_this_machine_joins_drives_and_its_loss_stops_the_robot(drive):
    assert "cohelm stick --drive" in drive.said
    own, to = borrowed()
    hand, said = Hand(), []
    with StationEnd(own, *to) as watching:
        stick = threading.Thread(target=at_helm, args=(hand, own, to, 5.0, said.append))
        stick.start()
        try:
            until(watching.status, PATIENT)
            told = lambda: watching.status().status  # noqa: E731
            until(lambda: "you drive" in said and told().arming == 2, PATIENT)
            assert told().lease.driver_name == "stick"
            hand.buttons = [Button.MODE]
            until(lambda: told().mode == Mode.SHARED, PATIENT)
            hand.stick = Stick(-0.8, 0.0)
            until(lambda: told().twist.v < -0.05, PATIENT)
        finally:
            hand.there = False
            stick.join(PATIENT)
        until(lambda: "stick" in told().stopped and abs(told().twist.v) < 0.01, PATIENT)


def test_when_its_robot_dies_it_says_so_and_ends(drive):
    os.kill(drive.robot(), signal.SIGKILL)
    assert drive.process.wait(PATIENT) == 2
    drive.close()
    last = drive.said.strip().splitlines()[-1]
    assert re.match("error: the robot's process has ended: killed by SIGKILL", last)
    with pytest.raises(CohelmError, match="no `cohelm drive` runs"):
        borrowed()
