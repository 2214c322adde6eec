"""Mutation testing of law/guard: would the tests notice a slip?

One mutant is the package with one slip in one file of the guard: a comparison turned round, a
sign or an operation exchanged, a number changed, min for max, a condition forced, a line left out.
It is killed if a test of the guard fails. The tests run uncompiled, which is faster than compiling
each mutant.

    python -m tests.law.guard.mutants [--n 300] [--seed 0] [--jobs 2] [--only certify.py] [--list]
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
GUARD = Path("src/cohelm/law/guard")
# The quick ones first: a dead mutant's remaining tests are not run.
TESTS = (
    "test_project",
    "test_contact",
    "test_shaping",
    "test_certify",
    "test_guard",
    "test_sequence",
)
LIMIT_S = 90.0

COMPARED = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
}  # fmt: skip
REPLACED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
CALLED = {"min": "max", "max": "min", "sqrt": "fabs", "cos": "sin", "sin": "cos", "ceil": "floor",
          "floor": "ceil"}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One slip: in which file and line, what it is, and the file's text with it."""

    file: str
    line: int
    slip: str
    text: str


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
        case ast.Assign() | ast.AugAssign() | ast.Break():
            yield ast.Pass()
        case _:
            return


def mutants(path: Path) -> Iterator[Mutant]:
    """Every slip inside the functions of a file; docstrings, types and `guard_step`'s are none."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    for function in [n for n in tree.body if isinstance(n, ast.FunctionDef)]:
        for parent in ast.walk(function):
            for name, value in ast.iter_fields(parent):
                if name in ("annotation", "returns", "args", "decorator_list"):
                    continue
                places = enumerate(value) if isinstance(value, list) else [(None, value)]
                for i, child in places:
                    if isinstance(child, ast.AST):
                        yield from _in_place(path.name, tree, parent, name, i, child)


def _in_place(
    file: str, tree: ast.Module, parent: ast.AST, name: str, i: int | None, child: ast.AST
) -> Iterator[Mutant]:
    for wrong in slips(child):
        ast.copy_location(wrong, child)
        was, now = ast.unparse(child).split("\n")[0], ast.unparse(wrong).split("\n")[0]
        _put(parent, name, i, wrong)
        text = ast.unparse(ast.fix_missing_locations(tree))
        _put(parent, name, i, child)
        yield Mutant(file, getattr(child, "lineno", 0), f"{was}  ->  {now}", text)


def _put(parent: ast.AST, name: str, i: int | None, node: ast.AST) -> None:
    if i is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[i] = node


def survives(mutant: Mutant) -> bool:
    """Whether all tests pass on it. One that hangs is killed: a step must end."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "cohelm"
        shutil.copytree(ROOT / "src/cohelm", package, ignore=shutil.ignore_patterns("__pycache__"))
        (package / "law/guard" / mutant.file).write_text(mutant.text, encoding="utf-8")
        env = os.environ | {
            "PYTHONPATH": folder, "NUMBA_DISABLE_JIT": "1", "COHELM_CACHE_DIR": folder,
            "HYPOTHESIS_STORAGE_DIRECTORY": folder, "PYTHONDONTWRITEBYTECODE": "1",
        }  # fmt: skip
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        command += [f"tests/law/guard/{name}.py" for name in TESTS]
        try:
            done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            return False
        return done.returncode == 0


def chosen(n: int, seed: int, only: str | None = None) -> list[Mutant]:
    """n of all mutants, drawn evenly."""
    files = sorted(p for p in (ROOT / GUARD).glob("*.py") if only in (None, p.name))
    every = [m for path in files for m in mutants(path)]
    return random.Random(seed).sample(every, min(n, len(every)))


def survivors(n: int, seed: int, jobs: int, only: str | None = None) -> list[Mutant]:
    """Those of n mutants that no test notices."""
    drawn = chosen(n, seed, only)
    whole = (ROOT / GUARD / drawn[0].file).read_text(encoding="utf-8")
    if not survives(replace(drawn[0], text=whole)):
        raise RuntimeError("the tests fail on the guard as it is; a mutant would die of that")
    with ThreadPoolExecutor(jobs) as pool:
        return [m for m, alive in zip(drawn, pool.map(survives, drawn), strict=True) if alive]


def main() -> None:
    """Run from the command line."""
    ask = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    ask.add_argument("--n", type=int, default=300)
    ask.add_argument("--seed", type=int, default=0)
    ask.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    ask.add_argument("--only")
    ask.add_argument("--list", action="store_true", help="count the mutants and end")
    given = ask.parse_args()
    total = len(chosen(10**6, 0, given.only))
    if given.list:
        print(total)
        return
    n = min(given.n, total)
    alive = survivors(n, given.seed, given.jobs, given.only)
    for m in sorted(alive, key=lambda m: (m.file, m.line)):
        print(f"{m.file}:{m.line}  {m.slip}")
    print(f"{n} of {total} mutants, {n - len(alive)} killed: {100 * (1 - len(alive) / n):.1f} %")


if __name__ == "__main__":
    main()
