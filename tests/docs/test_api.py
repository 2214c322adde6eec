"""docs/api.md names what there is, and its code runs."""

import re
from pathlib import Path

import pytest

import cohelm

PAGE = (Path(__file__).parents[2] / "docs" / "api.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_no_name_that_is_promised_is_missing():
    assert not [name for name in cohelm.__all__ if f"`{name}`" not in PAGE]


@pytest.mark.parametrize("block", [b for b in BLOCKS if "__main__" not in b])
def test_the_commands_it_shows_run(block, capsys):
    exec(block, {})
    assert capsys.readouterr().out


def test_the_documented_verdicts_are_all_of_the_guard():
    said = set(re.findall(r"^\| ([A-Z, ]+) \|", PAGE, re.MULTILINE))
    names = {name for row in said for name in row.split(", ")}
    assert names == {verdict.name for verdict in cohelm.Verdict} - {"POWERLESS"}
