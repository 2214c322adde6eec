"""What the guard is handed is checked before, and refused with the cure."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.rules import Rules, checked_rules
from cohelm.law.guard.surroundings import surroundings
from cohelm.robot.footprint import convex_outline
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits, checked_limits
from tests.law.guard.scenes import RULES, SALLY, SALLY_LIMITS, guard_step

AHEAD = surroundings(points=[[0.41, 0.0]])
"""A point 5 cm before the bow."""


@pytest.mark.parametrize(
    "corners",
    [
        SALLY[::-1],
        np.vstack((SALLY[::-1], SALLY[-1:])),
        np.insert(SALLY, 1, [0.0, 0.29], axis=0)[::-1],
        SALLY.tolist()[::-1],
        np.asfortranarray(SALLY[::-1].astype(np.float32)),
    ],
    ids=["clockwise", "closed", "a corner within an edge", "lists", "float32"],
)
def test_no_order_of_the_corners_lets_the_robot_drive_into_what_is_ahead(corners):
    outline = convex_outline(corners)
    pose, twist = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)
    for _ in range(100):
        got = guard_step(pose, twist, Twist(1.0, 0.0), AHEAD, outline, SALLY_LIMITS)
        twist = Twist(got.twist.v, 0.0)
        pose = arc(pose, twist, RULES.dt)
        assert 0.41 - 0.36 - pose.x >= RULES.hard_margin / 2


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([[0.36, 0.29], [-0.36, -0.29]], "at least 3 different corners, got 2"),
        ([[0.36, 0.0], [0.0, 0.0], [-0.36, 0.0]], "on a line"),
        ([*SALLY.tolist(), [0.1, 0.0]], "dent at \\[0.1, 0\\]"),
        ([[1, 1], [-1, -1], [-1, 1], [1, -1]], "crosses itself"),
        ([[math.cos(a), math.sin(a)] for a in 0.8 * math.pi * np.arange(5)], "crosses itself"),
        ((1000 * SALLY).tolist(), "millimetres"),
        ([[0.36, 0.29], [-0.36, 0.29], [-0.36, math.nan]], "finite"),
        ([0.36, 0.29], "list of corners"),
        ([[0.36, 0.29, 0.0]] * 3, "list of corners"),
        ("sally", "list of corners"),
        (None, "list of corners"),
        ([], "list of corners"),
    ],
)
def test_no_outline_passes_for_which_nothing_could_be_promised(corners, said):
    with pytest.raises(CohelmError, match=said):
        convex_outline(corners)


@pytest.mark.parametrize("name", Limits._fields)
@pytest.mark.parametrize("bad", [math.nan, 0.0, -1.0, -math.inf])
def test_no_limit_passes_that_is_not_greater_than_0(name, bad):
    with pytest.raises(CohelmError, match=rf"limits\.{name} must be (greater than 0|a length)"):
        checked_limits(SALLY_LIMITS._replace(**{name: bad}))


@pytest.mark.parametrize("limits", [(1.0, 2.0), None, (1.0,) * 7, {"speed": 1.0}])
def test_limits_of_another_type_are_refused(limits):
    with pytest.raises(CohelmError, match=r"must be a cohelm\.Limits, got"):
        checked_limits(limits)


@pytest.mark.parametrize("bad", ["fast", "0.8", None, True, [1.0]])
def test_a_limit_that_is_no_number_is_named(bad):
    with pytest.raises(CohelmError, match=r"limits\.yaw_rate must be a number, got"):
        checked_limits(SALLY_LIMITS._replace(yaw_rate=bad))


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        *(
            (n, b)
            for n in ("dt", "hard_margin", "steer_weight")
            for b in (0.0, -1.0, math.nan, math.inf)
        ),
        *(("deceleration_fraction", b) for b in (0.0, -0.5, 1.01, math.nan)),
        ("soft_margin", math.nan),
        ("soft_margin", math.inf),
    ],
)
def test_no_rule_passes_that_makes_no_sense(name, bad):
    with pytest.raises(CohelmError, match=f"{name} must be"):
        checked_rules(Rules()._replace(**{name: bad}))
