"""One name, one thing: a class stands once in the package."""

import re
from collections import defaultdict
from pathlib import Path

import cohelm

HERE = Path(cohelm.__file__).parent
SHOWN = "station/messages.py"
"""What the page is told is called as what it shows; one writes `page.Docks` there."""
CLASS = re.compile(r"(?m)^ *class ([A-Za-z]\w*)\b.*:(?: *#.*)?$|^ *class ([A-Za-z]\w*)\($")


def test_no_public_class_is_called_like_another():
    found: defaultdict[str, list[str]] = defaultdict(list)
    for file in HERE.rglob("*.py"):
        where = file.relative_to(HERE).as_posix()
        if where != SHOWN:
            for match in CLASS.finditer(file.read_text(encoding="utf-8")):
                found[match[1] or match[2]].append(where)
    assert len(found) > 300
    assert {name: where for name, where in found.items() if len(where) > 1} == {}
