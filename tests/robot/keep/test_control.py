"""The control line: whole messages or none, and nobody waits. And the memory beside it."""

import os
import signal
import time

import numpy as np
import pytest

from cohelm.robot.keep.control_line import control
from cohelm.robot.keep.record_pipe import LARGEST
from cohelm.robot.keep.shared_memory import SharedMemory, shared
from cohelm.robot.port import Frame, Readings, Scan
from cohelm.robot.sensors import CameraModel
from cohelm.scenario.load import robot
from tests.robot.keep.robots import SALLY

PATIENT = 2.0  # so long nobody would be held up who does not wait [s]


@pytest.fixture
def ends():
    both = control()
    yield both
    for end in both:
        end.close()


def test_a_pipe_that_is_not_read_fills_up_without_blocking(ends):
    ours, theirs = ends
    begun = time.monotonic()
    said = [ours.send((number, "x" * 1000)) for number in range(3000)]
    assert time.monotonic() - begun < PATIENT
    assert said[0]
    assert not said[-1]
    heard = 0
    while theirs.wait(0.0):
        (number, text), _ = theirs.receive()
        assert number == heard  # whole, in order, none of those there was no room for
        assert len(text) == 1000
        heard += 1
    assert heard == said.count(True)
    assert ours.send("there is room again")


def test_no_message_is_longer_than_the_line_carries(ends):
    with pytest.raises(ValueError, match="too long for the control line"):
        ends[0].send(bytes(LARGEST))
    assert ends[0].send(bytes(LARGEST - 100))
    assert ends[1].receive() == (bytes(LARGEST - 100), None)


def test_no_half_of_a_message_is_waited_for(ends):
    """A process may be stopped anywhere, even in the call that sends."""
    ours, theirs = ends
    pid = os.fork()
    if pid == 0:  # a child that sends as fast as it can
        number = 0
        while True:
            number += ours.send((number, bytes(5000)))
    try:
        for k in range(200):
            if theirs.wait(0.01):
                theirs.receive()
            os.kill(pid, signal.SIGSTOP if k % 2 == 0 else signal.SIGCONT)
            begun = time.monotonic()
            while theirs.wait(0.0) and k % 2 == 0:
                message, _ = theirs.receive()
                assert len(message[1]) == 5000
            assert time.monotonic() - begun < PATIENT
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def test_the_death_of_the_other_end_is_reported_and_is_no_message(ends):
    ours, theirs = ends
    ours.close()
    assert theirs.wait(PATIENT)
    with pytest.raises((EOFError, OSError)):
        theirs.receive()
    with pytest.raises(OSError, match="Broken pipe"):
        theirs.send("anybody?")


def test_an_open_file_travels_with_a_message(ends, tmp_path):
    with (tmp_path / "file").open("w") as file:
        assert ends[0].send("write here", file.fileno())
    message, handle = ends[1].receive()
    assert message == "write here"
    os.write(handle, b"yes")
    os.close(handle)
    assert (tmp_path / "file").read_text() == "yes"


@pytest.fixture
def memory():
    camera = CameraModel(width=64, height=48)
    made = shared(SALLY.model_copy(update={"camera": camera}))
    yield made
    os.close(made.handle)


def seen(seed: int, beams: int = 720, height: int = 48) -> Readings:
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.1, 10.0, beams)
    ranges[:3] = np.inf, -np.inf, np.nan
    pixels = rng.integers(0, 256, (height, 64, 3), dtype=np.uint8)
    return Readings(None, Scan(1.0, seed, ranges, 0.1), Frame(2.0, seed, pixels), None)


def test_scans_and_frames_come_out_as_they_went_in_and_stay(memory):
    other = SharedMemory(os.dup(memory.handle), memory.scans, memory.frame)
    first = other.take(memory.put(seen(1)))
    second = other.take(memory.put(seen(2)))
    for seed, had in ((1, first), (2, second)):
        given = seen(seed)
        np.testing.assert_array_equal(had.scan.ranges, given.scan.ranges)
        np.testing.assert_array_equal(had.frame.pixels, given.frame.pixels)
        assert had.scan[:2] == given.scan[:2]
        assert not had.scan.ranges.flags.writeable
        assert not had.frame.pixels.flags.writeable
    os.close(other.handle)


@pytest.mark.parametrize(("beams", "height"), [(721, 48), (720, 49)])
def test_what_is_larger_than_the_robot_says_is_left_out_and_overwrites_nothing(
    memory, beams, height
):
    fits = memory.put(seen(1))
    put = memory.put(seen(2, beams, height))
    assert (put.scan is None) == (beams > 720)
    assert (put.frame is None) == (height > 48)
    if put.scan is None:
        np.testing.assert_array_equal(memory.take(fits).scan.ranges, seen(1).scan.ranges)
    else:
        np.testing.assert_array_equal(memory.take(fits).frame.pixels, seen(1).frame.pixels)


def test_nothing_new_takes_no_room(memory):
    nothing = Readings(None, None, None, None)
    assert memory.put(nothing) == nothing
    assert memory.take(nothing) == nothing


def test_scans_of_further_lidars_come_out_as_they_went_in():
    memory = shared(robot("sally-rear"))
    rear = seen(4).scan._replace(sensor="rear")
    given = seen(3)._replace(frame=None, further=(rear,))
    had = memory.take(memory.put(given))
    np.testing.assert_array_equal(had.scan.ranges, given.scan.ranges)
    np.testing.assert_array_equal(had.further[0].ranges, rear.ranges)
    assert (had.further[0].sensor, had.further[0].number) == ("rear", 4)
    stranger = given._replace(further=(rear._replace(sensor="left"),))
    assert memory.take(memory.put(stranger)).further == ()
    os.close(memory.handle)
