"""Before a way that is blocked the robot stands, with room to turn, and does not twitch."""

import numpy as np
import pytest

from cohelm.pilot.behavior import ESCAPING
from cohelm.scenario import load
from cohelm.scenario.build import setup
from cohelm.sim.run import run

REACH = 0.4623  # of Sally's farthest corner [m]


def blocked(senses: str) -> np.ndarray:
    """A minute in a corridor that a wall closes at x = 8 m; the route goes through it."""
    walls = "[[-3, -1.1, 14, -1.1], [-3, 1.1, 14, 1.1], [-3, -1.1, -3, 1.1], [8, -1.1, 8, 1.1]]"
    made = load.scenario(
        "open",
        [
            "reference.waypoints_m=[[0, 0], [4, 0], [8, 0], [12, 0]]", "reference.speed_mps=1",
            f"walls_m={walls}", "simulation.duration_s=60", f"senses={senses}",
        ],
    )  # fmt: skip
    return run(setup(made)).rows


@pytest.mark.parametrize("senses", ["truth", "lidar"])
def test_it_stands_where_it_can_turn_and_backs_off_less_and_less_often(senses):
    rows = blocked(senses)
    assert 8.0 - REACH - 0.15 < rows["x"].max() < 8.0 - REACH
    escapes = rows["behavior"] == ESCAPING
    begun = rows["t"][1:][escapes[1:] & ~escapes[:-1]]
    assert 1 <= len(begun) <= 8
    assert rows["t"][-1] - begun[-1] > 10.0
