"""Credentials of a drive on this machine, shared with other programs of the same user.

`cohelm drive` makes keys that live as long as it does. What a stick needs to join it lies meanwhile
in a folder that only this user can read, KEYS/drive/PORT (KEYS as in `keys`), locked by the drive:
an unlocked folder is left over from one that was killed. Files that other users could have
written are refused, at reading too.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from cohelm.core.errors import CohelmError
from cohelm.link import keys
from cohelm.link.key_permissions import guarded, make_folder
from cohelm.link.keys import Keys, home

_ADDRESS = "address"


@contextmanager
def shared_credentials(own: Keys, host: str, port: int) -> Generator[None]:
    """While open, let other programs here drive the robot at this address with `own`.

    Raises CohelmError where the folder can not be written.
    """
    folder = home() / "drive" / str(port)
    with _locked_folder(folder.parent):
        for left in folder.parent.glob("*"):
            if not _locked(left / _ADDRESS):
                shutil.rmtree(left, ignore_errors=True)
        for file, content in (
            ("station.pem", own.certificate), ("station.key", own.key),
            ("robot.pem", own.trusted[0]), (_ADDRESS, f"{host}:{port}".encode()),
        ):  # fmt: skip
            keys.write(folder / file, content)
        held = os.open(folder / _ADDRESS, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX)
    try:
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(held)


def credentials_of_drive(address: str | None = None) -> tuple[Keys, tuple[str, int]]:
    """Keys for, and address of, the drive on this machine.

    address: HOST:PORT, to choose one. Raises CohelmError where there is no such drive, or several.
    """
    there = sorted((home() / "drive").glob(f"*/{_ADDRESS}"))
    for path in (home() / "drive", *there):
        guarded(path, within=home())
    found = {path.read_text(): path.parent for path in there if _locked(path)}
    if not found:
        raise CohelmError("no `cohelm drive` runs on this machine: start one, then join it")
    if address is None and len(found) > 1:
        raise CohelmError(f"several drives run here: name one with --robot: {', '.join(found)}")
    chosen = address or next(iter(found))
    if chosen not in found:
        raise CohelmError(f"no drive {chosen!r} runs here; running: {', '.join(found)}")
    host, _, port = chosen.rpartition(":")
    return keys.of_station(found[chosen]), (host, int(port))


@contextmanager
def _locked_folder(folder: Path) -> Generator[None]:
    """Exclusive access to a folder."""
    try:
        make_folder(folder)
        guarded(folder, within=home())
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise CohelmError(f"{folder} can not be made: {error.strerror}") from None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _locked(file: Path) -> bool:
    with contextlib.suppress(OSError), file.open("rb") as opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
