"""No sense is believed alone: whatever it says, nothing is hit by a robot that moves.

A few drives by default; `pytest -m slow tests/drive/test_lies.py` drives all of them, and
`python -m tests.drive.lied` prints what came of each.
"""

import math

import pytest

from tests.drive.lied import HARMFUL, MODES, drive
from tests.drive.lies import LIES
from tests.few import first

SEEDS = (0, 1, 2, 3)
"""Before the robot sets off, at speed, nearer to the wall, and where it has to brake."""
SOME = [
    ("frozen, with new noise", "automatic", 2), ("front quarter infinite", "manual", 3),
    ("0.3 s older than stamped", "manual", 0), ("odometry frozen", "manual", 2),
    ("gyro off by 10 deg/s", "automatic", 1), ("longer by half a metre", "automatic", 23),
    ("all 9.99 m, with noise", "automatic", 11), ("speed half, pose right", "shared", 1),
    ("frozen", "manual", 3), ("all infinite", "manual", 2), ("number stays", "manual", 3),
    ("longer by half a metre", "manual", 0),
]  # fmt: skip


def held(lie: str, mode: str, kind: str, mapped: bool, seed: int) -> None:
    came = drive(lie, mode, kind, mapped, seed)
    assert came.contact <= HARMFUL, came
    promised = LIES[lie]
    if seed in (1, 2):  # it began while the robot drove
        assert came.fast <= promised.within, came
    if promised.about and came.noticed < math.inf:
        assert promised.about in came.reason, came


@pytest.mark.parametrize(("lie", "mode", "seed"), first(SOME, 8))
def test_no_false_reading_drives_the_robot_into_a_wall(lie, mode, seed):
    held(lie, mode, "kinematic", False, seed)


def test_a_lag_that_begins_near_a_wall_of_the_map_is_detected():
    held("0.3 s older than stamped", "automatic", "kinematic", True, 471)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["kinematic", "twin"])
@pytest.mark.parametrize("mode", list(MODES))
@pytest.mark.parametrize("lie", list(LIES))
def test_no_false_reading_of_the_full_set_drives_the_robot_into_a_wall(lie, mode, kind):
    for mapped in (True, False):
        for seed in SEEDS:
            held(lie, mode, kind, mapped, seed)
