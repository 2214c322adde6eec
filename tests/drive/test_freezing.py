"""One of a drive's processes is stopped at random moments: the robot stands in time, or goes on."""

import pytest

from tests.drive.freezing import PROCESSES, rounds

pytestmark = [pytest.mark.xdist_group("realtime"), pytest.mark.slow]


@pytest.mark.parametrize("who", PROCESSES)
def test_whichever_process_freezes_at_any_moment_the_robot_behaves_as_promised(who, tmp_path):
    found = rounds(who, 20, 3, tmp_path)
    assert [one for one in found if one["wrong"]] == []
    if who in ("loop", "gate process"):
        assert any("went_on" not in one for one in found)
