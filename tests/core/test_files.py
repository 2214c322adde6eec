"""Nothing that a user names is waited for without end, nor read without bound."""

import os
import subprocess
import sys

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular, read_bytes
from cohelm.link import stick
from cohelm.record.messages import messages
from cohelm.record.read import read, read_record
from cohelm.scenario import load
from cohelm.scenario.worlds.file import contents
from cohelm.scenario.worlds.maps import read_map
from cohelm.study.mapping import drive

READERS = [
    lambda path: read_bytes(path, 100, "a note"),
    load.scenario,
    load.digest,
    stick.read,
    lambda path: contents(path, "a log"),
    read_map,
    read,
    lambda path: list(messages(path, ("/odom",))),
    drive,
]


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, reader):
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    with pytest.raises(CohelmError, match="a device or a pipe"):
        reader(pipe)


@pytest.mark.parametrize("reader", READERS)
def test_a_device_that_never_ends_is_refused(tmp_path, reader):
    link = tmp_path / "zero.yaml"
    link.symlink_to("/dev/zero")
    with pytest.raises(CohelmError, match="a device or a pipe"):
        reader(link)


def test_a_scenario_from_dev_zero_is_refused_by_the_command_within_little_memory():
    said = subprocess.run(
        (sys.executable, "-m", "cohelm", "run", "/dev/zero"), capture_output=True, text=True,
        timeout=60.0,
    )  # fmt: skip
    assert said.returncode == 2
    assert said.stderr.count("\n") == 1
    assert "a device or a pipe" in said.stderr


def test_files_above_the_size_limit_are_refused_and_files_at_the_limit_are_read(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"x" * 100)
    assert read_bytes(path, 100, "a note") == b"x" * 100
    with pytest.raises(CohelmError, match=r"larger than .*, which a note never is"):
        read_bytes(path, 99, "a note")


def test_a_missing_file_is_left_to_the_reader(tmp_path):
    check_regular(tmp_path / "nothing")
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "nothing", 1, "a note")


@pytest.mark.parametrize("reads", [load.load_robot, load.load_scenario, read_record])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, reads):
    loop = tmp_path / "loop.yaml"
    loop.symlink_to(loop)
    for name in ("x" * 5000, "a\0.yaml", loop):
        with pytest.raises(CohelmError, match="check"):
            reads(name)
