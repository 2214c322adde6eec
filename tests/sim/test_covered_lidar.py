"""Somebody who stands in the robot's LiDAR is not forgotten: it holds still until he is off."""

import numpy as np
import pytest

from cohelm.core.types import Pose, disc
from cohelm.law.reference import Reference, through
from cohelm.scenario.load import robot
from cohelm.sim.run import run
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import Body, world
from cohelm.study.campaign.movers import leg
from tests.few import first

SALLY = robot("sally")
STAYS = 4.0
"""For so long [s]."""
DEAD_END = [[-0.6, -0.4, 4, -0.4], [-0.6, 0.4, 4, 0.4], [-0.6, -0.4, -0.6, 0.4]]
SHUT = [*DEAD_END, [1.0, -0.4, 1.0, 0.4]]
"""Both too narrow to turn in, and look behind for another way or turn the LiDAR out of his."""


def visit(there, spot):
    """From there to a spot, a stay of 4 s, and back."""
    times, pieces = leg(np.array(there), np.array(spot), 0.8)
    back, pieces_back = leg(np.array(spot), np.array(there), 0.8)
    stay = np.array([[0, 0, 0, spot[0], 0, 0, 0, spot[1]]])
    steps = [*times, times[-1] + STAYS]
    knots = np.array([0.0, *steps, *(steps[-1] + t for t in back)])
    path = Reference(knots, np.vstack((pieces, stay, pieces_back)), 1.0)
    return Body(disc(*there, 0.3, 0.8), path)


@pytest.mark.parametrize(
    ("walls", "there", "spot"),
    first([(SHUT, (-2.5, 0.1), (0.5, 0.0)), (DEAD_END, (3.5, 0.0), (0.0, 0.0))]),
    ids=["from behind", "from ahead"],
)
def test_the_robot_stands_while_a_person_covers_its_lidar(walls, there, spot):
    """He comes up a dead end, or from where nothing looks; after a while no track tells of him."""
    setup = Setup(
        Pose(0.0, 0.0, 0.0), through([[0, 0], [2, 0], [3.5, 0]], 0.5), SALLY.outline,
        SALLY.bounds(), obstacles=world(([visit(there, spot)], np.array(walls, dtype=float))),
        dt=0.02, names=("who",), duration=13.0,
    )  # fmt: skip
    made = run(with_pilot(setup, lidars=SALLY.lidars))
    rows, who = made.rows, made.discs[:, 0]
    x, y = (rows["x"] + 0.3 * np.cos(rows["psi"]), rows["y"] + 0.3 * np.sin(rows["psi"]))
    covered = np.flatnonzero(np.hypot(x - who[:, 0], y - who[:, 1]) < 0.3)
    assert len(covered) > STAYS / 0.02
    known = covered[20:]  # a scan later, and it has stopped
    assert not rows["applied_v"][known].any()
    assert not rows["applied_omega"][known].any()
    gone = rows[covered[-1] + 50 :]
    assert np.hypot(gone["applied_v"], gone["applied_omega"]).max() > 0.05  # not for ever
