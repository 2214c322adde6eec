"""A file as given by the user: read whole, unpacked if it is gzip, or refused in one sentence."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular

_LARGEST = 64 * 2**20
_GZIP = b"\x1f\x8b"


def contents(path: Path | str, what: str) -> bytes:
    """The bytes of a file of at most 64 MiB, after unpacking; `what` it should be, for the error.

    Raises CohelmError where it can not be read, is a damaged archive, or is larger.
    """
    check_regular(path)
    try:
        with Path(path).open("rb") as file:
            if file.read(2) == _GZIP:
                file.seek(0)
                with gzip.open(file) as unpacked:
                    data = unpacked.read(_LARGEST + 1)
            else:
                file.seek(0)
                data = file.read(_LARGEST + 1)
    except FileNotFoundError as error:
        raise CohelmError(f"{path}: there is no such file; give the path of {what}") from error
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise CohelmError(
            f"{path}: the gzip archive is damaged or cut short ({error}); fetch it again"
        ) from error
    except OSError as error:
        raise CohelmError(f"{path}: can not be read ({error.strerror}); give {what}") from error
    if len(data) > _LARGEST:
        raise CohelmError(f"{path}: larger than 64 MiB, which {what} never is; check the file")
    return data


def faults(path: Path | str, error: ValidationError) -> CohelmError:
    """What pydantic found wrong in a file, as one sentence."""
    return CohelmError(f"{path}: {'; '.join(_said(fault) for fault in error.errors()[:3])}")


def _said(fault: ErrorDetails) -> str:
    where = ".".join(str(key) for key in fault["loc"])
    wanted = fault["msg"].partition("Input should be ")[2]
    if wanted:
        return f"{where or 'the file'} must be {wanted}, not {fault['input']!r}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    said = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {said}" if where else said
