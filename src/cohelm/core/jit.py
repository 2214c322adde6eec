"""One typed door to numba, with an on-disk cache that can not go stale.

numba's own cache notices an edit of the file that holds a function, but not an edit of a
function it calls in another file: after changing `law/track.py` a cached `sim` kernel would
silently keep running the old formula. So a room's cache lies in a folder named after all the
sources it can depend on: imports run one way, so these are its own and those of the rooms below.
An edit there starts a fresh cache, and old ones are swept away; an edit elsewhere costs nothing.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config

F = TypeVar("F", bound=Callable[..., Any])

_KEPT_CACHES = 4

BELOW: dict[str, tuple[str, ...]] = {
    "core": (),
    "robot": ("core",),
    "law": ("core", "robot"),
    "perceive": ("core", "robot"),
    "pilot": ("core", "robot", "law", "perceive"),
    "sim": ("core", "robot", "law", "perceive", "pilot"),
}
"""The rooms that compile, and what each may import. Code from elsewhere depends on everything."""


def _fingerprint(room: str) -> str:
    """A digest of the sources that a room's compiled code can depend on, and of where they lie."""
    package = Path(__file__).resolve().parent.parent
    folders = [package / r for r in (*BELOW[room], room)] if room in BELOW else [package]
    digest = hashlib.sha256(f"{numba.__version__} {package}".encode())
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _cache_folder(room: str) -> str:
    """The cache of a room for this exact source tree; its oldest others are removed."""
    own = os.environ.get("COHELM_CACHE_DIR")
    shared = os.environ.get("XDG_CACHE_HOME")
    try:
        base = Path(own) if own else (Path(shared) if shared else Path.home() / ".cache") / "cohelm"
        root = base / "numba" / room
        folder = root / _fingerprint(room)
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in others[_KEPT_CACHES:]:
            shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):
        return ""  # a read-only home, or none: every start compiles anew
    return str(folder)


def _room(function: Callable[..., Any]) -> str:
    """The room a function stands in; "elsewhere" for one that is in none of those that compile."""
    package, _, rest = function.__module__.partition(".")
    room = rest.partition(".")[0]
    return room if package == "cohelm" and room in BELOW else "elsewhere"


def _compile(function: F, **options: Any) -> F:
    chosen: Any = config
    before = chosen.CACHE_DIR
    # The folder is read when the dispatcher is made; other users of numba keep their own.
    chosen.CACHE_DIR = before or _cache_folder(_room(function))
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


def jit_apart(function: F) -> F:
    """As `jit_inline`, but not melted in: for a long loop that the compiler is to vectorise.

    What is melted into its caller has been unrolled before, and is not vectorised any more.
    """
    return _compile(function, _nrt=False)


def jit_free(function: F) -> F:
    """As `jit`, and Python's other threads run meanwhile: for what several threads call at once."""
    return _compile(function, nogil=True)
