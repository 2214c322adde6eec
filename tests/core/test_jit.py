"""An edited formula is the one that runs, wherever the cache lies, or where none can lie."""

import ast
import gc
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import time
import typing
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

import cohelm
from cohelm.core import jit
from tests.few import first

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="compilation is off")

PACKAGE = Path(cohelm.__file__).parent
CALLER = """
import numpy as np
from cohelm.core.jit import jit
from cohelm.core.types import Desired, Pose
from cohelm.law.track import track

@jit
def step(x, gains):
    still = np.prod(np.zeros(3))
    return track(Pose(x, still, 0.0), Desired(1.0, 0.0, 0.0, 0.5, 0.0), gains).v
"""
"""A file of the room `law` that calls another, and numba's own code; the real step takes seconds to
compile."""
STEP = """
from cohelm.law.caller import step
from cohelm.law.gains import Gains
print(step(0.0, Gains()))
"""
TRACK = """
from cohelm.core.types import Desired, Pose
from cohelm.law.gains import Gains
from cohelm.law.track import track
print(track(Pose(0.0, 0.0, 0.0), Desired(1.0, 0.0, 0.0, 0.5, 0.0), Gains()).v)
"""
NOT_READY_TO_COMPILE = """
import sys
assert not {"numba.np.linalg", "scipy.linalg"} & set(sys.modules)
"""
READ_ONLY = """
import errno, os, sys
def refused(event, args):
    writes = event in ("os.utime", "os.mkdir", "os.rename", "os.remove") or (
        event == "open" and args[2] & (os.O_WRONLY | os.O_RDWR))
    if writes and str(args[0]).startswith(os.environ["COHELM_CACHE_DIR"]):
        raise OSError(errno.EROFS, "Read-only file system")
sys.addaudithook(refused)
"""
"""The cache, even to root."""
KEPT = "from cohelm.core.jit import unkept; assert unkept() == {!r}, unkept()"


@pytest.fixture
def checkout(tmp_path):
    """A copy of the package that a test may edit."""
    copy = tmp_path / "src" / "cohelm"
    for room in ("core", "law"):
        shutil.copytree(PACKAGE / room, copy / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(PACKAGE / "__init__.py", copy)
    (copy / "law" / "caller.py").write_text(CALLER, encoding="utf-8")
    return copy


def answer(checkout, command, **environment):
    """What the law in this copy answers in a fresh process: the commanded speed 1 m behind."""
    base = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "COHELM_", "COV"))}
    done = subprocess.run(
        [sys.executable, "-c", command], check=False, capture_output=True, text=True,
        env=base | {"PYTHONPATH": str(checkout.parent)} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


def test_an_edited_formula_runs_at_once_though_its_caller_was_cached(checkout, tmp_path):
    """`track` is called from the cached `step` in another file; numba alone would not notice."""
    cache = tmp_path / "cache"
    plain = CALLER.replace("np.prod(np.zeros(3))", "0.0")  # numba's own code takes a second
    (checkout / "law" / "caller.py").write_text(plain, encoding="utf-8")
    assert answer(checkout, STEP, COHELM_CACHE_DIR=str(cache)) == pytest.approx(0.5 + 0.9)
    assert list(cache.rglob("caller*.nbc"))
    law = checkout / "law" / "track.py"
    text = law.read_text(encoding="utf-8")
    assert "gains.k_x * x_b" in text
    law.write_text(text.replace("gains.k_x * x_b", "2 * gains.k_x * x_b"), encoding="utf-8")
    assert answer(checkout, STEP, COHELM_CACHE_DIR=str(cache)) == pytest.approx(0.5 + 1.8)
    assert len(list((cache / "numba" / "law").iterdir())) == 2


@pytest.mark.slow  # else it starts slowly, and nothing else
def test_a_copy_of_the_sources_elsewhere_finds_what_was_compiled(checkout, tmp_path):
    """As a wheel beside a checkout, or an environment that was made anew."""
    cache = tmp_path / "cache"
    here = answer(checkout, STEP, COHELM_CACHE_DIR=str(cache))
    made = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")}
    assert made
    copy = tmp_path / "elsewhere" / "cohelm"
    shutil.copytree(checkout, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for path in copy.rglob("*.py"):
        os.utime(path, (1e9, 1e9))
    shutil.rmtree(checkout)
    found = STEP + NOT_READY_TO_COMPILE  # which takes longer than all the rest
    assert answer(copy, found, COHELM_CACHE_DIR=str(cache)) == here
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")} == made


def test_where_no_cache_can_be_written_the_law_still_runs(checkout):
    """A read-only home and a read-only package: slower to start, and nothing else."""
    for room in ("core", "law"):
        (checkout / room / "__pycache__").write_text("in the way", encoding="utf-8")
    nowhere = "/proc/nowhere"  # not even root can write there
    places = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "COHELM_CACHE_DIR"), nowhere)
    why = "\nfrom cohelm.core.jit import unkept\nassert unkept() == 'No such file or directory'"
    speed = answer(checkout, TRACK + why, **places, PYTHONDONTWRITEBYTECODE="1")
    assert speed == pytest.approx(0.5 + 0.9)


@pytest.mark.slow  # else it starts slowly; where none can be written, it runs: above
def test_a_filled_cache_that_is_read_only_is_used(checkout, tmp_path):
    """As in a container's image, or another person's; what is not in it is compiled at each start,
    which is said."""
    cache = tmp_path / "cache"
    here = answer(checkout, STEP, COHELM_CACHE_DIR=str(cache))
    found = READ_ONLY + STEP + NOT_READY_TO_COMPILE + KEPT.format("")
    assert answer(checkout, found, COHELM_CACHE_DIR=str(cache)) == here
    for path in cache.rglob("*.nb?"):
        path.unlink()
    empty = READ_ONLY + TRACK + KEPT.format("Read-only file system")
    assert answer(checkout, empty, COHELM_CACHE_DIR=str(cache)) == here
    assert not list(cache.rglob("*.nb?"))


def test_only_the_newest_caches_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_CACHE_DIR", str(tmp_path))
    for age in range(8):
        old = tmp_path / "numba" / "law" / f"edit{age}"
        old.mkdir(parents=True)
        os.utime(old, (1e9 - age, 1e9 - age))
    mine = Path(jit._cache_folder.__wrapped__("law"))
    kept = {path.name for path in (tmp_path / "numba" / "law").iterdir()}
    assert mine.name in kept
    assert kept - {mine.name} == {"edit0", "edit1", "edit2"}


def test_the_cache_is_named_after_the_sources_and_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_CACHE_DIR", str(tmp_path))
    folder = jit._cache_folder.__wrapped__
    assert folder("law") == folder("law") != ""
    assert folder("law") != folder("sim")


def imported(path):
    """The package's modules that a file names in its imports, read by Python itself."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


@pytest.mark.parametrize("room", ["core", "robot", "law", "perceive", "plan", "pilot", "sim"])
def test_a_room_s_cache_depends_on_all_that_its_compiled_files_import(room):
    sources = jit._sources(room)
    assert {
        path for path in (PACKAGE / room).rglob("*.py") if "core.jit" in path.read_text()
    } <= sources
    for path in sources:
        for name in imported(path):
            file = PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
            if name.startswith("cohelm.") and file.is_file():
                assert file in sources, f"{path} imports {name}"


def test_an_edit_of_what_compiles_nothing_starts_no_new_cache():
    assert PACKAGE / "robot" / "keep" / "gated_robot.py" not in jit._sources("robot")
    assert PACKAGE / "perceive" / "map" / "mapper.py" not in jit._sources("law")


@pytest.mark.slow
def test_an_edit_in_a_room_above_does_not_compile_the_rooms_below_again(checkout, tmp_path):
    cache = tmp_path / "cache"
    answer(checkout, STEP, COHELM_CACHE_DIR=str(cache))
    before = {p.name for p in (cache / "numba" / "core").iterdir()}
    law = checkout / "law" / "track.py"
    law.write_text(law.read_text(encoding="utf-8") + "\n# edited\n", encoding="utf-8")
    answer(checkout, STEP, COHELM_CACHE_DIR=str(cache))
    assert {p.name for p in (cache / "numba" / "core").iterdir()} == before
    assert len(list((cache / "numba" / "law").iterdir())) == 2


NAMESAKES = """
import sys
from numba import njit
from cohelm.core.jit import jit

def made(k):
    @njit
    def run(n):  # calls itself twice: it is not melted into its caller
        return k if n < 2 else run(n - 1) + run(n - 2)
    return run

of_ones, of_tens = made(1), made(10)

@jit
def ones(n):
    return of_ones(n)

@jit
def tens(n):
    return of_tens(n)

print(*(globals()[one](5) for one in sys.argv[1:]))
"""


@pytest.mark.slow  # what it guards against is numba's, and was seen once
def test_two_processes_that_fill_one_cache_do_not_mix_up_functions_of_one_name(tmp_path):
    """As numba has a `run_quicksort1` for values, and one for places, of equal arguments."""
    (tmp_path / "namesakes.py").write_text(NAMESAKES, encoding="utf-8")

    def printed(*names):
        done = subprocess.run(
            [sys.executable, tmp_path / "namesakes.py", *names], check=False, capture_output=True,
            text=True,
            env=os.environ | {"COHELM_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(PACKAGE.parent)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return [int(number) for number in done.stdout.split()]

    assert printed("ones") == [8]
    assert printed("tens") == [80]
    assert printed("ones", "tens") == [8, 80]


def test_a_function_without_reference_counts_can_not_make_an_array():
    @jit.jit_no_refcount
    def made(n):
        return np.empty(n)[0]

    with pytest.raises(numba.core.errors.NumbaError):
        made(3)


def test_no_function_without_reference_counts_returns_an_array():
    """Its caller would count down what was never counted up."""
    for module in pkgutil.walk_packages(cohelm.__path__, "cohelm."):
        if module.name.split(".")[1] in ("core", "law", "plan", "pilot", "robot", "perceive"):
            importlib.import_module(module.name)
    gc.unfreeze()  # what is frozen is not listed
    compiled = 0
    for one in (o for o in gc.get_objects() if type(o) is CPUDispatcher):  # no dead proxies
        if one.targetoptions.get("_nrt", True):
            continue
        hints = typing.get_type_hints(one.py_func)
        assert not holds_array(hints.get("return")), one.py_func.__qualname__
        compiled += 1
    assert compiled > 50


def holds_array(kind):
    """Whether a value of this type is, or has within it, an array."""
    if hasattr(kind, "_fields"):
        return any(holds_array(part) for part in typing.get_type_hints(kind).values())
    inside = typing.get_args(kind) if typing.get_origin(kind) is tuple else ()
    return typing.get_origin(kind) is np.ndarray or any(holds_array(part) for part in inside)


TWICE = """
from cohelm.core.jit import jit

@jit
def twice(x):
    return x + x
"""
SAID = """
import os, sys, time
from pathlib import Path
writes, place = int(sys.argv[2]), os.replace

def replace(*names):
    global writes
    if writes > 0:
        Path("waits").touch()
        while not Path("go").exists():
            time.sleep(0.01)
    place(*names)
    writes -= 1
    if writes == 0:
        os._exit(9)

os.replace = replace
from twice import twice
print(repr(twice(eval(sys.argv[1]))))
"""


@pytest.mark.slow
@pytest.mark.parametrize("writes", first([2, 1]))
def test_two_who_write_the_cache_leave_no_code_under_another_signature(tmp_path, writes):
    """One has begun to write the code for whole numbers when another comes with that for real
    ones, and dies after so many of its files."""
    (tmp_path / "twice.py").write_text(TWICE, encoding="utf-8")

    def asked(given, writes=0):
        return subprocess.Popen(
            [sys.executable, "-c", SAID, given, str(writes)], stdout=subprocess.PIPE, text=True,
            cwd=tmp_path, env=os.environ | {"COHELM_CACHE_DIR": str(tmp_path / "cache")},
        )  # fmt: skip

    with asked("3", writes) as dying:
        while not (tmp_path / "waits").exists():
            assert dying.poll() is None
            time.sleep(0.01)
        assert asked("1.5").communicate()[0].strip() == "3.0"
        (tmp_path / "go").touch()
        assert dying.wait() == 9
    assert asked("3").communicate()[0].strip() == "6"
    assert asked("1.5").communicate()[0].strip() == "3.0"
