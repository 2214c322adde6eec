"""Mutation testing: would the tests of a room notice a slip in it?

One mutant is the package with one slip in one file of the room: a comparison turned round, a sign
or an operation exchanged, a number changed, min for max, a condition forced, a line left out. It is
killed if a test of the room fails. The tests run uncompiled, which is faster than compiling each
mutant, in processes forked from one that has all libraries loaded.

A room says what is mutated and by which tests in a `Target`, and hands that to `main`:

    python -m tests.law.guard.mutants [--n 300] [--seed 0] [--jobs 2] [--only certify.py] [--list]

What no test can notice, because it changes nothing that is promised, is listed with its reason in
the target's `equal`; it is drawn like the rest and counted apart.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib
import os
import random
import resource
import sys
import tempfile
import tokenize
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

COMPARED = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
REPLACED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
CALLED = {"min": "max", "max": "min", "sqrt": "fabs", "cos": "sin", "sin": "cos", "ceil": "floor",
          "floor": "ceil"}  # fmt: skip


@dataclass(frozen=True)
class Target:
    """What is mutated, and who is to notice.

    folder: under src/cohelm, or one file of it. tests: files under tests/, the quick ones first,
    since a dead mutant's remaining tests are not run. equal: (file, function, slip) as `--only`
    prints them, and why no test can tell that mutant from the original. limit_s: of processor
    time; what takes longer hangs, and is noticed by that. nearest: for a file of the room, the one
    of `tests` that most likely notices, and is run first.
    """

    folder: str
    tests: tuple[str, ...]
    equal: dict[tuple[str, str, str], str] = field(default_factory=dict)
    limit_s: int = 90
    nearest: dict[str, str] = field(default_factory=dict)

    def ordered(self, path: Path) -> list[str]:
        """The tests, the nearest to a file first."""
        return sorted(self.tests, key=lambda name: name != self.nearest.get(path.name))

    @property
    def files(self) -> list[Path]:
        """The files that are mutated."""
        place = ROOT / "src/cohelm" / self.folder
        return [place] if place.is_file() else sorted(place.glob("*.py"))


@dataclass(frozen=True)
class Mutant:
    """One slip: in which file, function and line, what it is, and the file's text with it."""

    path: Path
    function: str
    line: int
    slip: str
    text: str

    @property
    def key(self) -> tuple[str, str, str]:
        """How `Target.equal` names it."""
        return self.path.name, self.function, self.slip

    def __str__(self) -> str:
        return f"{self.path.name}:{self.line} {self.function}:  {self.slip}"


def slips(node: ast.AST) -> Iterator[ast.AST]:
    """Every wrong version of one node."""
    wrong = copy.deepcopy(node)
    match node:
        case ast.Compare(ops=ops):
            for i, op in enumerate(ops):
                for other in COMPARED.get(type(op), ()):
                    wrong = copy.deepcopy(node)
                    wrong.ops[i] = other()
                    yield wrong
        case ast.BinOp(op=op) if type(op) in REPLACED:
            wrong.op = REPLACED[type(op)]()
            yield wrong
        case ast.AugAssign(op=op) if type(op) in REPLACED:
            wrong.op = REPLACED[type(op)]()
            yield wrong
            yield ast.Pass()
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield copy.deepcopy(operand)
        case ast.BoolOp(op=op):
            wrong.op = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield wrong
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1)
            if isinstance(value, float) and value not in (0.0, 1.0):
                yield ast.Constant(value / 2)
        case ast.Call(func=ast.Name(id=name)) if name in CALLED:
            wrong.func.id = CALLED[name]
            yield wrong
        case ast.Call(func=ast.Attribute(attr=name)) if name in CALLED:
            wrong.func.attr = CALLED[name]
            yield wrong
        case ast.If(test=test):
            for value in (True, False):
                wrong = copy.deepcopy(node)
                wrong.test = ast.copy_location(ast.Constant(value), test)
                yield wrong
        case ast.Assign() | ast.AugAssign() | ast.Break() | ast.Raise():
            yield ast.Pass()
        case _:
            return


def mutants(path: Path) -> Iterator[Mutant]:
    """Every slip inside the functions and methods of a file; docstrings and types are none."""
    with tokenize.open(path) as file:
        tree = ast.parse(file.read())
    for name, function in _functions(tree, ""):
        for parent in ast.walk(function):
            for what, value in ast.iter_fields(parent):
                if what in ("annotation", "returns", "decorator_list"):
                    continue
                if what == "args" and not isinstance(parent, ast.Call):
                    continue
                places = enumerate(value) if isinstance(value, list) else [(None, value)]
                for i, child in places:
                    if isinstance(child, ast.AST):
                        yield from _in_place(path, name, tree, parent, what, i, child)


def _functions(scope: ast.Module | ast.ClassDef, prefix: str) -> Iterator[tuple[str, ast.AST]]:
    for node in scope.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _in_place(
    path: Path, function: str, tree: ast.Module, parent: ast.AST, name: str, i: int | None,
    child: ast.AST,
) -> Iterator[Mutant]:  # fmt: skip
    for wrong in slips(child):
        ast.copy_location(wrong, child)
        was, now = ast.unparse(child).split("\n")[0], ast.unparse(wrong).split("\n")[0]
        _put(parent, name, i, wrong)
        text = ast.unparse(ast.fix_missing_locations(tree))
        _put(parent, name, i, child)
        yield Mutant(path, function, getattr(child, "lineno", 0), f"{was}  ->  {now}", text)


def _put(parent: ast.AST, name: str, i: int | None, node: ast.AST) -> None:
    if i is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[i] = node


LOADED = (
    "pytest", "numpy", "numba", "hypothesis", "hypothesis.strategies", "hypothesis.extra.numpy",
    "shapely", "scipy.interpolate", "scipy.ndimage", "pydantic",
)  # fmt: skip
"""What the process that is forked has loaded: not the package itself."""


def survives(mutant: Mutant, target: Target) -> bool:
    """Whether all tests pass on it. One that hangs is noticed: a step must end."""
    with tempfile.TemporaryDirectory() as folder:
        source = ROOT / "src/cohelm"
        package = Path(folder) / "cohelm"
        # Links but for the mutated file; a package's folders must be its own, or its files are not.
        for path in source.rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                there = package / path.relative_to(source)
                there.parent.mkdir(parents=True, exist_ok=True)
                there.symlink_to(path)
        there = package / mutant.path.relative_to(source)
        there.unlink()
        there.write_text(mutant.text, encoding="utf-8")
        context = get_context("forkserver")
        context.set_forkserver_preload(list(LOADED))
        tests = target.ordered(mutant.path)
        worker = context.Process(target=_tried, args=(folder, tests, target.limit_s))
        worker.start()
        worker.join()
        return worker.exitcode == 0


def _tried(folder: str, tests: Sequence[str], limit_s: int) -> None:
    """In a process of its own: the tests on the package in `folder`; exits with pytest's code."""
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))  # ends it, with a signal
    os.environ |= {
        "PYTHONPATH": folder, "NUMBA_DISABLE_JIT": "1", "COHELM_CACHE_DIR": folder,
        "HYPOTHESIS_STORAGE_DIRECTORY": folder, "CI": "1",
    }  # fmt: skip
    config = importlib.import_module("numba.core.config")
    config.DISABLE_JIT = 1
    os.chdir(ROOT)
    sys.dont_write_bytecode = True
    sys.path[:0] = [folder, str(ROOT)]
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    import pytest

    options = ["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
    code = 0
    for some in (tests[:1], tests[1:]):  # most mutants die of the first: the rest are not loaded
        if some and not code:
            code = pytest.main([*options, *(f"tests/{name}" for name in some)])
    import cohelm

    if not str(cohelm.__file__).startswith(folder):
        code = 3  # the tests never saw the mutant
    os._exit(int(code))


def every(target: Target, only: str | None = None) -> list[Mutant]:
    """All mutants of a target, or of one of its files."""
    return [m for path in target.files if only in (None, path.name) for m in mutants(path)]


def chosen(target: Target, n: int, seed: int, only: str | None = None) -> list[Mutant]:
    """n of all mutants, drawn evenly."""
    found = every(target, only)
    return random.Random(seed).sample(found, min(n, len(found)))


@dataclass(frozen=True)
class Score:
    """What became of the mutants that were drawn."""

    drawn: int
    equal: int
    """Of those, how many no test can notice, by argument."""
    alive: list[Mutant]
    """And those that none noticed though one could."""

    @property
    def rate(self) -> float:
        """Share noticed of all that could be."""
        return 1.0 - len(self.alive) / max(self.drawn - self.equal, 1)

    def __str__(self) -> str:
        noticed = self.drawn - self.equal - len(self.alive)
        rows = [str(m) for m in sorted(self.alive, key=lambda m: (m.path.name, m.line))]
        rows.append(
            f"{noticed} of {self.drawn - self.equal} noticed, {100.0 * self.rate:.1f} %; "
            f"of {self.drawn} drawn, {self.equal} change nothing that is promised"
        )
        return "\n".join(rows)


def score(
    target: Target,
    drawn: Sequence[Mutant],
    jobs: int = 1,
    told: Callable[[Mutant, bool], None] = lambda _, __: None,
) -> Score:
    """Try the mutants that are not argued equal; `told` hears at once of each whether it lives."""

    def lives(mutant: Mutant) -> bool:
        alive = survives(mutant, target)
        told(mutant, alive)
        return alive

    known = {m.key for m in every(target)}
    stale = [key for key in target.equal if key not in known]
    if stale:
        raise RuntimeError(f"argued equal, but no longer a mutant: {stale[0]}")
    whole = drawn[0].path.read_text(encoding="utf-8")
    if not survives(replace(drawn[0], text=whole), target):
        raise RuntimeError("the tests fail on the code as it is; a mutant would die of that")
    open_ = [m for m in drawn if m.key not in target.equal]
    with ThreadPoolExecutor(jobs) as pool:
        lived = list(pool.map(lives, open_))
    alive = [m for m, survived in zip(open_, lived, strict=True) if survived]
    return Score(len(drawn), len(drawn) - len(open_), alive)


def main(target: Target) -> None:
    """Run from the command line."""
    ask = argparse.ArgumentParser(description=f"Mutants of {target.folder}.")
    ask.add_argument("--n", type=int, default=300)
    ask.add_argument("--seed", type=int, default=0)
    ask.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    ask.add_argument("--only", help="a file's name: all mutants of that file alone")
    ask.add_argument("--list", action="store_true", help="count the mutants and end")
    given = ask.parse_args()
    drawn = chosen(target, 10**6 if given.list else given.n, given.seed, given.only)
    if given.list:
        print(len(drawn))
        return
    tried: list[bool] = []

    def told(mutant: Mutant, lives: bool) -> None:
        tried.append(lives)
        end = "\n" if lives else "\r"
        print(
            f"{sum(tried)} of {len(tried)} alive, {len(drawn)} drawn; {mutant}"[:160].ljust(160),
            file=sys.stderr, end=end, flush=True,
        )  # fmt: skip

    print(score(target, drawn, given.jobs, told))
