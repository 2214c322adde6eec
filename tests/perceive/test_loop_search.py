"""The search for loops, and the index that it looks surfaces up in, beside plain twins."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cohelm.core.types import Pose
from cohelm.perceive.map.loop_closure import _most_hits, _peaks, _refined
from cohelm.perceive.match.surfaces import FlatPoints, behind, surfaces, thinned


def walls(seed):
    """Points 5 cm apart on both sides of walls of 20 cm at random, with the visible directions."""
    rng = np.random.default_rng(seed)
    points, across = [], []
    for _ in range(12):
        start, psi = rng.uniform(0.0, 16.0, 2), rng.uniform(-math.pi, math.pi)
        along = np.array([math.cos(psi), math.sin(psi)])
        side = np.array([-along[1], along[0]])
        way = np.arange(0.0, rng.uniform(1.0, 6.0), 0.05)[:, None]
        for sign in (-1.0, 1.0):
            points.append(start + way * along + sign * 0.1 * side)
            across.append(np.tile(sign * side, (len(way), 1)))
    return FlatPoints(np.vstack(points), np.vstack(across))


def hits(known, flat, x, y, psi, near):
    """How many points lie on a surface of their direction and side: a plain twin."""
    turn = np.array([[math.cos(psi), -math.sin(psi)], [math.sin(psi), math.cos(psi)]])
    count = 0
    for p, n in zip(flat.points @ turn.T + (x, y), flat.normals @ turn.T, strict=True):
        u, v = np.floor((p - (known.x, known.y)) / known.resolution).astype(int)
        if not (0 <= v < known.nearest.shape[0] and 0 <= u < known.nearest.shape[1]):
            continue
        i = known.nearest[v, u]
        facing = n @ known.normals[i]
        if facing < -0.85 and known.back[i] >= 0:
            i, facing = known.back[i], -facing
        count += i >= 0 and facing > 0.85 and np.hypot(*(p - known.points[i])) < near
    return count


@pytest.mark.parametrize("seed", range(3))
def test_bounds_leave_the_peaks_that_counting_at_every_pose_finds(seed):
    flat = walls(seed)
    known = surfaces(thinned(flat, 0.04), 0.05, 0.65)
    known = known._replace(back=behind(known))
    rng = np.random.default_rng(seed)
    some = rng.choice(len(flat.points), 40, replace=False)
    seen = FlatPoints(flat.points[some] - (6.0, 5.0), flat.normals[some])
    here = Pose(7.1, 4.3, 0.2)
    cells = np.array([(i, j) for i in range(-4, 4) for j in range(-3, 3)])
    places = 0.6 * cells + here[:2]
    headings = here.psi + 0.1 * np.arange(-6, 7)
    counts = np.array([[hits(known, seen, *p, h, 0.55) for h in headings] for p in places])
    most = _most_hits(known, seen, here, 2 * cells, headings)
    assert (most >= counts).all()
    assert most.mean() < 0.6 * len(some)  # a bound that excludes something
    left, best = counts.copy(), []
    while left.max() > 0 and len(best) < 24:
        place, heading = divmod(int(left.argmax()), len(headings))
        best.append((place, heading))
        near = np.hypot(*(places - places[place]).T) < 1.0
        left[np.ix_(near, np.abs(headings - headings[heading]) < 0.3)] = 0
    assert _peaks(known, seen, places, headings, most) == best

    place, heading = places[best[0][0]], headings[best[0][1]]
    found, pose = _refined(known, seen, place, heading, -1)
    fine = [
        (hits(known, seen, place[0] + 0.3 * i, place[1] + 0.3 * j, heading + t, 0.25))
        for i in range(-2, 3) for j in range(-2, 3) for t in np.radians(3.0) * np.arange(-2, 3)
    ]  # fmt: skip
    assert found == max(fine) == hits(known, seen, *pose, 0.25)
    assert _refined(known, seen, place, heading, found)[0] <= found


def test_each_cell_within_reach_knows_its_nearest_surface():
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, (9.0, 31.0), (300, 2))  # more rows than are filled in at a time
    made = surfaces(FlatPoints(points, np.tile([1.0, 0.0], (300, 1))), 0.05, 0.65)
    rows, columns = made.nearest.shape
    v, u = np.mgrid[:rows, :columns]
    middles = np.stack([made.x + 0.05 * (u + 0.5), made.y + 0.05 * (v + 0.5)], axis=-1)
    gaps, nearest = cKDTree(points).query(middles)
    assert np.array_equal(made.nearest, np.where(gaps < 0.65, nearest, -1))


def test_points_of_one_cell_become_their_mean_and_those_that_face_another_way_do_not_count():
    points = np.array([[0.01, 0.01], [1.0, 0.5], [0.03, 0.02], [0.02, 0.03], [-0.01, 0.01]])
    across = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    kept, sides = thinned(FlatPoints(points, across), 0.04)
    assert kept == pytest.approx(np.array([[-0.01, 0.01], [0.02, 0.015], [1.0, 0.5]]))
    assert sides == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert len(thinned(FlatPoints(points[:0], across[:0]), 0.04).points) == 0
