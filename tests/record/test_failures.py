"""Failures while a record is written or read."""

import os
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, reduce
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cohelm.cli.app import interrupted
from cohelm.core.errors import CohelmError
from cohelm.core.trace import Trace
from cohelm.record import period
from cohelm.record.file import METADATA
from cohelm.record.messages import messages
from cohelm.record.read import IncompleteRecord, read
from cohelm.record.write import Recorder
from cohelm.sim.run import pieces
from tests.record.runs import bits, lab, parts, recorded, scene

ROOT = Path(__file__).parents[2]
SETUP = lab(duration=10.0)


@cache
def written() -> tuple[Trace, ...]:
    """The run in its pieces."""
    return tuple(pieces(SETUP))


@cache
def whole() -> Trace:
    return reduce(Trace.joined, written())


WRITER = """
import sys, time
from pathlib import Path
from cohelm.record.write import Recorder
from cohelm.sim.run import pieces
from tests.record.runs import lab, scene

setup = lab(duration=100.0)
with Recorder(Path(sys.argv[1]), scene(setup)) as recorder:
    for n, piece in enumerate(pieces(setup), 1):
        recorder.write(piece)
        print(n, flush=True)
        time.sleep(0.02)
"""


def is_beginning(part: Trace, whole: Trace) -> bool:
    """Whether `part` is the first steps of `whole`, to the last bit."""
    return bits(part) == bits(next(parts(whole, [len(part)])))


@contextmanager
def writing(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that writes a run, and has written five pieces already."""
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        for line in process.stdout:
            if line == "5\n":
                break
        else:
            pytest.fail(process.stderr.read())
        yield process


# While writing


@pytest.mark.slow  # below without another process; of the command: tests/e2e/test_process.py
def test_ctrl_c_leaves_a_finished_record(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with writing(path) as process:
        process.send_signal(signal.SIGINT)
        process.communicate()
    with pytest.warns(IncompleteRecord, match="stopped by KeyboardInterrupt"):
        trace = read(path)
    assert len(trace) >= 5 * 200
    assert len(trace) % 200 == 0
    with path.open("rb") as file:
        assert make_reader(file).get_summary() is not None


def _comes_now(*_: object) -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("comes", [_comes_now, interrupted], ids=["at once", "put off for numba"])
@pytest.mark.parametrize("after", [0.003, 0.011, 0.024, 0.038, 0.052, 0.067])
def test_ctrl_c_while_a_piece_is_written_leaves_that_piece_whole(
    tmp_path: Path, after: float, comes: Callable[[int, FrameType | None], None]
) -> None:
    path = tmp_path / "run.mcap"
    before = signal.signal(signal.SIGALRM, comes)
    try:
        with pytest.raises(KeyboardInterrupt), Recorder(path, scene(SETUP)) as recorder:  # noqa: PT012
            recorder.write(written()[0])
            signal.setitimer(signal.ITIMER_REAL, after)
            for piece in written()[1:5] * 200:
                recorder.write(piece)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    with pytest.warns(IncompleteRecord, match="stopped by KeyboardInterrupt"):
        trace = read(path)
    assert len(trace) % 200 == 0
    assert is_beginning(next(parts(trace, [200])), whole())


@pytest.mark.parametrize("exchange", [1, 2, 3, 4])
def test_ctrl_c_while_handlers_are_exchanged_keeps_the_former_handler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: int
) -> None:
    """One that was put off for numba comes as an alarm, and may raise between any two lines."""
    exchanged = 0

    def comes(kind: signal.Signals, handler: Any, real: Any = signal.signal) -> Any:
        nonlocal exchanged
        exchanged += 1
        if exchanged == exchange:
            raise KeyboardInterrupt
        return real(kind, handler)

    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path / "run.mcap") as recorder:  # noqa: PT012
        monkeypatch.setattr(signal, "signal", comes)
        recorder.write(written()[0])
    monkeypatch.undo()
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_an_error_in_the_run_leaves_a_finished_record(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with pytest.raises(ZeroDivisionError), Recorder(path) as recorder:  # noqa: PT012
        recorder.write(written()[0])
        _ = 1 / 0
    with pytest.warns(IncompleteRecord, match="stopped by ZeroDivisionError"):
        assert bits(read(path)) == bits(written()[0])


def test_each_piece_is_in_the_file_before_the_next_is_driven(tmp_path: Path) -> None:
    """So that of a run that is killed all is read up to its last piece."""
    path, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    with Recorder(path, scene(SETUP)) as recorder:
        for n, piece in enumerate(written()[:3], 1):
            recorder.write(piece)
            cut.write_bytes(path.read_bytes())  # what another process finds there
            with pytest.warns(IncompleteRecord, match="ends too early"):
                trace = read(cut)
            assert len(trace) == 200 * n
            assert is_beginning(trace, whole())


@pytest.mark.slow  # what is there by then: above
def test_a_killed_run_is_read_up_to_its_last_piece(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with writing(path) as process:
        process.kill()
    with pytest.warns(IncompleteRecord, match="ends too early"):
        trace = read(path)
    assert len(trace) >= 5 * 200


def test_a_full_disk_is_reported_and_the_rest_is_readable(tmp_path: Path) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("a small disk can only be made by root")
    path = tmp_path / "run.mcap"
    try:
        with pytest.raises(CohelmError, match=r"run\.mcap: .*No space left.*free some space"):
            _record_for_ever(path)
        _assert_beginning_is_there(path)
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_file_at_its_size_limit_is_reported_and_the_rest_is_readable(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    written()  # compiled code is cached in files that must be allowed to grow
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))
    try:
        with pytest.raises(CohelmError, match=r"run\.mcap: .*File too large.*another folder"):
            _record_for_ever(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    _assert_beginning_is_there(path)


def _record_for_ever(path: Path) -> None:
    with Recorder(path, scene(SETUP)) as recorder:
        for _ in range(1000):
            for piece in written():
                recorder.write(piece)


def _assert_beginning_is_there(path: Path) -> None:
    with pytest.warns(IncompleteRecord):
        trace = read(path)
    assert len(trace) >= 200
    assert is_beginning(next(parts(trace, [200])), whole())


def test_a_disk_full_from_the_start_leaves_no_file(tmp_path: Path) -> None:
    written()  # compiled code is cached in files that must be allowed to grow
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(CohelmError, match="File too large"):
            _record_for_ever(tmp_path / "run.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_a_step_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path / "run.mcap"):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    with pytest.raises(CohelmError, match=r"run\.mcap exists and is never overwritten"):
        Recorder(path)
    assert path.read_text() == "precious"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(CohelmError, match=r"the folder .*nowhere does not exist: make it"):
        Recorder(tmp_path / "nowhere" / "run.mcap")


def test_a_read_only_folder_is_reported(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # root may write anywhere
    try:
        with pytest.raises(CohelmError, match=r"run\.mcap can not be made \(Permission denied\)"):
            Recorder(tmp_path / "run.mcap")
    finally:
        if root:
            os.seteuid(0)
        tmp_path.chmod(0o700)


# While reading


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("record") / "run.mcap"
    recorded(path, SETUP)
    return path.read_bytes()


def _read_bytes(path: Path, data: bytes) -> tuple[Trace | None, bool]:
    """The trace in these bytes, if any, and whether something was said about it."""
    path.write_bytes(data)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            trace = read(path)
        except CohelmError:
            return None, True
    assert all(issubclass(w.category, IncompleteRecord) for w in said)
    return trace, bool(said)


@given(part=st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=15)
def test_a_record_cut_off_anywhere_gives_the_whole_pieces_before(
    record: bytes, tmp_path_factory: pytest.TempPathFactory, part: float
) -> None:
    cut = int(part * len(record))
    trace, told = _read_bytes(tmp_path_factory.getbasetemp() / "cut.mcap", record[:cut])
    if trace is None:
        assert cut < 0.3 * len(record)  # not even the first of six pieces
    else:
        assert is_beginning(trace, whole())
        assert len(trace) == len(whole()) or (told and len(trace) % 200 == 0)


@given(part=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
@settings(deadline=None, max_examples=15)
def test_a_changed_byte_is_always_detected(
    record: bytes, tmp_path_factory: pytest.TempPathFactory, part: float, flip: int
) -> None:
    data = bytearray(record)
    data[int(part * len(record))] ^= flip
    trace, told = _read_bytes(tmp_path_factory.getbasetemp() / "changed.mcap", bytes(data))
    assert told or (trace is not None and bits(trace) == bits(whole()))


def test_a_missing_record_is_reported(tmp_path: Path) -> None:
    with pytest.raises(CohelmError, match=r"nothing\.mcap can not be read \(No such file"):
        read(tmp_path / "nothing.mcap")


@pytest.mark.parametrize("content", [b"time,x,y\n0.0,0.0,0.0\n", b"\x89PNG\r\n\x1a\n" * 5])
def test_a_file_of_another_kind_is_reported(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    with pytest.raises(CohelmError, match=r"run\.csv is not an MCAP file"):
        read(path)


@pytest.mark.parametrize("content", [b"", b"\x89MC", b"\x89MCAP0\r\n"])
def test_a_record_without_data_is_reported(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(CohelmError, match=r"run\.mcap is no record of cohelm: give"):
        read(path)


def test_a_record_of_another_program_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="their robot 3")
        schema = writer.register_schema("std_msgs/msg/Bool", "ros2msg", b"bool data\n")
        channel = writer.register_channel("/period", "cdr", schema)
        writer.add_message(channel, time.time_ns(), b"\x00\x01\x00\x00\x01", 0)
        writer.finish()
    with pytest.raises(CohelmError, match=r"no record of cohelm \(it was written by their"):
        read(path)


def test_a_topic_without_a_definition_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/odom", "cdr", 0)  # no schema
        writer.add_message(channel, time.time_ns(), b"\x00\x01\x00\x00\x01", 0)
        writer.finish()
    with pytest.raises(CohelmError, match="/odom in it has no definition"):
        list(messages(path, ("/odom",)))


def encoded(piece: Trace) -> list[bytes]:
    """Every step as one serialised message."""
    said = zip(piece.rows.tolist(), piece.h, piece.discs, strict=True)
    return [bytes(period.STORE.serialize_cdr(period.message(*one), period.TYPE)) for one in said]


def _write_by_hand(path: Path, about: dict[str, str], definition: str, steps: list[bytes]) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="cohelm")
        given = {"kind": "run", "version": "9.9", "period_version": str(period.VERSION)}
        given |= {"dt": "0.01", "obstacles": "[]", "epoch_ns": "0"}
        writer.add_metadata(METADATA, given | about)
        schema = writer.register_schema(period.TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel(period.TOPIC, "cdr", schema)
        for k, step in enumerate(steps):
            writer.add_message(channel, k, step, k, sequence=k)
        writer.finish()


def test_a_record_of_a_newer_cohelm_is_reported(tmp_path: Path) -> None:
    steps = encoded(written()[0])
    _write_by_hand(tmp_path / "a.mcap", {"period_version": "99"}, period.DEFINITION, steps)
    with pytest.raises(
        CohelmError, match=r"written by cohelm 9\.9 in another form .*\(99, here 3\)"
    ):
        read(tmp_path / "a.mcap")


def test_a_record_that_lacks_a_field_names_it(tmp_path: Path) -> None:
    older = "float64 t\nfloat64 x\n"
    _write_by_hand(tmp_path / "a.mcap", {}, older, [b"\x00\x01\x00\x00" + bytes(16)])
    with pytest.raises(CohelmError, match=r"cohelm 9\.9, which did not record 'y' yet"):
        read(tmp_path / "a.mcap")


def test_additional_fields_of_a_later_cohelm_are_ignored(tmp_path: Path) -> None:
    names = '["cone_1", "cone_2", "cone_3", "mover"]'
    later = period.DEFINITION + "float64 tomorrow\n"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(later, period.TYPE))
    steps: list[bytes] = []
    for step in encoded(written()[0]):
        message = store.types[period.TYPE](
            **vars(period.STORE.deserialize_cdr(step, period.TYPE)), tomorrow=1.0
        )
        steps.append(bytes(store.serialize_cdr(message, period.TYPE)))
    _write_by_hand(tmp_path / "a.mcap", {"obstacles": names}, later, steps)
    assert read(tmp_path / "a.mcap").rows.tobytes() == written()[0].rows.tobytes()


def test_a_record_without_a_period_is_reported(tmp_path: Path) -> None:
    _write_by_hand(tmp_path / "a.mcap", {}, period.DEFINITION, [])
    with pytest.raises(CohelmError, match="ends before its first control period"):
        read(tmp_path / "a.mcap")


def test_a_record_that_is_cut_short_in_its_head_is_said_to_be_a_record(tmp_path: Path) -> None:
    _write_by_hand(tmp_path / "a.mcap", {}, period.DEFINITION, [])
    (tmp_path / "b.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:100])
    with pytest.raises(CohelmError, match=r"b\.mcap ends before its first control period"):
        read(tmp_path / "b.mcap")


@pytest.mark.parametrize(
    "about", [{"dt": "soon"}, {"obstacles": "cone"}, {"obstacles": "3"}, {"obstacles": '["one"]'}]
)
def test_a_record_with_a_damaged_description_is_reported(
    tmp_path: Path, about: dict[str, str]
) -> None:
    steps = encoded(written()[0])
    _write_by_hand(tmp_path / "a.mcap", about, period.DEFINITION, steps)
    with pytest.raises(CohelmError, match="description of the run is damaged"):
        read(tmp_path / "a.mcap")
