import os

import pytest

from tests.law.guard.mutants import GUARD
from tests.mutation import chosen, every, score, survives


@pytest.mark.slow
def test_nine_slips_of_ten_are_noticed():
    """200 mutants, some minutes; survivors are listed."""
    found = score(GUARD, chosen(GUARD, 200, seed=1), os.cpu_count() or 1)
    assert found.rate >= 0.9, str(found)


@pytest.mark.slow
def test_a_slip_in_the_certificate_is_noticed():
    """The campaign above is only worth something if a dead mutant is reported as dead."""
    slip = next(m for m in every(GUARD, "certify.py") if "< allowed" in m.slip)
    assert not survives(slip, GUARD)
