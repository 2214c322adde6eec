"""Processes of a drive freeze at random moments: the robot stops in time, or continues."""

import pytest

from tests.drive.freezing import PROCESSES, rounds

pytestmark = [pytest.mark.xdist_group("realtime"), pytest.mark.slow]


@pytest.mark.parametrize("who", PROCESSES)
def test_the_robot_is_safe_when_any_process_freezes_at_any_moment(who, tmp_path):
    found = rounds(who, 20, 3, tmp_path)
    assert [one for one in found if one["wrong"]] == []
    if who in ("loop", "gate process"):
        assert any("went_on" not in one for one in found)
