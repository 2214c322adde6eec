"""A file as given by the user: read whole, unpacked if it is gzip, or refused in one sentence."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from cohelm.core.errors import CohelmError
from cohelm.core.files import read_as_far, read_bytes
from cohelm.core.schema import fault_sentence

_LARGEST = 64_000_000  # bytes, unpacked


def contents(path: Path | str, what: str, most: int = _LARGEST) -> bytes:
    """The bytes of a file, after unpacking; `what` it should be, for the error. most: of them.

    Raises CohelmError where it can not be read, is a damaged archive, or is larger.
    """
    with _readable(path, what):
        return read_bytes(path, most, what, unpack=True)


def contents_as_far(path: Path | str, what: str, most: int = _LARGEST) -> tuple[bytes, bool]:
    """The same; of an archive that is cut or damaged what is before that, and whether it is whole.

    Raises CohelmError as `contents`, and where nothing can be unpacked.
    """
    with _readable(path, what):
        return read_as_far(path, most, what)


@contextmanager
def _readable(path: Path | str, what: str) -> Generator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise CohelmError(f"{path}: there is no such file; give the path of {what}") from error
    except OSError as error:
        raise CohelmError(f"{path}: can not be read ({error.strerror}); give {what}") from error


def faults(path: Path | str, error: ValidationError) -> CohelmError:
    """What pydantic found wrong in a file, as one sentence."""
    return CohelmError(f"{path}: {'; '.join(_fault(fault) for fault in error.errors()[:3])}")


def _fault(fault: ErrorDetails) -> str:
    where = ".".join(str(key) for key in fault["loc"])
    wanted = fault["msg"].partition("Input should be ")[2]
    if wanted:
        return f"{where or 'the file'} must be {wanted}, not {fault['input']!r}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    return fault_sentence(fault)
