"""Whoever drives by hand is alone with the robot: the controller asks for nothing by itself."""

import math

import pytest

from cohelm.core.types import Pose, Stick, Twist, disc
from cohelm.law.guard.surroundings import surroundings
from cohelm.loop.driver import Driver
from cohelm.pilot.step import EVADING
from tests.pilot.drives import DT, SETTINGS


@pytest.mark.parametrize("gently", [False, True])
def test_by_hand_with_the_stick_centred_it_makes_way_for_nobody(gently):
    """Not with evasion on either, as it is by default: somebody walks at the standing robot."""
    assert SETTINGS.evasion.horizon > 0.0
    driver = Driver(None, SETTINGS, 0.0, None)
    for k in range(150):
        walker = disc(2.0 - 0.8 * k * DT, 0.0, 0.25, 0.75, -0.8, 0.0)
        seen = surroundings([walker], [1.0])
        driver.moved(Twist(0.0, 0.0))
        d = driver.by_hand(k * DT, Pose(0.0, 0.0, math.pi / 2), Stick(0.0, 0.0), seen, gently)
        assert (d.safe_v, d.safe_omega) == (0.0, 0.0)
        assert d.behavior != EVADING
        driver.given(Twist(d.safe_v, d.safe_omega))
