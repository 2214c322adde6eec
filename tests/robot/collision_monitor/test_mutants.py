"""What is said of slips that no test can notice; slow, as the search for slips is."""

import pytest

from tests.law.guard.mutants import GUARD
from tests.mutation import every
from tests.robot.collision_monitor.mutants import COLLISION_MONITOR
from tests.robot.gate.mutants import GATE


@pytest.mark.slow
@pytest.mark.parametrize("target", [GATE, COLLISION_MONITOR, GUARD], ids=lambda of: of.folder)
def test_each_slip_that_none_can_notice_is_one_that_can_still_be_made(target):
    assert set(target.equal) <= {mutant.key for mutant in every(target)}
