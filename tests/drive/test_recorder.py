"""The recorder process keeps every message it received."""

import multiprocessing
import os
import resource
import select
import signal
import time

import pytest

from cohelm.core.errors import CohelmError
from cohelm.drive.recorder import Recording
from cohelm.record.messages import messages
from cohelm.robot.keep.record_pipe import Event, RecordLine
from tests.robot.keep.robots import SALLY


@pytest.fixture
def recording(tmp_path):
    made = Recording(tmp_path / "drive.mcap", SALLY)
    made.begin(0)
    made.keep()
    yield made
    if made._process.is_alive():
        os.kill(made.pid, signal.SIGCONT)
    made.close()


def working(line: RecordLine) -> None:
    """Wait until the recorder's process is at work."""
    end = time.monotonic() + 60.0
    while line._alive > time.monotonic():
        assert time.monotonic() < end
        line.received()
        time.sleep(0.05)


def test_no_record_message_is_lost_when_its_sender_ends(recording):
    """As a killed loop does: signs of life lie unread in its end of the line."""
    line = RecordLine(recording.loop)
    working(line)
    assert select.select([recording.loop], [], [], 60.0)[0]  # one sign more
    for k in range(200):
        line(Event(k / 50.0, "loop", f"event {k}"))
    assert line.dropped == 0
    assert recording.close()
    log = recording.path.with_suffix(".log").read_text()
    assert "event 0\n" in log
    assert "event 199\n" in log
    assert sum(1 for _ in messages(recording.path, ("/rosout",))) == 200


def test_a_recorder_that_hangs_blocks_nothing_and_ends_with_the_drive(recording):
    line = RecordLine(recording.loop)
    working(line)
    os.kill(recording.pid, signal.SIGSTOP)
    begun = time.monotonic()
    for k in range(20_000):
        line(Event(k / 50.0, "loop", f"event {k}"))
        assert line.received() is None
    assert time.monotonic() - begun < 5.0
    assert line.dropped > 0
    assert not line.broken
    assert not recording.close(within=0.5)
    assert recording._process not in multiprocessing.active_children()  # nobody waits for it


def test_a_disk_that_is_full_before_the_first_message_is_reported_and_the_log_grows(tmp_path):
    recording = Recording(tmp_path / "drive.mcap", SALLY, "a scenario\n" * 10_000)
    limit = 4000
    resource.prlimit(recording.pid, resource.RLIMIT_FSIZE, (limit, limit))
    recording.begin(0)
    recording.keep()
    line = RecordLine(recording.loop)
    line(Event(1.0, "loop", "an event"))
    end = time.monotonic() + 60.0
    while (said := line.received()) is None:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert said == "recording stopped: File too large"
    assert not recording.close()
    log = recording.path.with_suffix(".log").read_text()
    assert "an event" in log
    assert said in log


def test_a_record_is_a_file_and_no_folder(tmp_path):
    with pytest.raises(CohelmError, match="is a folder: name a file in it"):
        Recording(tmp_path, SALLY)


def test_a_drive_that_ended_while_its_robot_started_leaves_its_names_free(tmp_path):
    path = tmp_path / "drive.mcap"
    assert Recording(path, SALLY).close()
    assert list(tmp_path.iterdir()) == []


def test_a_start_that_ended_after_the_robot_had_sent_something_leaves_its_names_free(tmp_path):
    """As by Ctrl-C, which kills the loop's process while it starts, or by a start that fails."""
    recording = Recording(tmp_path / "drive.mcap", SALLY)
    recording.begin(0)
    RecordLine(recording.loop)(Event(1.0, "gate", "it stands"))
    assert recording.close()
    assert list(tmp_path.iterdir()) == []


def test_a_record_that_another_made_meanwhile_is_left_as_it_is(tmp_path):
    recording = Recording(tmp_path / "drive.mcap", SALLY)
    recording.path.write_text("of another drive")
    recording.begin(0)
    recording.keep()
    line = RecordLine(recording.loop)
    while (said := line.received()) is None and not line.broken:
        time.sleep(0.05)
    assert said == "recording stopped: File exists"
    assert not recording.close()
    assert recording.path.read_text() == "of another drive"
