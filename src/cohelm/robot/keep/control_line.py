"""The control line between loop and gate process: small whole messages, never blocking.

A message arrives whole or not at all, so a process that is stopped at any point leaves no partial
message behind. Large data goes by `shared_memory`.
"""

from __future__ import annotations

import array
import pickle
import select
import socket
from typing import Any

from cohelm.robot.keep.record_pipe import LARGEST, line

_HANDLE = socket.CMSG_LEN(array.array("i").itemsize)  # room for one open file beside a message


class Control:
    """One end of the line. Raises OSError, or EOFError, once the other end is gone."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        end.setblocking(False)
        self._poll = select.poll()
        self._poll.register(end.fileno(), select.POLLIN)
        self._room = memoryview(bytearray(LARGEST))

    def __reduce__(self) -> tuple[type[Control], tuple[socket.socket]]:
        """Pickled into a process that is being started."""
        return Control, (self._end,)

    def send(self, message: Any, handle: int | None = None) -> bool:
        """Send a message if there is room for it; returns whether there was.

        handle: a file descriptor, which is duplicated for the other end.
        Raises ValueError for one longer than `LARGEST` bytes.
        """
        data = pickle.dumps(message, protocol=5)
        if len(data) > LARGEST:
            raise ValueError(f"a message of {len(data)} bytes is too long for the control line")
        try:
            if handle is None:
                self._end.send(data)
            else:
                socket.send_fds(self._end, [data], [handle])
        except BlockingIOError:
            return False
        return True

    def wait(self, within: float) -> bool:
        """Wait up to `within` [s]; whether there is a message or the end of file."""
        return bool(self._poll.poll(1000.0 * max(within, 0.0)))

    def closed(self) -> None:
        """Wait until the other end is closed."""
        gone = select.poll()
        gone.register(self._end.fileno(), 0)
        gone.poll()

    def receive(self) -> tuple[Any, int | None]:
        """The next message, which must be there, and the file descriptor that came with it."""
        size, came, _, _ = self._end.recvmsg_into([self._room], _HANDLE)
        if not size:
            raise EOFError("the other end of the control pipe has closed")
        files = array.array("i")
        for _, _, data in came:
            files.frombytes(data)
        return pickle.loads(self._room[:size]), files[0] if files else None

    def close(self) -> None:
        """Close this end."""
        self._end.close()


def control() -> tuple[Control, Control]:
    """Both ends."""
    ours, theirs = line()
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    return Control(ours), Control(theirs)
