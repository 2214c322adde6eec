"""docs/sticks.md quotes errors as they are, and numbers that hold."""

import math
import re
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.law.gains import Gains
from cohelm.law.human import authority, intent
from cohelm.link.stick import read
from cohelm.link.sticks.brunner_stick import OPTIONS, parameters

PAGE = (Path(__file__).parents[2] / "docs/sticks.md").read_text(encoding="utf-8")
ERRORS = re.findall(r"^\| (`t.*`) \| (bad\.csv.*) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("rows", "said"), ERRORS)
def test_an_error_reads_as_it_is_quoted(rows, said, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.csv").write_text("\n".join(re.findall("`(.*?)`", rows)) + "\n")
    with pytest.raises(CohelmError) as refused:
        read("bad.csv")
    assert str(refused.value) == said


def test_errors_are_quoted() -> None:
    assert len(ERRORS) == 6


def test_the_example_is_a_stick_in_order(tmp_path) -> None:
    (example,) = re.findall(r"\n\n((?:    [t\d].*\n)+)", PAGE)
    (tmp_path / "hand.csv").write_text(example.replace("    ", ""))
    assert read(tmp_path / "hand.csv").times.tolist() == [3.0, 3.2, 6.0, 6.2]


@pytest.mark.parametrize(("stick", "share"), [(Stick(1.0, 1.0), 0.007), (Stick(0.5, 0.0), 0.54)])
def test_the_automatic_share_is_as_documented(stick, share) -> None:
    assert f"{share * 100:g} %" in PAGE
    assert math.isclose(authority(intent(stick, Gains()), Gains()).x, share, rel_tol=0.05)


def test_the_options_of_a_brunner_stick_are_documented_with_their_defaults() -> None:
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| ([^|]*) \|", PAGE, re.MULTILINE)
    told = dict(
        pair
        for names, values in rows
        for pair in zip(names.replace("`", "").split(", "), values.split(", "), strict=False)
    )
    assert set(OPTIONS) <= set(told)
    given = parameters("brunner://10.0.0.5?force=1")
    assert (given.forward, given.left) == (int(told["forward"]), int(told["left"]))
    assert given.damping == float(told["damping"])
    assert given.silence * 1000 == float(told["silence_ms"])
    for example in re.findall(r"'(brunner:.*?)'", PAGE):
        parameters(example)
