"""Writing a run down as it goes, into one MCAP file."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import TracebackType

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from cohelm import __version__
from cohelm.core.errors import CohelmError
from cohelm.core.trace import Trace
from cohelm.record import status, topics
from cohelm.record.topics import Scene

EPOCH = 946_684_800_000_000_000
"""2000-01-01T00:00:00Z [ns]: where t = 0 of a simulated run is put on the time line of a file.
Not 0, which ROS 2 takes for "no time" and viewers for "the newest"."""

METADATA = "cohelm"
STOPPED = "cohelm stopped"
SCENARIO = "scenario.yaml"
"""Names in the file: of the metadata records, about the run and about a run that was stopped
before its end, and of the attachment."""


class Recorder:
    """Writes the pieces of a run as they come: `with Recorder(path, scene) as r: r.write(piece)`.

    After each `write` that piece stands whole in the file and is read back, whether Ctrl-C, a
    crash of the program or a full disk comes next. On leaving the `with` the file is finished;
    if no step came, it is removed.

    Raises CohelmError where the file can not be made or grown; an existing file is never touched.
    """

    def __init__(self, path: Path, scene: Scene | None = None, epoch: int = EPOCH) -> None:
        """Make the file at `path`. epoch: time stamp of t = 0 [ns]."""
        self.path = path
        self._scene = Scene() if scene is None else scene
        self._epoch = epoch
        self._channels: dict[str, int] = {}
        self._steps = 0
        self._broken = False
        try:
            self._file = path.open("xb")
        except OSError as error:
            raise CohelmError(_unmade(path, error)) from error
        self._mcap = Writer(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)

    def __enter__(self) -> Recorder:
        return self

    def write(self, piece: Trace) -> None:
        """Append the steps of a trace; all pieces of a file are of one run, in order."""
        if not len(piece):
            return
        with _undisturbed(), self._growing():
            if self._steps == 0:
                self._begin(piece)
            stamps = [self._epoch + round(t * 1e9) for t in piece.rows["t"].tolist()]
            said = topics.steps(piece, self._steps, stamps)
            rows = zip(stamps, status.encoded(piece), said, strict=True)
            for k, (stamp, row, messages) in enumerate(rows, self._steps):
                self._add(k, stamp, status.TOPIC, row)
                for topic, message in messages:
                    self._say(k, stamp, topic, message)
            self._mcap.flush()
            self._steps += len(piece)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the file, also after Ctrl-C or an error elsewhere, and then say so in it."""
        with _undisturbed():
            try:
                if self._steps and not self._broken:
                    with self._growing():
                        if kind is not None:
                            self._mcap.add_metadata(STOPPED, {"by": kind.__name__})
                        self._mcap.finish()
                        self._file.flush()
            finally:
                # The raw file: the buffer of a file on a full disk would be written once more.
                self._file.raw.close()
                if not self._steps:
                    self.path.unlink(missing_ok=True)

    def _begin(self, piece: Trace) -> None:
        """What stands at the file's start: how to read it, where it came from, what stays."""
        self._mcap.start(profile=Profile.ROS2, library=f"cohelm {__version__}")
        about = {
            "version": __version__,
            "status_version": str(status.VERSION),
            "dt": repr(piece.dt),
            "obstacles": json.dumps(piece.names),
            "epoch_ns": str(self._epoch),
        }
        self._mcap.add_metadata(METADATA, about)
        self._mcap.add_attachment(
            self._epoch, self._epoch, SCENARIO, "application/yaml", piece.scenario.encode()
        )
        self._register(status.TOPIC, status.TYPE, status.DEFINITION)
        for topic, name in topics.TOPICS.items():
            definition, _ = status.STORE.generate_msgdef(name, ros_version=2)
            self._register(topic, name, definition)
        start = self._epoch + round(float(piece.rows["t"][0]) * 1e9)
        for topic, message in topics.once(self._scene, start):
            self._say(0, start, topic, message)

    def _register(self, topic: str, name: str, definition: str) -> None:
        schema = self._mcap.register_schema(name, SchemaEncoding.ROS2, definition.encode())
        self._channels[topic] = self._mcap.register_channel(topic, MessageEncoding.CDR, schema)

    def _say(self, k: int, stamp: int, topic: str, message: object) -> None:
        data = status.STORE.serialize_cdr(message, topics.TOPICS[topic])
        self._add(k, stamp, topic, bytes(data))

    def _add(self, k: int, stamp: int, topic: str, data: bytes) -> None:
        self._mcap.add_message(self._channels[topic], stamp, data, stamp, sequence=k)

    @contextmanager
    def _growing(self) -> Generator[None]:
        """A failed write ends the recording, in words that say what is left of it."""
        try:
            yield
        except OSError as error:
            self._broken = True
            left = "what came before can be read" if self._steps else "nothing is left of it"
            raise CohelmError(
                f"{self.path}: recording stopped ({error.strerror}) and {left}: "
                "free some space, or record in another folder"
            ) from error


def _unmade(path: Path, error: OSError) -> str:
    """Why the file can not be made, and what to do."""
    match error:
        case FileExistsError():
            return f"{path} exists and is never overwritten: move it away or choose another name"
        case FileNotFoundError():
            return f"{path}: the folder {path.parent} does not exist: make it or choose another"
        case _:
            return f"{path} can not be made ({error.strerror}): choose a folder you may write to"


def _undisturbed() -> AbstractContextManager[None]:
    """Ctrl-C waits until the block is through, so that it never leaves half a chunk."""
    if threading.current_thread() is not threading.main_thread():
        return nullcontext()  # Ctrl-C reaches the main thread only
    return _holding_interrupts()


@contextmanager
def _holding_interrupts() -> Generator[None]:
    """Also one that was put off, and comes as an alarm (`cli/interrupt`)."""
    held: list[int] = []
    kinds = (signal.SIGINT, signal.SIGALRM)
    before = [signal.signal(kind, lambda number, _: held.append(number)) for kind in kinds]
    try:
        yield
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)
        if held:
            signal.raise_signal(held[0])
