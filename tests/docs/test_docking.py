"""docs/docking.md says what the code does."""

from __future__ import annotations

from math import degrees
from pathlib import Path

import pytest

from cohelm.link import messages
from cohelm.loop import docking
from cohelm.plan import docks
from cohelm.scenario.docks import DockModel

TEXT = (Path(__file__).parents[2] / "docs" / "docking.md").read_text(encoding="utf-8")
DEFAULTS = DockModel.model_fields


@pytest.mark.parametrize(
    "said",
    [
        f"at most {docks.BEFORE:g} m before its",
        f"{100 * docks.STAGED_ASIDE:g} cm beside its line and {degrees(docks.STAGED_TURNED):.0f}°",
        f"within {100 * docks.DOCKED_ALONG:g} cm along, {100 * docks.DOCKED_ASIDE:g} cm across and "
        f"{degrees(docks.DOCKED_TURNED):.0f}°",
        f"{100 * docks.CORRIDOR_ASIDE:g} cm beside the line, "
        f"{degrees(docks.CORRIDOR_TURNED):.0f}° off its heading, {100 * docks.BEYOND:g} cm beyond",
        f"standing for {docking.STANDS_FOR:g} s before",
        "by more than a tenth",
        f"asked for on it; {DEFAULTS['speed_mps'].default:g} by default",
        f"is given up; {DEFAULTS['within_s'].default:g} by default",
    ],
)
def test_the_numbers_are_those_of_the_code(said):
    assert said in TEXT


def test_a_deflection_beyond_a_tenth_ends_docking():
    assert messages.CENTRE == 0.1
