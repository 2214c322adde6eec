"""Whatever bytes come on any topic: no crash, no command beyond the limits, and it drives again."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from tests.ros import fuzz, fuzz_types

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.mark.parametrize("seconds", [3.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_whatever_bytes_come_nothing_breaks_and_it_drives_again(seconds):
    assert fuzz.main(seconds, seed=5) == []


@pytest.mark.slow
def test_bytes_that_are_no_message_do_not_move_the_robot():
    assert fuzz.main(120.0, seed=6, driven=False) == []


@pytest.mark.parametrize("seconds", [0.5, pytest.param(600.0, marks=pytest.mark.slow)])
def test_each_type_that_is_read_takes_any_bytes(seconds):
    assert fuzz_types.main(seconds, seed=11) == []
