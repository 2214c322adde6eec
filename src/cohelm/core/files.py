"""Reads files that a user names, whole and within a bound.

A device never ends, and a pipe may never begin: neither is waited for.
"""

from __future__ import annotations

import gzip
import io
import os
import stat
import zlib
from pathlib import Path

from cohelm.core.errors import CohelmError

_GZIP = b"\x1f\x8b"


def check_regular(path: Path | str) -> None:
    """CohelmError where this is a device, a pipe or a socket; what is not there passes."""
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
    check_regular(path)
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe put there meanwhile hangs not
    with os.fdopen(descriptor, "rb") as file:
        data = file.read(most + 1)
    if unpack and len(data) <= most and data.startswith(_GZIP):
        try:
            with gzip.open(io.BytesIO(data)) as archive:
                data = archive.read(most + 1)
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise CohelmError(
                f"{path}: the gzip archive is damaged or cut short: fetch it again"
            ) from error
    if len(data) > most:
        raise CohelmError(
            f"{path}: larger than {most // 10**6} MB, which {what} never is: check its name"
        )
    return data
