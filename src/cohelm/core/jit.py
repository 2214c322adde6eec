"""One typed door to numba, with an on-disk cache that can not go stale.

numba's own cache notices an edit of the file that holds a function, but not an edit of a
function it calls in another file: after changing `law/track.py` a cached `sim` kernel would
silently keep running the old formula. So the cache lives in a folder named after the whole
package's sources; any edit anywhere starts a fresh one, and old ones are swept away.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config

F = TypeVar("F", bound=Callable[..., Any])

_KEPT_CACHES = 4


def _fingerprint() -> str:
    """A digest of the package's source files (path, size, time of change)."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(package.rglob("*.py")):
        stat = path.stat()
        digest.update(f"{path}:{stat.st_size}:{stat.st_mtime_ns};".encode())
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    """The cache of this exact source tree; the oldest others are removed."""
    base = os.environ.get("COHELM_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "cohelm"
    )
    root = Path(base) / "numba"
    folder = root / _fingerprint()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in others[_KEPT_CACHES:]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return ""  # a read-only home: numba falls back to its own choice of folder
    return str(folder)


_FOLDER = _cache_folder()


def _compile(function: F, **options: Any) -> F:
    chosen: Any = config
    before = chosen.CACHE_DIR
    # The folder is read when the dispatcher is made; other users of numba keep their own.
    chosen.CACHE_DIR = before or _FOLDER
    try:
        made = numba.njit(cache=True, error_model="numpy", **options)(function)
    finally:
        chosen.CACHE_DIR = before
    return cast(F, made)


def jit(function: F) -> F:
    """Compile a scalar law: strict IEEE arithmetic (NaN checks stay), x / 0 is inf or NaN."""
    return _compile(function)


def jit_inline(function: F) -> F:
    """As `jit`, and LLVM may contract and reorder: for functions that decide nothing on NaN.

    `nnan` and `ninf` stay off, so a NaN still shows; never used in the guard or the gate.
    """
    return _compile(function, fastmath={"contract", "reassoc", "arcp", "nsz"})


def jit_parallel(function: F) -> F:
    """Compile a loop over robots (`numba.prange`) onto all threads."""
    return _compile(function, parallel=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
