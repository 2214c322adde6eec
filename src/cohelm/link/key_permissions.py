"""Refuses keys and certificates that other users have access to.

Files that others may write, or may have made, are no evidence of trust: another user could have
added a station. The same rules as those of OpenSSH for authorized_keys, and no symbolic link below
the folder of the keys.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from cohelm.core.errors import CohelmError

_OTHERS_WRITE = 0o022
_OTHERS_ANY = 0o077


def guarded(path: Path, within: Path | None = None, secret: bool = False) -> None:
    """Refuse a file or folder that others may have changed, and every folder of it up to `within`.

    within: a folder above it, or itself; None: only `path` is checked. secret: others may not read
    it either. What does not exist passes. Raises CohelmError, with the cure.
    """
    _check_owner(path, secret, linked=within is None)
    if within is None or path == within:
        if within is not None:
            _not_replaced(within)
        return
    above = path.parent
    while above != within:
        _check_owner(above, secret=False, linked=False)
        above = above.parent
    _check_owner(within, secret=False, linked=True)
    _not_replaced(within)


def make_folder(path: Path) -> None:
    """Make a folder and those above it, each for this user alone. Raises OSError."""
    if path.is_dir():
        return
    if path.parent != path:
        make_folder(path.parent)
    path.mkdir(mode=0o700, exist_ok=True)


def _check_owner(path: Path, secret: bool, linked: bool) -> None:
    """linked: it may be a symbolic link; then its target is checked."""
    try:
        about = path.lstat()
        if stat.S_ISLNK(about.st_mode):
            if not linked:
                raise CohelmError(
                    f"{path} is a symbolic link, and what it leads to may be anybody's: put the "
                    f"file itself there"
                )
            about = path.stat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise CohelmError(f"{path} can not be inspected: {error.strerror}") from None
    what = "folder" if stat.S_ISDIR(about.st_mode) else "file"
    if about.st_uid not in (0, os.geteuid()):
        raise CohelmError(
            f"the {what} {path} belongs to another user (uid {about.st_uid}), who may have put "
            f"anything there: inspect it, then run `chown {os.geteuid()} {path}`"
        )
    mode = stat.S_IMODE(about.st_mode)
    if mode & _OTHERS_WRITE:
        raise CohelmError(
            f"others may write to the {what} {path}, and may have paired a station of theirs: "
            f"inspect it (`cohelm pair list`), then run `chmod go-w {path}`"
        )
    if secret and what == "file" and mode & _OTHERS_ANY:
        raise CohelmError(f"others may read the key {path}: run `chmod 600 {path}`")


def _not_replaced(folder: Path) -> None:
    """Refuse a folder that another user may replace."""
    for above in folder.resolve().parents:
        try:
            mode = above.stat().st_mode
        except OSError:
            continue
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise CohelmError(
                f"anybody may rename what is in {above}, and so replace {folder}: run "
                f"`chmod o-w {above}`, or name another folder with the variable COHELM_KEYS"
            )
