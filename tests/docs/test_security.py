"""What docs/security.md promises is held by tests that exist, and run by default."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text()
NAMED = sorted(set(re.findall(r"`(test_\w+)`", PAGE)))
THERE = {
    name: before
    for path in (ROOT / "tests").rglob("test_*.py")
    for before, name in re.findall(r"((?:^@.*\n)*)^def (test_\w+)\(", path.read_text(), re.M)
}


@pytest.mark.parametrize("name", NAMED)
def test_every_claim_is_held_by_a_test_that_runs_by_default(name: str) -> None:
    assert name in THERE
    assert not re.search(r"^@pytest\.mark\.slow", THERE[name], re.M)


def test_every_row_of_the_threat_model_names_a_test() -> None:
    tables = PAGE.partition("## Attackers")[2].splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in tables if "|" in line]
    rows = [row for row in rows if row[0] != "can" and row[0].strip("-")] + [
        row for row in rows if not row[0]
    ]
    assert len(rows) > 20
    for can, can_not, test in rows:
        assert "`test_" in test or can_not.startswith("(not prevented"), can or can_not
