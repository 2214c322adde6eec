"""docs/scenarios.md tells every key as the checked model has it, and errors as they are."""

import re
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.perceive.match.surfaces import MOST_CELLS
from cohelm.scenario import load
from cohelm.scenario.model import Scenario
from cohelm.sim.grid import MOST_WALLS
from tools.tables import keys

PAGE = (Path(__file__).parents[2] / "docs/scenarios.md").read_text(encoding="utf-8")
SCHEMA = Scenario.model_json_schema()
HANDS = ("StickNone", "StickScript", "StickFile", "StickOperator")
WORLDS = ("GazeboWorld", "BarnWorld", "MapWorld", "TracksWorld")
EXPECTED = [
    *keys(SCHEMA, "", SCHEMA),
    *(r for hand in HANDS for r in keys(SCHEMA["$defs"][hand], "stick.", SCHEMA)),
    *(r for kind in WORLDS for r in keys(SCHEMA["$defs"][kind], "world.", SCHEMA)),
]
ERRORS = re.findall(r"^\| `--set (.+?)` \| (.+) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("row", EXPECTED, ids=lambda row: row.split("`")[1])
def test_every_key_is_documented_with_its_range_default_and_meaning(row: str) -> None:
    assert row in PAGE


def test_no_documented_key_is_missing_in_the_model() -> None:
    told = re.findall(r"^\| `([\w.]+)` \| .*\|$", PAGE, re.MULTILINE)
    assert set(told) == {row.split("`")[1] for row in EXPECTED}


@pytest.mark.parametrize(("change", "said"), ERRORS)
def test_an_error_reads_as_it_is_quoted(change: str, said: str) -> None:
    with pytest.raises(CohelmError) as refused:
        load.scenario("minimal", [change])
    assert str(refused.value) == f"--set {change}: {said}"


def test_the_largest_map_is_documented() -> None:
    assert f"{MOST_CELLS // 10**6} million cells" in PAGE
    assert f"{MOST_WALLS:,} borders".replace(",", " ") in PAGE


def test_errors_are_quoted() -> None:
    assert len(ERRORS) >= 8


def test_the_example_with_many_mistakes_says_what_is_quoted(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```(?:yaml|text)\n(.*?)```", PAGE, re.DOTALL)
    wrong, said = blocks[-2:]
    Path("wrong.yaml").write_text(wrong)
    with pytest.raises(CohelmError) as refused:
        load.scenario("wrong.yaml")
    assert "\n".join(f"error: {line}" for line in str(refused.value).splitlines()) == said.strip()
