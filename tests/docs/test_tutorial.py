"""The pages that a reader follows really run: every block is executed, every output shown is seen.

Numbers may differ in the last digits, because the filter switches and rounding decides when.
"""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.few import first

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(sh|python|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
BESIDE = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
                       "COLUMNS": "100", "TERM": "dumb"}  # fmt: skip


def executed(kind: str, code: str, folder: Path) -> tuple[int, str]:
    command = ["bash", "-ec", code] if kind == "sh" else [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=folder, env=BESIDE, capture_output=True, text=True, timeout=300
    )
    return done.returncode, done.stdout + done.stderr


def words(line: str) -> str:
    """A line without its numbers and the table's drawing."""
    return " ".join(NUMBER.sub("#", re.sub(r"[│┃]", " ", line)).split())


def agree(shown: str, seen: str) -> bool:
    """Whether two lines say the same, numbers to a few per cent or a few last digits."""
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(seen), strict=False)
    return words(shown) == words(seen) and all(near(a, b) for a, b in pairs)


def near(shown: str, seen: str) -> bool:
    """Whole numbers as they are, others to five per cent or five of the last digit."""
    digits = len(shown.partition(".")[2])
    if not digits:
        return shown == seen
    return math.isclose(float(shown), float(seen), rel_tol=0.05, abs_tol=5 * 10.0**-digits)


@pytest.mark.parametrize(
    "page", first(["../README.md", "tutorial.md", "records.md", "tutorial-robot.md"], 2)
)
def test_the_page_runs_and_shows_what_is_seen(page: str, tmp_path: Path) -> None:
    blocks = BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))
    assert blocks
    output, unread = "", False
    for kind, code in blocks:
        if kind != "text":
            assert not unread, output
            status, output = executed(kind, code, tmp_path)
            unread = status != 0  # an error is fine where the page shows it
            continue
        assert not unread or "error:" in code, output
        unread = False
        for line in filter(None, code.splitlines()):
            assert any(agree(line, seen) for seen in output.splitlines()), f"{line}\n\n{output}"
    assert not unread, output
