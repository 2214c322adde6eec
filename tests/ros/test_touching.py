"""Over DDS: glass that a sonar sees, a bumper that is pressed, a drop that a Create 3 tells of."""

from __future__ import annotations

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from tests.ros.stage import stage, until

pytestmark = [pytest.mark.xdist_group("realtime"), pytest.mark.slow]
FRONT = 0.36
"""From Sally's origin to her bow [m]."""


def said(made, words: str) -> bool:
    return until(lambda: any(words in one for one in list(made.filter.said)), 5.0)


def test_it_stops_before_a_wall_that_only_a_sonar_sees():
    with stage(robot="touching") as made:
        made.base.fault("glass")
        assert made.drives(0.4)
        assert made.stands(15.0)
        assert 4.0 - 0.5 < made.base.truth().pose.x + FRONT < 4.0


@pytest.mark.parametrize(
    ("fault", "words"),
    [("bump", "the front bumper is pressed"), ("drop", "the left cliff sensor sees no floor")],
)
def test_driven_against_it_latches_and_after_a_reset_only_backs(fault, words):
    with stage(robot="touching") as made:
        assert made.drives(0.4)
        made.base.fault(fault)
        assert made.stands(2.0)
        assert made.filter.latched
        assert said(made, words)
        made.filter.node._reset_asked = True
        assert until(lambda: not made.filter.latched, 5.0)
        assert made.stands()
        assert said(made, "only drive away")
        where = made.base.truth().pose.x
        made.base.fault("")
        made.base.fault(fault)
        assert made.drives(-0.2)
        assert made.base.truth().pose.x < where


def test_without_the_bumpers_messages_it_stands_and_names_it():
    with stage(robot="touching") as made:
        assert made.drives(0.4)
        made.base.fault("no bumper")
        assert made.stands()
        assert said(made, "nothing is heard of the front bumper")
        made.base.fault("")
        assert made.drives(0.3)
