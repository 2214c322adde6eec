"""Typed wrapper of numba, with an on-disk cache that can not go stale.

numba's own cache notices an edit of the file that holds a function, but not an edit of a
function it calls in another file: after changing `law/track.py` a cached `sim` kernel would
silently keep running the old formula. So a room's cache lies in a folder named after the contents
of the room's files that compile, and of all they import, directly or not. An edit there starts a
fresh cache, and old ones are deleted; an edit elsewhere costs nothing. Where the files lie does not
count: a checkout, its copy and a wheel of it share what was compiled once.

Nor can a process that dies while it writes, or another that writes at the same time, leave a
function's code under another of its signatures: see `Files`.

Nor do two functions that different processes compiled share a name. numba tells functions of one
name apart, as its `np.sort` and `np.argsort` are inside, by a number that every process counts
from 1. A process that loads both from the cache would link the calls of one to the other, which
ends in wrong numbers or a segmentation fault. So the numbers are drawn at random, forks included.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import config
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.environment import Environment
from numba.core.runtime.nrt import rtsys
from numba.cpython import hashing as hashing  # the names that compiled code knows its secrets by

F = TypeVar("F", bound=Callable[..., Any])

_KEPT_CACHES = 4

_identity: Any = FunctionIdentity
_identity._unique_ids = iter(lambda: int.from_bytes(os.urandom(7), "big"), None)

_PACKAGE = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(
    r"^\s*from\s+cohelm\.?([\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|^\s*import\s+cohelm\.([\w.]+)",
    re.M,
)


@cache
def _imported(file: Path) -> frozenset[Path]:
    """The files of the package that one of them imports."""
    found: set[str] = set()
    for of, names, whole in _IMPORT.findall(file.read_text(encoding="utf-8")):
        module = f"{_PACKAGE}/{(of or whole).replace('.', '/')}"
        if os.path.isfile(f"{module}.py"):  # noqa: PTH113  a few thousand, in each process
            found.add(f"{module}.py")
            continue
        parts = [module, *(f"{module}/{name}" for name in re.findall(r"\w+", names))]
        for path in (f"{part}{end}" for part in parts for end in (".py", "/__init__.py")):
            if os.path.isfile(path):  # noqa: PTH113
                found.add(path)
    return frozenset(map(Path, found))


def _sources(room: str) -> set[Path]:
    """The files of a room that compile, and all they import."""
    known: set[Path] = set()
    new = {f for f in (_PACKAGE / room).rglob("*.py") if b"cohelm.core.jit" in f.read_bytes()}
    while new:
        known |= new
        new = {f for path in new for f in _imported(path)} - known
    return known


def compiled_since(when: float) -> int:
    """How many functions any process of cohelm has compiled into the cache since then.

    when: as `time.time` [s]. 0 where there is no cache.
    """
    try:
        files = _root().rglob("*.nbi")
        return sum(1 for file in files if file.stat().st_mtime >= when)
    except (OSError, RuntimeError):
        return 0


def _root() -> Path:
    """Where the caches of all rooms are. RuntimeError where this person has no home."""
    own = os.environ.get("COHELM_CACHE_DIR")
    shared = os.environ.get("XDG_CACHE_HOME")
    base = Path(own) if own else (Path(shared) if shared else Path.home() / ".cache") / "cohelm"
    return base / "numba"


def _fingerprint(room: str) -> str:
    """A digest of the sources that a room's compiled code depends on, names and contents."""
    digest = hashlib.sha256(f"{numba.__version__} {np.__version__}".encode())
    for path in sorted(_sources(room)):
        digest.update(f"\n{path.relative_to(_PACKAGE)}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _cache_folder(room: str) -> str:
    """The cache of a room for this exact source tree; its oldest others are removed."""
    try:
        root = _root() / (room or "elsewhere")
        folder = root / _fingerprint(room)
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:
        _unkept.append(getattr(error, "strerror", None) or str(error))
        return ""  # a read-only home, or none: every start compiles anew
    with suppress(OSError):  # one that may be read only is used as it is
        os.utime(folder)
        others = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in others[_KEPT_CACHES:]:
            shutil.rmtree(old, ignore_errors=True)
    return str(folder)


_unkept: list[str] = []


def unkept() -> str:
    """Why what is compiled here is not kept for the next start; empty: it is."""
    return next(iter(_unkept), "")


def _room(function: Callable[..., Any]) -> str:
    """The room a function stands in; the whole package for one from outside, as in a test."""
    package, _, rest = function.__module__.partition(".")
    return rest.partition(".")[0] if package == "cohelm" else ""


def _rebuilt(module: str, consts: list[Any], name: str) -> Any:
    """What compiled code hands to Python, as numba rebuilds it; but no module is imported for it.

    Of the module numba takes the globals, which only object mode reads, and nothing is compiled in
    that. Its own module of array functions brings scipy's linear algebra: 0.2 s in each process.
    """
    kind: Any = Environment
    made: Any = kind._memo.get(name)
    if made is None:
        made = kind(vars(sys.modules[module]) if module in sys.modules else {"__name__": module})
        made.consts[:] = consts
        made.env_name = name
        kind._memo[name] = made
    return made


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str, /) -> Any:
        if (module_name, global_name) == ("numba.core.environment", "_rebuild_env"):
            return _rebuilt
        return super().find_class(module_name, global_name)


class Files(IndexDataCacheFile):
    """The cached code of one function, a file for each of its signatures, and their index.

    numba counts these files, and writes the index first: where a process is killed between the
    two, or two do it at once, the index leads from one signature to the code of another, which
    takes its arguments for what they are not. Here a file is named after its signature, and
    written before the index says so; both are put in place whole. What is lost is compiled anew.
    """

    def save(self, key: Any, data: Any) -> None:
        """A signature more."""
        own: Any = self
        digest = hashlib.sha256(own._dump(key)).hexdigest()[:16]
        name = f"{Path(own._index_name).stem}.{digest}.nbc"
        own._save_data(name, data)
        own._save_index(own._load_index() | {key: name})

    def _load_data(self, name: str) -> Any:
        own: Any = self
        with Path(own._data_path(name)).open("rb") as file:
            return _Unpickler(file).load()


_numba: Any = CompileResultCacheImpl


class _Locator(_numba._locator_classes[0]):  # in the folder that is given
    def ensure_cache_path(self) -> None:
        """Make the folder. numba takes none that it can not write to, though it be full."""
        with suppress(OSError):
            Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)


class _Impl(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012  numba's name


class Cache(FunctionCache):
    """The cached code of one function.

    Before numba loads any, it gets ready to compile: it imports all that it can compile, and
    scipy's linear algebra, a third of a second in each process. What is compiled already needs its
    memory management only; who compiles gets ready all the same.
    """

    _impl_class = _Impl

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for a signature, where that can be written."""
        own: Any = super()
        try:
            own.save_overload(sig, data)
        except OSError as error:
            _unkept.append(error.strerror or str(error))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature; None where there is none, or it can not be read."""
        own: Any = self
        memory: Any = rtsys
        memory.initialize(target_context)
        with own._guard_against_spurious_io_errors():
            return own._load_overload(sig, target_context)


def _compile(function: F, **options: Any) -> F:
    chosen: Any = config
    before, room = chosen.CACHE_DIR, _room(function)
    # The folder is read when the cache is made; other users of numba keep their own.
    folder = chosen.CACHE_DIR = before or _cache_folder(room)
    made: Any = numba.njit(error_model="numpy", **options)(function)
    try:
        # with no folder numba would use its own, stale, or raise
        files: Any = Cache(function) if folder and not chosen.DISABLE_JIT else None
    finally:
        chosen.CACHE_DIR = before
    if files is not None:
        made._cache = files
        about = files._impl
        stamp = about.locator.get_source_stamp()
        if room and not before:  # the folder's name stands for path and time of the source
            place = Path(folder, *function.__module__.split(".")[2:-1])
            files._cache_path = about.locator._cache_path = str(place)
            stamp = ""
        files._cache_file = Files(files.cache_path, about.filename_base, stamp)
    return cast(F, made)


def jit(function: F) -> F:
    """Compile: strict IEEE arithmetic, where x / 0 is inf or NaN and raises nothing.

    No fast-math flag anywhere: it buys 8 % here, and costs NaN checks (`nnan`, and `reassoc`
    too: numba's isfinite is x - x == x - x) and equal results wherever a function is melted in.
    """
    return _compile(function)


def jit_no_refcount(function: F) -> F:
    """As `jit`, for functions that read and write the arrays they are given, but make and return
    none: compiled without numba's reference counts.

    Their atomic updates, two for every array of every named tuple that is handed on, were two
    fifths of a step of the guard. A function that makes an array is refused by numba; one that
    returns an array or a slice of one must not be compiled so.
    """
    return _compile(function, _nrt=False)


def jit_inline(function: F) -> F:
    """As `jit_no_refcount`, inlined into its compiled callers: for what runs in every step."""
    return _compile(function, forceinline=True, _nrt=False)
