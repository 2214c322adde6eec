"""Which name a word was meant to be."""

import pytest

from cohelm.core.errors import did_you_mean

KEYS = (
    "obstacles", "reference", "stick", "walls_m", "zones", "yaw_rate_radps", "map", "Office.yaml",
)  # fmt: skip


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("obstacels", "obstacles"), ("obtsacle", "obstacles"), ("refrence", "reference"),
        ("Zones", "zones"), ("zone", "zones"), ("mpa", "map"), ("mab", "map"),
        ("yaw", "yaw_rate_radps"), ("ofice.yaml", "Office.yaml"), ("stikc", "stick"),
    ],
)  # fmt: skip
def test_a_name_that_was_mistyped_is_offered(word, meant):
    assert did_you_mean(word, KEYS) == f"; did you mean {meant}?"


@pytest.mark.parametrize(
    "word",
    ["step_s", "creep_clearance_m", "track_m", "cell_m", "number", "lab.yaml", "x", "", "ma.yaml"],
)
def test_a_name_that_is_another_is_not_offered(word):
    assert did_you_mean(word, KEYS) == ""


def test_of_several_names_that_begin_with_a_word_none_is_offered():
    assert did_you_mean("lab", ("lab-guard", "lab-track")) == ""
