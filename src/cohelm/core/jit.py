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
    """A digest of the package's sources, and of where they lie."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(f"{numba.__version__} {package}".encode())
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    """The cache of this exact source tree; the oldest others are removed."""
    own = os.environ.get("COHELM_CACHE_DIR")
    shared = os.environ.get("XDG_CACHE_HOME")
    try:
        base = Path(own) if own else (Path(shared) if shared else Path.home() / ".cache") / "cohelm"
        root = base / "numba"
        folder = root / _fingerprint()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in others[_KEPT_CACHES:]:
            shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):
        return ""  # a read-only home, or none: every start compiles anew
    return str(folder)


_FOLDER = _cache_folder()


def _compile(function: F, **options: Any) -> F:
    chosen: Any = config
    before = chosen.CACHE_DIR
    # The folder is read when the dispatcher is made; other users of numba keep their own.
    chosen.CACHE_DIR = before or _FOLDER
    cached = bool(chosen.CACHE_DIR)  # with no folder numba would use its own, stale, or raise
    try:
        made = numba.njit(cache=cached, error_model="numpy", **options)(function)
    finally:
        chosen.CACHE_DIR = before
    return cast(F, made)


def jit(function: F) -> F:
    """Compile: strict IEEE arithmetic, where x / 0 is inf or NaN and raises nothing.

    No fast-math flag anywhere: it buys 8 % here, and costs NaN checks (`nnan`, and `reassoc`
    too: numba's isfinite is x - x == x - x) and equal results in a run and in a batch.
    """
    return _compile(function)


def jit_inline(function: F) -> F:
    """As `jit`, melted into its compiled callers: for what runs in every step.

    It may read and slice arrays but not make any: it is compiled without numba's reference
    counts, whose atomic updates at every array argument cost a batch more than a tenth.
    """
    return _compile(function, forceinline=True, _nrt=False)


def jit_parallel(function: F) -> F:
    """Compile a loop over robots (`numba.prange`) onto all threads."""
    return _compile(function, parallel=True)
