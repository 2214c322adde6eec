"""Records on the robot's disk, for stations to fetch: their list, parts of them, their hash.

Only one piece is held in memory. A hash is computed a slice at a time, between other work, and kept
as long as the file is unchanged. Only regular files in the one folder are read: no symbolic links,
and nothing that blocks a reader.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
from pathlib import Path
from typing import IO

from cohelm.link.bulk_messages import Digest, Fetch, Piece, RecordInfo

PIECE = 32_768
"""[byte]"""
_SLICE = 1_048_576  # 1 ms of hashing; 25 ms from a memory card
_MOST_KNOWN = 64
NOT_THERE = "the robot has no such record"


def listed(folder: Path | None) -> tuple[RecordInfo, ...]:
    """The records in a folder whose names can be requested, newest first."""
    if folder is None or not folder.is_dir():
        return ()
    found: list[RecordInfo] = []
    for path in folder.glob("*.mcap"):
        with contextlib.suppress(OSError):
            about = path.lstat()
            if stat.S_ISREG(about.st_mode) and path.name.isprintable():  # as on the link
                found.append(RecordInfo(path.name, about.st_size, about.st_mtime))
    return tuple(sorted(found, key=lambda info: info.started, reverse=True)[:1000])


def opened(folder: Path | None, name: str) -> IO[bytes] | None:
    """A record by its name; None where it can not be read."""
    if folder is None or name not in {info.name for info in listed(folder)}:
        return None
    try:
        descriptor = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        return None
    return os.fdopen(descriptor, "rb")


class RecordTransfer:
    """The part of a record that one station has requested and not received yet."""

    def __init__(self, fetch: Fetch, file: IO[bytes]) -> None:
        self._name, self._file, self._at = fetch.name, file, fetch.offset
        self._end = fetch.offset + fetch.size

    def more(self, fetch: Fetch) -> bool:
        """Extend the request by what follows; False: it does not follow."""
        if (fetch.name, fetch.offset) != (self._name, self._end):
            return False
        self._end += fetch.size
        return True

    @property
    def outstanding(self) -> bool:
        """Whether there is something to send."""
        return self._at < self._end

    def piece(self) -> Piece:
        """The next piece. Where the file ends too soon it is empty, and the last."""
        try:
            self._file.seek(self._at)
            data = self._file.read(min(PIECE, self._end - self._at))
        except (OSError, ValueError):  # also an offset that no file has
            data = b""
        piece = Piece(self._name, self._at, data)
        self._at = self._at + len(data) if data else self._end
        return piece

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Digests:
    """Hashes of records, one at a time."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._known: dict[tuple[str, int, int, int], bytes] = {}
        self._name = ""
        self._file: IO[bytes] | None = None

    @property
    def busy(self) -> bool:
        """Whether one is being computed."""
        return self._file is not None

    def begin(self, name: str) -> Digest | None:
        """Begin with a record; its hash, where it is known already or there is no such record."""
        file = opened(self._folder, name)
        if file is None:
            return Digest(name, 0, b"", NOT_THERE)
        about = os.fstat(file.fileno())
        self._key = (name, about.st_ino, about.st_size, about.st_mtime_ns)
        if self._key in self._known:
            file.close()
            return Digest(name, about.st_size, self._known[self._key], "")
        self._name, self._file = name, file
        self._size = self._left = about.st_size
        self._hash = hashlib.sha256()
        return None

    def turn(self) -> Digest | None:
        """Continue for a slice; the hash once it is known."""
        if self._file is None:
            return None
        try:
            data = self._file.read(min(_SLICE, self._left))
        except OSError:
            data = b""
        self._hash.update(data)
        self._left -= len(data)
        if self._left > 0 and data:
            return None
        self.close()
        if self._left > 0:
            return Digest(self._name, 0, b"", "the robot can not read it to its end")
        while len(self._known) >= _MOST_KNOWN:
            del self._known[next(iter(self._known))]
        self._known[self._key] = self._hash.digest()
        return Digest(self._name, self._size, self._hash.digest(), "")

    def close(self) -> None:
        """Abort what is being computed."""
        if self._file is not None:
            self._file.close()
            self._file = None
