"""docs/frames.md names the frames that records have, and the README's words are the page's."""

import re
from pathlib import Path

from cohelm.record import drive, status, topics

DOCS = Path(__file__).parents[2] / "docs"


def test_the_frames_are_those_of_the_records():
    page = (DOCS / "frames.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", page.split("## Frames")[1].split("\n## ")[0], re.M)
    frames = {drive.MAP, drive.ODOM, drive.BASE, drive.LASER, drive.CAMERA}
    assert {*rows} == frames | {topics.WORLD, topics.ROBOT}


def test_every_field_the_glossary_names_is_in_a_record():
    page = (DOCS / "glossary.md").read_text(encoding="utf-8")
    rows = page.split("## From the person")[1].split("\n## ")[0].splitlines()
    rows = [[re.findall(r"`(\w+)`", cell) for cell in row.split("|")[5:7]] for row in rows[4:]]
    texts = (status.DEFINITION, drive.DEFINITION)
    fields = [re.findall(r"^\w+ (\w+)  #", text, re.M) for text in texts]
    assert len([row for row in rows if row]) >= 5
    for row in rows:
        for names, there in zip(row, fields, strict=False):
            assert {*names} <= {*there}
