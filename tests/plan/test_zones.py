"""Zones of the map: what stands in the way of a robot outside, inside, and on its way out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cohelm.core.frames import compose, inverse, placed
from cohelm.core.types import Pose
from cohelm.plan.zones import Cells, Fence, SpeedZones, covering, keep_out

OUTLINE = np.array([(-0.36, -0.29), (0.36, -0.29), (0.36, 0.29), (-0.36, 0.29)])
ORIGIN = Pose(1.0, -2.0, 0.3)


def mask(*boxes: tuple[float, float, float, float], side: float = 0.05) -> np.ndarray:
    """6 m by 4 m of cells, of which those in boxes (x1, y1, x2, y2) of its own axes are marked."""
    made = np.zeros((round(4.0 / side), round(6.0 / side)), np.bool_)
    for x1, y1, x2, y2 in boxes:
        rows = slice(round(y1 / side), round(y2 / side))
        made[rows, round(x1 / side) : round(x2 / side)] = True
    return made


def on(x: float, y: float, psi: float = 0.0) -> Pose:
    """A pose of the mask's own axes, on the map."""
    return compose(ORIGIN, Pose(x, y, psi))


def nearest(points: np.ndarray, pose: Pose) -> float:
    body = placed(covering(OUTLINE, 0.05), pose)
    return float(np.hypot(*(points[:, None] - body[None]).transpose(2, 0, 1)).min())


@pytest.mark.parametrize("side", [0.02, 0.05, 0.2, 0.5])
def test_a_zone_stands_as_its_border_without_gaps_however_coarse_its_cells(side):
    box = (2.0, 1.0, 4.0, 3.0)
    points = Fence(keep_out(mask(box, side=side), side, ORIGIN), OUTLINE).points(on(0.5, 0.5))
    own = placed(points, inverse(ORIGIN))
    assert (own >= (2.0, 1.0)).all()
    assert (own <= (4.0, 3.0)).all()
    along = np.linspace(0.0, 2.0, 99)
    for place in [(2.0, 1.0 + y) for y in along] + [(2.0 + x, 3.0) for x in along]:
        assert np.hypot(*(own - place).T).min() <= 0.04


@pytest.mark.parametrize("seed", range(8))
def test_a_robot_inside_has_room_all_round_and_what_is_deeper_stands(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.uniform((1.0, 0.5, 0.5, 0.5), (3.0, 2.0, 2.5, 1.5), (3, 4))
    boxes = [(a, b, a + w, b + h) for a, b, w, h in sizes]
    zones = keep_out(mask(*boxes), 0.05, ORIGIN)
    for _ in range(20):
        pose = on(*rng.uniform((1.0, 0.5, -3.0), (5.0, 3.5, 3.0)))
        fence = Fence(zones, OUTLINE)
        points = fence.points(pose)
        of = zones.depth._replace(values=zones.zone)
        under = set(of.at(placed(covering(OUTLINE, 0.05), pose))) - {0.0}
        deeper = points[np.isin(of.at(points), list(under))]
        assert not len(deeper) or nearest(deeper, pose) > 0.07
        assert under or len(points)


def test_a_robot_leaving_a_zone_finds_it_closed_behind_and_open_ahead():
    fence = Fence(keep_out(mask((1.0, 0.5, 5.0, 3.5)), 0.05, ORIGIN), OUTLINE)
    ways = np.linspace(3.0, 0.3, 60)  # from the middle to the left
    for x in ways:
        points = fence.points(on(x, 2.0))
        assert not len(points) or nearest(points, on(x, 2.0)) > 0.0
    outside = fence.points(on(0.3, 2.0))
    whole = Fence(fence.zones, OUTLINE).points(on(0.3, 2.0))
    assert len(outside) == len(whole)
    # half way out, and back in: it is not let in as deep as it was
    back = Fence(fence.zones, OUTLINE)
    back.points(on(3.0, 2.0))
    back.points(on(1.2, 2.0))
    shown = back.points(on(1.3, 2.0))
    own = placed(shown, inverse(ORIGIN))
    assert own[:, 0].min() < 1.2 + 0.36 + 0.25


def test_found_deeper_by_a_jump_it_begins_from_there_and_is_not_walled_in():
    fence = Fence(keep_out(mask((1.0, 0.5, 5.0, 3.5)), 0.05, ORIGIN), OUTLINE)
    fence.points(on(1.2, 2.0))
    assert nearest(fence.points(on(1.9, 2.0)), on(1.9, 2.0)) > 0.07


def test_in_one_zone_the_others_stand_whole():
    zones = keep_out(mask((0.5, 0.5, 2.0, 3.5), (4.0, 0.5, 5.0, 3.5)), 0.05, ORIGIN)
    own = placed(Fence(zones, OUTLINE).points(on(1.2, 2.0)), inverse(ORIGIN))
    right = own[own[:, 0] > 3.0]
    assert right[:, 0].min() == pytest.approx(4.025, abs=0.01)


def test_the_lowest_limit_under_the_outline_counts_and_none_beside_the_mask():
    limits = np.zeros((8, 12), np.float32)
    limits[:, 4:6], limits[:, 6:] = 0.5, 0.25
    slow = SpeedZones(Cells(limits, 0.5, ORIGIN), True)
    body = covering(OUTLINE, 0.05)
    said = [slow.limit(placed(body, on(x, 2.0))) for x in (1.0, 2.0, 2.8, 5.0, 30.0)]
    assert said == [math.inf, 0.5, 0.25, 0.25, math.inf]
