"""The recorder process: the loop never waits for a disk.

Loop and gate process have a socket each; when both are closed, the file is finished. `NAME.log`
beside `NAME.mcap` has a line for every event and can still grow when the disk is full, since
`NAME.reserve` reserves space for it. Of a drive that never began, as its start failed or was
interrupted, nothing is left: the name is free for the next.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import select
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cohelm.core.errors import CohelmError
from cohelm.core.files import taken
from cohelm.robot.keep.processes import detach, start_process
from cohelm.robot.keep.record_pipe import ALIVE, LARGEST, Event, line
from cohelm.robot.model import RobotModel

if TYPE_CHECKING:
    from cohelm.record.file import RecordWriter

_RESERVE = 1 << 16  # bytes kept for the log
_MODE = 0o640  # the log names drivers and addresses
_NEXT_LINE = "\n" + 13 * " "
_KEPT = b"kept"
_FLUSH = 0.5  # from one time the file is made good to the next [s]


class EventSink:
    """A process that receives messages from loop and gate process, over a socket each."""

    def __init__(
        self, name: str, target: Callable[..., None], *args: Any, outlives: bool = False
    ) -> None:
        """target: gets the other ends of both sockets after the arguments."""
        self.loop, loops = line()
        self.gated, gates = line()
        self._process = start_process(name, target, *args, loops, gates, outlives=outlives)
        loops.close()
        gates.close()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid or 0

    def begin(self, epoch: int) -> None:
        """Send the wall-clock time when the robot's clock was 0 [ns], the first message."""
        self.loop.send(pickle.dumps(epoch))

    def close_lines(self) -> None:
        """Close both sockets; the process ends by itself."""
        for end in (self.loop, self.gated):
            with contextlib.suppress(OSError):
                end.close()


def receive(end: socket.socket) -> Any:
    """The next message; None after a connection reset, when more may follow. EOFError at the
    end."""
    try:
        data = end.recv(LARGEST)
    except ConnectionResetError:  # the sender has closed without reading all its input;
        return None  # its earlier messages are still to come
    if not data:
        raise EOFError
    return pickle.loads(data)


class Recording(EventSink):
    """A running recorder."""

    def __init__(self, path: Path, model: RobotModel, scenario: str = "") -> None:
        """Raises CohelmError if the file can not be created; none is ever overwritten."""
        self.path = path
        _check(path)
        self._keep, kept = line()
        super().__init__("cohelm recorder", _record, path, model, scenario, kept, outlives=True)
        kept.close()

    def keep(self) -> None:
        """The drive begins: what is recorded stays. A socket of its own, as the loop's may be full
        of what came meanwhile, and may be waited for by nobody."""
        with contextlib.suppress(OSError):  # it is kept already, or the recorder has ended
            self._keep.send(_KEPT, socket.MSG_DONTWAIT)

    def close(self, within: float = 20.0) -> bool:
        """Wait until the file is finished; returns whether it is, and is whole. If not, the
        process continues by itself."""
        self.close_lines()
        self._keep.close()
        self._process.join(within)
        if self._process.is_alive():
            detach(self._process)
        return self._process.exitcode == 0


def _check(path: Path) -> None:
    """Create the empty file and its folder, so that a wrong path is reported at once. The file is
    removed again: if this process is killed, nobody else would."""
    with contextlib.suppress(OSError):  # opening the file reports what is wrong
        path.parent.mkdir(parents=True, exist_ok=True)
    try:
        path.open("xb").close()
        path.unlink()
    except FileExistsError as error:
        raise taken(path) from error
    except OSError as error:
        raise CohelmError(
            f"{path} can not be made ({error.strerror}): choose a folder you may write to"
        ) from error


class Log:
    """The log of events, a line for each, and more for a traceback; still written when the disk is
    full."""

    def __init__(self, path: Path) -> None:
        self._path, self._reserve = path.with_suffix(".log"), path.with_suffix(".reserve")
        self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, _MODE)
        with contextlib.suppress(OSError):
            held = os.open(self._reserve, os.O_WRONLY | os.O_CREAT, _MODE)
            os.posix_fallocate(held, 0, _RESERVE)
            os.close(held)

    def __call__(self, event: Event) -> None:
        """Write the event at once."""
        mark = "!" if event.serious else " "
        lines = event.text.replace("\n", _NEXT_LINE)
        text = f"{event.stamp:10.3f} {mark} {event.who}: {lines}\n".encode(errors="replace")
        try:
            os.write(self._file, text)
        except OSError:
            self._reserve.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                os.write(self._file, text)

    def close(self, kept: bool) -> None:
        """Close the log; one without a line is removed, and one of a drive that never began."""
        self._reserve.unlink(missing_ok=True)
        if not kept or os.fstat(self._file).st_size == 0:
            self._path.unlink(missing_ok=True)
        os.close(self._file)


def _record(
    path: Path, model: RobotModel, scenario: str, keep: socket.socket,
    loop: socket.socket, gated: socket.socket,
) -> None:  # fmt: skip
    """Main function of the recorder process."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if hasattr(signal, "SIGXFSZ"):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a file-size limit is an OSError, then
    log = Log(path)
    from cohelm.record.file import About, RecordWriter  # here only, not in the loop's process

    files: list[io.FileIO] = []

    def begin(epoch: int) -> RecordWriter:
        files.append(path.open("xb", buffering=0))
        return RecordWriter(files[0], About("drive", epoch, scenario), model)

    writer = _Writer(log, begin)
    writer.serve(loop, gated)
    kept = _kept(keep)
    log.close(kept)
    for file in files:
        file.close()  # writes nothing, as nothing is buffered, so never fails
        if not kept or path.stat().st_size == 0:  # as of a disk that was full
            path.unlink()
    if writer.full:
        raise SystemExit(1)


def _kept(keep: socket.socket) -> bool:
    """Whether the drive began."""
    with contextlib.suppress(OSError):
        return keep.recv(len(_KEPT), socket.MSG_DONTWAIT) == _KEPT
    return False


class _Writer:
    """Writes the messages of both sockets."""

    def __init__(self, log: Log, begin: Callable[[int], RecordWriter]) -> None:
        """begin: makes the record, from the wall-clock time when the robot's clock was 0 [ns]."""
        self._log, self._open = log, begin
        self._drive: RecordWriter | None = None
        self.full = ""
        """Why writing has stopped; empty: it has not."""
        self._latest = 0.0

    def serve(self, loop: socket.socket, gated: socket.socket) -> None:
        """Write until both sockets are closed."""
        lines = {loop.fileno(): loop, gated.fileno(): gated}
        poll = select.poll()
        for fd in lines:
            poll.register(fd, select.POLLIN)
        flushed = time.monotonic()
        while lines:
            for fd, _ in poll.poll(500):
                try:
                    message = receive(lines[fd])
                except EOFError:
                    poll.unregister(fd)
                    del lines[fd]
                    continue
                if message is not None:
                    self._take(message, loop)
            if time.monotonic() - flushed > _FLUSH:
                flushed = time.monotonic()
                if self._drive is not None:
                    self._try(self._drive.flush, loop)
                with contextlib.suppress(OSError):  # the loop has ended, or does not read
                    loop.send(ALIVE, socket.MSG_DONTWAIT)
        if self._drive is not None:
            self._try(self._drive.finish, None)

    def _take(self, message: Any, loop: socket.socket) -> None:
        if isinstance(message, int):
            self._try(lambda: self._begin(message), loop)
            return
        if isinstance(message, Event):
            self._log(message)
            self._latest = message.stamp
        if (drive := self._drive) is not None:
            self._try(lambda: drive.write(message), loop)

    def _begin(self, epoch: int) -> None:
        self._drive = self._open(epoch)

    def _try(self, write: Any, loop: socket.socket | None) -> None:
        """Write; on failure log it, report it to the loop, and stop writing."""
        if self.full:
            return
        try:
            write()
        except OSError as error:
            self.full = f"recording stopped: {error.strerror}"
            self._log(Event(self._latest, "recorder", self.full, True))
            if loop is not None:
                with contextlib.suppress(OSError):
                    loop.send(pickle.dumps(self.full), socket.MSG_DONTWAIT)
