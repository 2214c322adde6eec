"""One name, one thing: a class stands once in the package."""

import ast
from collections import defaultdict
from pathlib import Path

import cohelm

HERE = Path(cohelm.__file__).parent
SHOWN = "station/messages.py"
"""What the page is told is called as what it shows; one writes `page.Docks` there."""


def test_no_public_class_is_called_like_another():
    found: defaultdict[str, list[str]] = defaultdict(list)
    for file in HERE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            where = file.relative_to(HERE).as_posix()
            if isinstance(node, ast.ClassDef) and node.name[0] != "_" and where != SHOWN:
                found[node.name].append(where)
    assert {name: where for name, where in found.items() if len(where) > 1} == {}
