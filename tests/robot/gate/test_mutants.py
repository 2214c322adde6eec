"""The gate's tests, tested: would they notice a slip?"""

import os

import pytest

from tests.mutation import every, score, survives
from tests.robot.gate.mutants import GATE


@pytest.mark.slow
def test_every_slip_in_the_gate_is_noticed():
    """All mutants there are, some three minutes on two cores."""
    found = score(GATE, every(GATE), os.cpu_count() or 1)
    assert found.rate == 1.0, str(found)


def test_a_slip_in_the_watchdog_is_noticed():
    slip = next(m for m in every(GATE, "gate.py") if "> rules.watchdog" in m.slip)
    assert not survives(slip, GATE)
