"""How near the robot came to those who move: told by the real outline, and of nobody else."""

import numpy as np
import pytest
from shapely.geometry import Point, Polygon

from cohelm.core.row import ROW
from cohelm.core.types import disc
from cohelm.law.reference import through
from cohelm.sim.judge import FAR
from cohelm.sim.world import Body, ever_moving, world
from cohelm.study.campaign.scoring import INTIMATE, Proximity, approached

LONG = np.array([[0.5, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.5, -0.2]])


def test_the_clearance_to_movers_is_from_the_real_outline():
    random = np.random.default_rng(3)
    n, m = 200, 5
    rows, discs = np.zeros(n, dtype=ROW), np.zeros((n, m, 6))
    for name in ("x", "y"):
        rows[name] = random.uniform(-1.0, 1.0, n)
    rows["psi"] = random.uniform(-3.0, 3.0, n)
    discs[:, :, :2] = random.uniform(-1.5, 1.5, (n, m, 2))
    discs[:, :, 4] = 0.0
    radius = 0.2
    for k in range(n):
        for i in range(m):
            discs[k, i] = disc(discs[k, i, 0], discs[k, i, 1], radius)
    who = np.array([True, False, True, False, False])
    gaps = np.full(n, FAR)
    for k, row in enumerate(rows):
        c, s = np.cos(row["psi"]), np.sin(row["psi"])
        corners = LONG @ np.array([[c, s], [-s, c]]) + [row["x"], row["y"]]
        for i in np.flatnonzero(who):
            away = Polygon(corners).distance(Point(discs[k, i, :2])) - radius
            gaps[k] = min(gaps[k], away)
    seen = approached(Proximity(), rows[:90], discs[:90], LONG, who)
    seen = approached(seen, rows[90:], discs[90:], LONG, who)
    outside = gaps > -radius  # shapely tells no depth beneath the outline
    assert seen.near == np.count_nonzero(gaps < INTIMATE)
    assert seen.closest == pytest.approx(gaps.min(), abs=1e-9) or not outside.all()


def test_a_robot_without_movers_has_no_mover_near():
    rows, discs = np.zeros(3, dtype=ROW), np.full((3, 1, 6), 0.0)
    assert approached(Proximity(), rows, discs, LONG, np.array([False])) == Proximity(FAR, 0)


def test_movers_are_who_drift_or_follow_a_path():
    rest, drifts = disc(1.0, 0.0, 0.2), disc(2.0, 0.0, 0.2, vx=0.3)
    path = through([(0.0, 0.0), (1.0, 0.0), (2.0, 0.5)], 0.5)
    made = world(([Body(rest), Body(drifts), Body(rest, path)], np.empty((0, 4))))
    assert ever_moving(made).tolist() == [False, True, True]
