"""A drive is scored alike in one piece and in many."""

from dataclasses import replace

import pytest

from cohelm.study.campaign.episode import Interventions, attacked
from cohelm.study.campaign.scoring import scored
from cohelm.study.campaign.suites import suite

pytestmark = pytest.mark.xdist_group("adversarial")  # which is compiled once for them


@pytest.mark.parametrize("number", range(1, 25))
def test_a_drive_is_scored_alike_whole_and_piece_by_piece(number):
    """As a campaign does, and the replay of an episode."""
    case = suite("adversary", 1, None).case(number)
    whole = attacked(case, "guard")
    parts = [
        replace(
            whole, rows=whole.rows[k : k + 100], h=whole.h[k : k + 100],
            discs=whole.discs[k : k + 100],
        )
        for k in range(0, len(whole.rows), 100)
    ]  # fmt: skip
    once, often = (
        scored(case, "guard", iter(pieces), Interventions()) for pieces in ((whole,), parts)
    )
    assert repr(often) == repr(once)
