"""Files and folders that a user names: read whole and within a bound, or made.

A device never ends, and a pipe may never begin: neither is waited for.
"""

from __future__ import annotations

import errno
import fcntl
import gzip
import io
import json
import os
import stat
import zlib
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path

from cohelm.core.errors import CohelmError

NO_NAMES = (errno.ENAMETOOLONG, errno.ELOOP)
"""Of files whose names can not be."""
_GZIP = b"\x1f\x8b"
_PIECE = 1 << 20  # bytes that are unpacked at a time


def as_path(given: object, what: str) -> Path:
    """What a caller in Python gave as a path; what: it should name, for the error."""
    if not isinstance(given, str | Path):
        raise CohelmError(f"name {what}, got {type(given).__name__}")
    path = Path(given)
    try:
        path.stat()
    except ValueError as error:  # a letter that ends a string of C
        raise CohelmError(f"{str(path)!r} can not be a name ({error}): check it") from error
    except OSError as error:
        if error.errno in NO_NAMES:
            why = f"{path} can not be read ({error.strerror}): check the name"
            raise CohelmError(why) from error
    return path


def check_regular(path: Path | str) -> None:
    """CohelmError if this is a device, a pipe or a socket; a missing file passes."""
    try:
        mode = Path(path).stat().st_mode
    except OSError:
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise CohelmError(f"{path}: is a device or a pipe, which may never end: name a file")


def read_bytes(path: Path | str, most: int, what: str, unpack: bool = False) -> bytes:
    """The bytes of a file.

    most: its largest size, unpacked [bytes]. what: it should be, for the error, e.g. "a scenario".
    unpack: if it is a gzip archive. Raises CohelmError for a device or a pipe, a damaged archive
    and what is larger, OSError for all else.
    """
    if not unpack:
        return _read(path, most, what)
    data, whole = read_as_far(path, most, what)
    if not whole:
        raise _damaged(path)
    return data


def read_as_far(path: Path | str, most: int, what: str) -> tuple[bytes, bool]:
    """The bytes of a file, unpacked; of a gzip archive that is cut or damaged those before that,
    and whether it is whole. Raises as `read_bytes`, and where nothing can be unpacked."""
    data, whole = _read(path, most, what), True
    if data.startswith(_GZIP):
        found = bytearray()
        with gzip.open(io.BytesIO(data)) as archive:
            try:
                while len(found) <= most and (some := archive.read1(_PIECE)):
                    found += some
            except (EOFError, gzip.BadGzipFile, zlib.error) as error:
                if not found:
                    raise _damaged(path) from error
                whole = False
        data = bytes(found)
    return _bounded(path, data, most, what), whole


def _read(path: Path | str, most: int, what: str) -> bytes:
    check_regular(path)
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe put there meanwhile hangs not
    with os.fdopen(descriptor, "rb") as file:
        return _bounded(path, file.read(most + 1), most, what)


def _bounded(path: Path | str, data: bytes, most: int, what: str) -> bytes:
    if len(data) > most:
        raise CohelmError(
            f"{path}: larger than {most // 10**6} MB, which {what} never is: check its name"
        )
    return data


def _damaged(path: Path | str) -> CohelmError:
    return CohelmError(f"{path}: the gzip archive is damaged or cut short: fetch it again")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents; CohelmError if that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unmade(folder, error) from error


@contextmanager
def writing(folder: Path) -> Generator[None]:
    """Write into a folder, which is made. CohelmError where that can not be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise CohelmError(
            f"{folder} can not be written ({error.strerror}): free some space, or choose another "
            "folder with --out"
        ) from error


@contextmanager
def alone(folder: Path) -> Generator[None]:
    """Be the only process that writes into a folder, from before the work on: the files of two
    would not fit one another. One in which nothing is written is not left.

    CohelmError if it can not be made, or another process is at it.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    make_folder(folder)
    handle = os.open(folder, os.O_RDONLY)
    try:
        if not os.access(folder, os.W_OK | os.X_OK):
            raise CohelmError(
                f"{folder} can not be written (no permission): choose another folder with --out"
            )
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)
        with suppress(OSError):  # it is not empty
            for one in missing:
                one.rmdir()


def _lock(handle: int, folder: Path) -> None:
    with suppress(OSError):  # a file system that has no locks
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CohelmError(
                f"{folder}: another cohelm writes there: wait for it, or choose another with --out"
            ) from error


def unmade(folder: Path, error: OSError) -> CohelmError:
    """Why a folder can not be made."""
    why = "there is a file of that name" if folder.is_file() else error.strerror
    return CohelmError(f"the folder {folder} can not be made ({why}): choose another with --out")


def taken(path: Path) -> CohelmError:
    """Why no new file can be made there."""
    if path.is_dir():
        return CohelmError(f"{path} is a folder: name a file in it")
    return CohelmError(f"{path} exists already: choose another name")


def check_free(folder: Path, names: Iterable[str], what: str, mend: str) -> None:
    """CohelmError if one of these files is in a folder. what: would write them, e.g. "a run"; mend:
    what to do, for the error."""
    there = [name for name in names if (folder / name).exists()]
    if there:
        raise CohelmError(
            f"{folder} holds {', '.join(there)} already, and {what} never overwrites: {mend}"
        )


def json_text(value: object) -> str:
    """The text of a JSON file; ValueError for NaN and infinity, which JSON has not."""
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def write_json(path: Path, value: object) -> None:
    """Write a JSON file."""
    path.write_text(json_text(value), encoding="utf-8")


@contextmanager
def whole(path: Path, mode: int = 0o666, *, sync: bool = False) -> Generator[Path]:
    """The name to write a file under, which is put in place when it is whole, and else removed, as
    it may have filled the disk.

    mode: of the file, less the umask. sync: whether it is on the disk when this returns.
    """
    new = path.with_name(f"{path.name}.part")
    try:
        new.unlink(missing_ok=True)  # of a process that was killed
        new.touch(mode, exist_ok=False)
        yield new
        if sync:
            _sync(new)
        new.replace(path)
        if sync:
            _sync(path.parent)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
