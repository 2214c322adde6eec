import os

import pytest

from tests.law.guard.mutants import chosen, survives, survivors


@pytest.mark.slow
def test_nine_slips_of_ten_are_noticed():
    """200 mutants, about 15 minutes on two cores; survivors are listed in docs/guard.md."""
    alive = survivors(200, seed=1, jobs=os.cpu_count() or 1)
    assert len(alive) <= 20, "\n".join(f"{m.file}:{m.line} {m.slip}" for m in alive)


def test_a_slip_in_the_certificate_is_noticed():
    """The campaign above is only worth something if a dead mutant is reported as dead."""
    slip = next(m for m in chosen(10**6, 0, "certify.py") if "< allowed" in m.slip)
    assert not survives(slip)
