"""Back on the path after the person let go: what counts, and what as neither."""

import math

import numpy as np
import pytest

from cohelm.core.row import ROW
from cohelm.study.campaign.scoring import recovery


def drive(*, led, off):
    """Rows of a drive: who leads, and how far the robot is off its path, step by step."""
    rows = np.zeros(len(led), dtype=ROW)
    rows["authority_x"] = rows["authority_psi"] = np.where(led, 0.1, 1.0)
    rows["e_p"] = off
    return rows


def test_the_time_from_release_until_it_is_back_counts():
    rows = drive(led=[1] * 10 + [0] * 90, off=[1.0] * 60 + [0.01] * 40)
    assert recovery(rows, False) == (pytest.approx(1.0), 0)


def test_leading_again_before_the_return_gives_no_recovery_time():
    """Nor is the release before ever recovered from by what came after he led again."""
    rows = drive(led=[1] * 10 + [0] * 10 + [1] * 30 + [0] * 50, off=[1.0] * 60 + [0.01] * 40)
    time, never = recovery(rows, False)
    assert (time, never) == (pytest.approx(0.2), 0)


def test_a_robot_that_stays_at_its_release_point_never_recovers():
    rows = drive(led=[1] * 10 + [0] * 90, off=1.0)
    time, never = recovery(rows, False)
    assert math.isnan(time)
    assert never == 1


def test_without_an_operator_there_is_nothing_to_recover_from():
    time, never = recovery(drive(led=[0] * 100, off=1.0), False)
    assert math.isnan(time)
    assert never == 0


def test_a_robot_that_arrives_needs_no_path():
    rows = drive(led=[1] * 10 + [0] * 90, off=1.0)
    assert recovery(rows, True)[1] == 0
