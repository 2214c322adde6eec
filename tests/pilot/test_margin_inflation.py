"""The margins have room for the noisiest of a robot's LiDARs."""

import pytest

from cohelm.pilot.margin_inflation import noise
from cohelm.scenario.load import robot


@pytest.mark.parametrize(("behind", "most"), [(0.05, 0.05), (0.0, 0.02)])
def test_the_noisiest_lidar_counts(behind, most):
    model = robot("sally-rear")
    rear = model.further_lidars[0].model_copy(update={"noise_m": behind})
    assert noise(model.model_copy(update={"further_lidars": (rear,)})) == most
    assert noise(robot("husky")) == 0.0
