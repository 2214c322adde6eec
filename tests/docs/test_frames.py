"""docs/frames.md names the frames that records have, and the README's words are the page's."""

import re
from pathlib import Path

from cohelm.record import period, topics

DOCS = Path(__file__).parents[2] / "docs"


def test_the_frames_are_those_of_the_records():
    page = (DOCS / "frames.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", page.split("## Frames")[1].split("\n## ")[0], re.M)
    assert {*rows} == {topics.MAP, topics.ODOM, topics.BASE, topics.LASER, topics.CAMERA}


def test_every_field_the_glossary_names_is_in_a_record():
    page = (DOCS / "glossary.md").read_text(encoding="utf-8")
    rows = page.split("## From the person")[1].split("\n## ")[0].splitlines()
    named = [re.findall(r"`(\w+)`", row.split("|")[5]) for row in rows[4:] if "|" in row]
    fields = set(re.findall(r"^\w+ (\w+)  #", period.DEFINITION, re.M))
    assert len([names for names in named if names]) == 5
    assert {name for names in named for name in names} <= fields
