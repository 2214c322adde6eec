"""The pages that a reader follows really run: every block is executed, every output shown is seen.

Numbers may differ in the last digits, because the filter switches and rounding decides when.
"""

import contextlib
import io
import math
import re
import shlex
import subprocess
import traceback
import warnings
from pathlib import Path

import pytest

from tests.few import first
from tests.typed import Cohelm

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(sh|python|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
COMMAND = re.compile(r"^cohelm ((?:.*\\\n)*.*)\n", re.MULTILINE)


def executed(cohelm: Cohelm, kind: str, code: str) -> tuple[int, str]:
    """Exit code and all that is said. `cohelm` and Python run in this process, which has imported
    everything; that they do in one of their own is tried in tests/e2e."""
    if kind == "python":
        said = io.StringIO()
        with contextlib.redirect_stdout(said), warnings.catch_warnings(action="ignore"):
            try:
                exec(compile(code, "the page", "exec"), {"__name__": "__main__"})
            except Exception:
                return 1, said.getvalue() + traceback.format_exc()
        return 0, said.getvalue()
    before = 0
    output = ""
    for command in COMMAND.finditer(code):
        subprocess.run(["bash", "-ec", code[before : command.start()]], check=True)
        before = command.end()
        status, out, err = cohelm(*shlex.split(command[1].replace("\\\n", ""), comments=True))
        output += out + err
        if status:
            return status, output
    done = subprocess.run(["bash", "-ec", code[before:]], capture_output=True, text=True)
    return done.returncode, output + done.stdout + done.stderr


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
def test_the_page_runs_and_shows_what_is_seen(
    page: str, cohelm: Cohelm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "dumb")
    blocks = BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))
    assert blocks
    output, unread = "", False
    for kind, code in blocks:
        if kind != "text":
            assert not unread, output
            status, output = executed(cohelm, kind, code)
            unread = status != 0  # an error is fine where the page shows it
            continue
        assert not unread or "error:" in code, output
        unread = False
        for line in filter(None, code.splitlines()):
            assert any(agree(line, seen) for seen in output.splitlines()), f"{line}\n\n{output}"
    assert not unread, output
