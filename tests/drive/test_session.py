"""How careful a session's guard is, before anything is started."""

import pytest

from cohelm.drive.session import Plan, driver_of
from cohelm.drive.simulated import simulated


@pytest.mark.parametrize(("kind", "steps"), [("kinematic", 2), ("twin", 4)])
def test_the_guard_has_room_for_the_lidars_noise_and_foresees_the_whole_lag(kind, steps):
    """50 ms of delay; the twin's drives lag by 20 more, and speed follows a line through a step."""
    plan = Plan(simulated("lab-guard", kind, real_time=False))
    driver = driver_of(plan, real_time=False)
    assert driver.pilot is not None
    room = 2.0 * (0.008 + 0.02)
    law = plan.robot.scenario.law
    rules = driver.pilot.settings.rules
    assert rules.clear == pytest.approx(law.guard.clear_m + room)
    assert rules.margin == pytest.approx(law.guard.margin_m + room)
    assert driver.pilot.planner.manners.gap == pytest.approx(law.manners().gap + room)
    assert driver.pilot.planner.care.accept == pytest.approx(law.care().accept + room)
    assert driver.pilot.planner.care.slack == pytest.approx(law.care().slack + 0.04)
    assert len(driver.pilot.sent) == steps
