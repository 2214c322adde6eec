"""Along a corridor: what a match does not show, and what two submaps show together."""

import math

import numpy as np
import pytest

from cohelm.core.frames import between
from cohelm.core.types import Pose
from cohelm.perceive.map.corridor import shifted
from cohelm.perceive.map.place_graph import Place, PlaceGraph
from cohelm.perceive.map.pose_graph import Link
from cohelm.perceive.match.scan_matching import MatchParams, align, observed
from cohelm.perceive.match.surfaces import FlatPoints, behind, seen_from, surfaces

LONG, WIDE, DEEP = 20.0, 2.0, 0.15
DOORS = [(3.0, 3.9), (6.2, 7.1), (10.5, 12.0), (16.1, 17.0)]
X = np.array([1.0, 0.0])


def corridor(doors, way):
    """Points and normals of a corridor as seen by one that drives along it, `way` 1 or -1: of door
    frames it sees the faces that look towards it."""
    x = np.arange(0.0, LONG, 0.04)
    inside = np.zeros(len(x), bool)
    jambs = []
    for first, last in doors:
        inside |= (x > first) & (x < last)
        y = np.arange(-DEEP, 0.0, 0.03)
        jambs.append(np.column_stack((np.full(len(y), last if way > 0 else first), y)))
    low = np.column_stack((x, np.where(inside, -DEEP, 0.0)))
    high = np.column_stack((x, np.full(len(x), WIDE)))
    faces = np.vstack([np.empty((0, 2)), *jambs])
    points = np.vstack((low, high, faces))
    across = np.repeat([[0.0, 1.0], [0.0, -1.0], [-way, 0.0]], [len(x), len(x), len(faces)], axis=0)
    return FlatPoints(points, across.astype(float))


def within(flat, x, near):
    """Those within that of x along the corridor."""
    some = np.abs(flat.points[:, 0] - x) < near
    return FlatPoints(*(part[some] for part in flat))


def known(flat):
    made = surfaces(flat, 0.05, 0.65)
    return made._replace(back=behind(made))


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("off", [-0.6, 0.0, 0.33])
def test_submaps_find_their_place_along_a_corridor_with_doors(way, off):
    """Also where the second one drove the other way, and saw no face that the first one saw."""
    around = known(corridor(DOORS, 1))
    found = shifted(around, corridor(DOORS, way), Pose(off, 0.0, 0.0), X, 1.0, 0.15)
    assert found.along == pytest.approx(-off, abs=0.05)
    assert found.lead > math.log(99.0)
    assert found.information > 400.0  # 5 cm


def test_in_a_plain_corridor_no_place_leads():
    flat = corridor([], 1)
    middle = within(flat, 0.5 * LONG, 6.0)
    found = shifted(known(flat), middle, Pose(0.2, 0.0, 0.0), X, 1.0, 0.15)
    assert found.lead < 1e-3


def test_a_place_at_the_end_of_what_was_searched_does_not_lead():
    flat = corridor(DOORS, 1)
    found = shifted(known(flat), flat, Pose(1.3, 0.0, 0.0), X, 1.0, 0.15)
    assert found.lead == 0.0


def test_a_match_in_a_plain_corridor_knows_nothing_along_it():
    """Normals of measured points scatter by some degrees, here by 4: that is no information."""
    rng, along, claimed = np.random.default_rng(0), [], []
    for _ in range(40):
        flat = corridor([], 1)
        seen = within(flat, 0.5 * LONG, 6.0)
        surely = known(tilted(flat, rng))
        fit = align(surely, tilted(seen, rng), Pose(0.0, 0.0, 0.0), 10.0 * np.eye(3), MatchParams())
        claimed.append(fit.information[0, 0])
        information = observed(surely, tilted(seen, rng), fit.pose, MatchParams())
        along.append(information[0, 0])
        assert information[1, 1] == pytest.approx(fit.information[1, 1], rel=0.02)
        assert np.linalg.eigvalsh(information)[0] > -1e-6
    assert np.mean(claimed) > 300.0
    assert np.mean(along) < 0.1 * np.mean(claimed)


def tilted(flat, rng):
    points, (x, y) = flat.points, flat.normals.T
    angles = rng.normal(0.0, math.radians(4.0), len(points))
    c, s = np.cos(angles), np.sin(angles)
    return FlatPoints(points, np.column_stack((c * x - s * y, s * x + c * y)))


def test_a_corridor_that_is_driven_both_ways_is_drawn_once():
    """The way back lies 60 cm off along it: no face that one way saw was seen by the other."""
    graph = PlaceGraph()
    there = [Pose(4.0 + 0.4 * k, 0.9, 0.0) for k in range(32)]
    back = [Pose(pose.x, 1.1, math.pi) for pose in reversed(there)]
    for k, pose in enumerate([*there, *back]):
        near = within(corridor(DOORS, 1 if k < len(there) else -1), pose.x, 4.0)
        seen = seen_from(between(pose, Pose(0.0, 0.0, 0.0)), near)
        off = pose if k < len(there) else pose._replace(x=pose.x + 0.6)
        step = None
        if k > 0:
            weak = np.diag([2.0, 1e4, 1e5]) if k == len(there) else 1e4 * np.eye(3)
            step = Link(k - 1, k, between(graph.poses[-1], off), weak, False)
        graph.add(Place(k, seen), off, step)
    for move in (True, False):
        graph.link_all(lambda share: None, move=move)
    along = [found.x - true.x for found, true in zip(graph.poses, [*there, *back], strict=True)]
    assert np.abs(along).max() < 0.05
