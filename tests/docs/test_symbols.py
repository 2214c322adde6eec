"""docs/symbols.md is true: every name exists, every key exists, no equation is left out."""

import importlib
import re
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

from cohelm.core.errors import CohelmError
from cohelm.scenario import load

DOCS = Path(__file__).parents[2] / "docs"
SYMBOLS = (DOCS / "symbols.md").read_text(encoding="utf-8")


def rows(section: str) -> list[list[str]]:
    """The cells of a section's table, without its heading."""
    body = SYMBOLS.split(f"\n## {section}\n")[1].split("\n## ")[0]
    lines = [line for line in body.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def found(name: str) -> Any:
    """What a dotted name means; the module is as much of it as can be imported."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        return reduce(getattr, parts[cut:], module)
    raise ModuleNotFoundError(name)


PAGES = [page.read_text(encoding="utf-8") for page in DOCS.glob("*.md")]
NAMES = sorted({name for page in PAGES for name in re.findall(r"`(cohelm(?:\.\w+)+)", page)})
KEYS = sorted({key for row in rows("Symbols") for key in re.findall(r"`([^`]+)`", row[2])})


@pytest.mark.parametrize("name", NAMES)
def test_every_name_in_the_documentation_exists(name: str) -> None:
    try:
        found(name)
    except AttributeError:  # a dataclass field without a default is only annotated
        owner, _, field = name.rpartition(".")
        assert field in found(owner).__annotations__


@pytest.mark.parametrize("key", KEYS)
def test_every_scenario_key_in_the_table_exists(key: str) -> None:
    wrong = f"{key}={{a: 1}}" if "." in key else f"{key}.no_such_key=1"
    with pytest.raises(CohelmError) as refused:  # for its value, so the key is known
        load.scenario("lab-shared", [wrong])
    assert key.split(".")[-1] in str(refused.value)
    assert f"{key}: unknown key" not in str(refused.value)


def test_every_equation_of_the_paper_is_accounted_for() -> None:
    told = [int(n) for row in rows("Equations") for n in re.findall(r"\((\d+)\)", row[0])]
    assert sorted(told) == list(range(1, 52))


def test_every_symbol_has_a_place_a_unit_and_an_equation() -> None:
    table = rows("Symbols")
    assert len(table) > 30
    for paper, code, _, unit, equation in table:
        assert "`cohelm." in code or "not used" in code, paper
        assert unit, paper
        assert re.search(r"\(\d+\)|E\d+", equation), paper
