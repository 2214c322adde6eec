"""A law by somebody else in a campaign: the same episodes and judge, errors with a sentence."""

import math

import pytest

import cohelm
from cohelm.core.errors import CohelmError
from cohelm.study.campaign.replay_episode import drive
from cohelm.study.campaign.runner import CampaignConfig
from cohelm.study.campaign.suites import suite
from cohelm.study.campaign.worker import chunk

ROOMS = suite("random", 1, None)
HERE = "tests.study.campaign.test_external_law"


def ram(robot: cohelm.RobotModel, period: float):
    """At the goal, whatever is in between."""

    def law(now: cohelm.Observation) -> cohelm.Twist:
        turn = math.atan2(now.goal[1] - now.pose.y, now.goal[0] - now.pose.x) - now.pose.psi
        return cohelm.Twist(1.0, 2.0 * math.remainder(turn, 2.0 * math.pi))

    return law


def filtered(robot: cohelm.RobotModel, period: float):
    """The same behind the filter."""
    safe, law = cohelm.SafetyFilter(robot, period), ram(robot, period)
    return lambda now: safe(now.pose, now.twist, law(now), now.obstacles).twist


number = 3


def test_an_external_law_is_judged_like_ours_and_replayed_equally():
    bare = chunk(ROOMS, f"{HERE}:ram", (0, 1, 2))
    safe = chunk(ROOMS, f"{HERE}:filtered", (0, 1, 2))
    assert [row.fault for row in (*bare, *safe)] == [""] * 6
    assert sum(row.contacts_moving for row in bare) > 0
    assert sum(row.contacts_moving for row in safe) == 0
    assert all(row.limit_excess == 0.0 for row in (*bare, *safe))
    assert drive(ROOMS.case(1), safe[1]).same


@pytest.mark.parametrize(
    ("law", "plan", "said"),
    [
        ("mine", {}, "there is no law 'mine': choose guard, .* or give package:factory"),
        (f"{HERE}:gone", {}, "can not be imported"),
        (f"{HERE}:number", {}, "must be a function"),
        (f"{HERE}:ram", {"plant": "twin"}, "a law of your own drives to a goal"),
        (f"{HERE}:ram", {"suite": "adversary"}, "a law of your own drives to a goal"),
    ],
)
def test_no_law_that_can_not_drive_is_begun_with(law, plan, said):
    given = {"suite": "random", "laws": (law,), "seed": 1, "n": 1} | plan
    with pytest.raises(CohelmError, match=said):
        CampaignConfig(**given).prepared()
