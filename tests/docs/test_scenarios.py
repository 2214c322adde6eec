"""docs/scenarios.md tells every key as the checked model has it, and errors as they are."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cohelm.core.errors import CohelmError
from cohelm.scenario import load
from cohelm.scenario.model import Scenario

PAGE = (Path(__file__).parents[2] / "docs/scenarios.md").read_text(encoding="utf-8")
SCHEMA = Scenario.model_json_schema()
HANDS = ("StickNone", "StickScript", "StickFile", "StickOperator")
WORLDS = ("GazeboWorld", "BarnWorld", "MapWorld", "TracksWorld")
BOUNDS = {"exclusiveMinimum": ">", "minimum": "≥", "maximum": "≤", "exclusiveMaximum": "<"}
WORDS = {"boolean": "`true` or `false`", "string": "text", "array": "list", "object": "keys"}


def forms(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """The forms a value may have, none left out but null, references followed."""
    found = [form for form in schema.get("anyOf", [schema]) if form.get("type") != "null"]
    return [SCHEMA["$defs"][f["$ref"].split("/")[-1]] if "$ref" in f else f for f in found]


def allowed(schema: dict[str, Any]) -> str:
    form = forms(schema)[0]
    if "const" in form:
        return f"`{form['const']}`"
    if "enum" in form:
        return " or ".join(f"`{value}`" for value in form["enum"])
    if form.get("type") in ("number", "integer"):
        bounds = (f"{sign} {form[key]:g}" for key, sign in BOUNDS.items() if key in form)
        return ("whole number, " if form["type"] == "integer" else "") + ", ".join(bounds)
    return WORDS.get(form.get("type", ""), "")


def rows(model: dict[str, Any], above: str) -> Iterator[str]:
    """One table row for every key of a model and of the models below it."""
    for name, schema in model["properties"].items():
        key, default = f"{above}{name}", schema.get("default")
        plain = default is not None and not isinstance(default, dict | list)
        said = f"`{str(default).lower() if isinstance(default, bool) else default}`"
        needed = name in model.get("required", [])
        shown = "**needed**" if needed else said if plain else "–"
        meaning = " ".join(schema.get("description", "").split())
        yield f"| `{key}` | {allowed(schema)} | {shown} | {meaning} |"
        form = forms(schema)[0]
        items = forms(form["items"])[0] if "items" in form else {}
        below = form if "properties" in form else items
        if "properties" in below:
            yield from rows(below, f"{key}.N." if below is items else f"{key}.")


EXPECTED = [
    *rows(SCHEMA, ""),
    *(r for hand in HANDS for r in rows(SCHEMA["$defs"][hand], "stick.")),
    *(r for kind in WORLDS for r in rows(SCHEMA["$defs"][kind], "world.")),
]
ERRORS = re.findall(r"^\| `--set (.+?)` \| (.+) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("row", EXPECTED, ids=lambda row: row.split("`")[1])
def test_every_key_is_told_with_its_range_default_and_meaning(row: str) -> None:
    assert row in PAGE


def test_no_key_is_told_that_does_not_exist() -> None:
    told = re.findall(r"^\| `([\w.]+)` \| .*\|$", PAGE, re.MULTILINE)
    assert set(told) == {row.split("`")[1] for row in EXPECTED}


@pytest.mark.parametrize(("change", "said"), ERRORS)
def test_an_error_reads_as_it_is_quoted(change: str, said: str) -> None:
    with pytest.raises(CohelmError) as refused:
        load.scenario("minimal", [change])
    assert str(refused.value) == f"--set {change}: {said}"


def test_errors_are_quoted() -> None:
    assert len(ERRORS) >= 8


def test_the_example_with_many_mistakes_says_what_is_quoted(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```(?:yaml|text)\n(.*?)```", PAGE, re.DOTALL)
    wrong, said = blocks[:2]
    Path("wrong.yaml").write_text(wrong)
    with pytest.raises(CohelmError) as refused:
        load.scenario("wrong.yaml")
    assert "\n".join(f"error: {line}" for line in str(refused.value).splitlines()) == said.strip()
