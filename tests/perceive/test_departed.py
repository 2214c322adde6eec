"""A mover that left the view is remembered once, and only until it is seen again."""

import math

import numpy as np
import pytest

from cohelm.core.types import Floats, Pose
from cohelm.perceive.scan.deskew import NO_SWEEP, DeskewedScan
from cohelm.perceive.track.departed import departed, out_of_view
from cohelm.perceive.track.params import PotentiallyDynamicParams
from cohelm.perceive.track.track import (
    COLUMNS,
    MISSED,
    MOVES,
    PP,
    RADIUS,
    RR,
    SEEN,
    TAX,
    TAY,
    TVX,
    TVY,
    TX,
    TY,
    VV,
    keep_as_seen,
    no_tracks,
)
from cohelm.scenario.load import robot

LIDAR = robot("sally").lidar.lidar()
EDGE = LIDAR.first + (len(LIDAR.beams) - 1) * LIDAR.step
DT, AGILE, WARY = 0.1, 1.0, PotentiallyDynamicParams()
NOBODY, NOTHING = no_tracks(), np.empty((0, 3))


def at(far: float, bearing: float) -> tuple[float, float]:
    return far * math.cos(bearing), far * math.sin(bearing)


def looks(*headings: float) -> tuple[DeskewedScan, ...]:
    """Sweeps by a LiDAR at the origin, `DT` apart."""
    return tuple(
        NO_SWEEP._replace(
            ranges=np.full(len(LIDAR.beams), np.inf),
            sensor=Pose(0.0, 0.0, psi),
            stamp=DT * k,
            lidar=LIDAR,
        )
        for k, psi in enumerate(headings)
    )


def track(
    place: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0), *, seen: int = 3,
    missed: float = 0.0,
) -> Floats:  # fmt: skip
    one = np.zeros((1, COLUMNS))
    one[0, [TX, TY, TVX, TVY]] = *place, *velocity
    one[0, [RADIUS, RR, PP, VV]] = 0.3, 1e-4, 0.01, 0.01
    one[0, [SEEN, MISSED, MOVES]] = seen, missed, 1.0
    keep_as_seen(one[0])
    return one


def rim(place: tuple[float, float], stood: float = 0.0) -> Floats:
    """The near half of a disc of 30 cm as loose points, as a LiDAR at the origin sees it."""
    toward = math.atan2(-place[1], -place[0])
    turned = toward + np.linspace(-1.5, 1.5, 16)
    x, y = place[0] + 0.3 * np.cos(turned), place[1] + 0.3 * np.sin(turned)
    return np.column_stack((x, y, np.full(16, stood)))


def after(before: Floats, came: Floats, points: Floats, sweeps: tuple[DeskewedScan, ...]) -> Floats:
    return departed(before, NOBODY, came, points, sweeps, DT, AGILE, WARY)


def test_the_potentially_dynamic_points_of_one_body_are_one_mover_out_of_view():
    gone = after(NOBODY, NOBODY, rim(at(1.2, EDGE - 0.1)), looks(0.0))
    assert len(gone) == 1
    where = out_of_view(NOBODY, gone, AGILE)[0]
    far = np.hypot(*(rim(at(1.2, EDGE - 0.1))[:, :2] - where[:2]).T)
    assert far.max() < where[4] + 0.05  # it may be wherever its points are


def test_two_bodies_are_two():
    both = np.vstack((rim(at(1.2, -EDGE + 0.1)), rim(at(1.2, EDGE - 0.1))))
    assert len(after(NOBODY, NOBODY, both, looks(0.0))) == 2


def test_potentially_dynamic_points_amid_the_view_have_not_left_it():
    assert not len(after(NOBODY, NOBODY, rim(at(1.2, 0.0)), looks(0.0)))


def test_potentially_dynamic_points_are_deleted_with_the_mover_they_belong_to():
    """It was in view all along: its points were potentially dynamic, until its motion was
    proved."""
    place = at(1.2, EDGE - 0.1)
    gone = after(NOBODY, NOBODY, rim(place), looks(0.0))
    assert not len(after(gone, track(place, seen=10), NOTHING, looks(0.0, 0.0)))


def test_potentially_dynamic_points_of_another_object_stay():
    gone = after(NOBODY, NOBODY, rim(at(1.2, EDGE - 0.1)), looks(0.0))
    assert len(after(gone, track(at(1.2, 0.0), seen=10), NOTHING, looks(0.0, 0.0))) == 1


@pytest.mark.parametrize("turn", [0.1, 0.16, 0.2])
@pytest.mark.parametrize("far", [1.0, 5.0])
def test_a_mover_that_comes_into_view_as_the_robot_turns_is_no_longer_out_of_view(
    turn: float, far: float
):
    """As far within the view as the robot turns in one sweep. Its motion is proved two sweeps
    later."""
    place = at(far, EDGE + 0.05 * turn)
    gone = track(place, missed=1.5)
    sweeps = looks(0.0, 0.0, turn, 2.0 * turn, 3.0 * turn)
    assert not len(after(gone, track(place, seen=2), NOTHING, sweeps))


def test_a_mover_that_was_in_view_all_along_is_not_the_one_that_left_it():
    gone = track(at(3.0, EDGE + 0.2), missed=1.5)
    assert len(after(gone, track(at(3.0, EDGE - 0.5), seen=2), NOTHING, looks(*[0.0] * 5))) == 1


@pytest.mark.parametrize("turns", [0.2, 10.0])
def test_out_of_view_a_mover_is_within_its_bound_however_it_accelerates_and_the_bound_is_no_wider(
    turns: float,
):
    """Its acceleration, which changes every `turns` [s], counts once: as what it may do."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        gone = track(at(3.0, math.pi), tuple(rng.uniform(-1.0, 1.0, 2)))
        gone[0, [TAX, TAY]] = rng.uniform(-0.7, 0.7, 2)
        place, velocity = gone[0, [TX, TY]].copy(), gone[0, [TVX, TVY]].copy()
        push, t = np.zeros(2), 0.0
        for k in range(20):
            if k % round(turns / DT) == 0:
                way = rng.uniform(-math.pi, math.pi)
                push = AGILE * np.array((math.cos(way), math.sin(way)))
            place, velocity = place + DT * velocity + 0.5 * DT * DT * push, velocity + DT * push
            gone, t = after(gone, NOBODY, NOTHING, looks(0.0)), t + DT
            *middle, _, _, reach, unseen = out_of_view(NOBODY, gone, AGILE)[0]
            assert unseen == pytest.approx(t)
            assert np.hypot(*(place - middle)) <= reach - 0.3
            deviation = math.hypot(0.1, 0.1 * t)  # of its position; as seen, 0.1 m and 0.1 m/s
            assert reach == pytest.approx(0.3 + 2.0 * deviation + 0.5 * AGILE * t * t)
