"""An attacker's stick against a filter, in one compiled call."""

import numpy as np
import pytest

from cohelm.law.guard.rules import Rules
from cohelm.study.campaign import adversary
from cohelm.study.campaign.episode import attacked, least_clearance
from cohelm.study.campaign.scoring import run_episode

SEED = 5
pytestmark = pytest.mark.xdist_group("adversarial")  # which takes a worker 13 s to compile


@pytest.mark.parametrize("number", range(24))
def test_no_attack_touches_anything_while_the_robot_moves(number):
    row = run_episode(adversary.case(SEED, number), "guard")
    assert row.contacts_moving == 0
    assert row.min_clearance_moving_m >= Rules().hard_margin / 2
    assert row.limit_excess == 0.0


def test_the_attacks_are_worth_the_name():
    rows = [run_episode(adversary.case(SEED, number), "none") for number in range(24)]
    assert sum(row.contacts_moving > 0 for row in rows) > 18


@pytest.mark.parametrize("law", ["guard", "paper", "none"])
def test_with_and_without_a_trace_it_is_the_same_drive(law):
    case = adversary.case(SEED, 3)
    seen = run_episode(case, law)
    assert least_clearance(case, law) == pytest.approx(seen.min_clearance_moving_m, abs=1e-12)


def test_walkers_keep_to_their_speed_and_acceleration_to_the_last_digit():
    cases = [adversary.case(SEED, number) for number in range(2, 40, 4)]
    for case in cases:
        assert case.rollout is not None
        moving = np.flatnonzero(case.rollout.scene.max_acceleration)
        discs = attacked(case, "guard").discs[:, moving]
        speed = np.hypot(discs[:, :, 2], discs[:, :, 3])
        push = np.hypot(*np.diff(discs[:, :, 2:4], axis=0).transpose(2, 0, 1)) / 0.02
        assert moving.size
        assert speed.max() <= case.rollout.scene.walk + 1e-12
        assert push.max() <= 1.0 + 1e-9
        mean = 0.5 * (discs[1:, :, 2:4] + discs[:-1, :, 2:4])
        assert np.abs(np.diff(discs[:, :, :2], axis=0) - 0.02 * mean).max() < 1e-12


def test_a_search_finds_the_same_every_time_and_worse_than_chance():
    case = adversary.case(SEED, adversary.SEARCH_EVERY - 1)
    first = adversary.searched(case, "guard", 60)
    assert case.kind.startswith("search")
    assert first.evaluations == 60
    again = adversary.searched(case, "guard", 60)
    assert (first.clearance, first.case.rollout.attack.script.tolist()) == (  # type: ignore[union-attr]
        again.clearance, again.case.rollout.attack.script.tolist())  # type: ignore[union-attr]  # fmt: skip
    still = adversary.scripted(case, [0.0] * 40)
    assert first.clearance < least_clearance(still, "guard")
    assert first.clearance >= Rules().hard_margin / 2
