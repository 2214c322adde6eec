"""Cheapest paths over a grid, against scipy's Dijkstra on the same graph."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cohelm.plan.path_planner import NOT_REACHED, tree


def lengths(free, cost, root):
    """What the cheapest way from the root costs, to every cell."""
    rows, columns = free.shape
    tails, heads, weights = [], [], []
    for i in range(rows):
        for j in range(columns):
            for a, b in ((i, j + 1), (i + 1, j), (i + 1, j + 1), (i + 1, j - 1)):
                if 0 <= b < columns and a < rows and free[i, j] and free[a, b]:
                    tails.append(i * columns + j)
                    heads.append(a * columns + b)
                    weights.append(0.5 * math.hypot(a - i, b - j) * (cost[i, j] + cost[a, b]))
    n = rows * columns
    graph = coo_array((weights, (tails, heads)), shape=(n, n)).tocsr()
    return dijkstra(graph, directed=False, indices=root)


def walked(before, cost, cell, root):
    """What the way back from a cell costs."""
    columns = cost.shape[1]
    total = 0.0
    while cell != root:
        one, other = divmod(cell, columns), divmod(int(before[cell]), columns)
        step = math.hypot(one[0] - other[0], one[1] - other[1])
        total += 0.5 * step * (cost[one] + cost[other])
        cell = int(before[cell])
    return total


@pytest.mark.parametrize("seed", range(12))
def test_the_path_to_the_target_is_the_cheapest_there_is(seed):
    rng = np.random.default_rng(seed)
    free = rng.random((15, 22)) < 0.75
    cost = 1.0 + rng.random(free.shape) * rng.choice([0.0, 3.0])
    free[0, 0] = free[14, 21] = True
    before = tree(free, cost, 0, free.size - 1)
    best = lengths(free, cost, 0)[-1]
    if math.isinf(best):
        assert before[-1] == NOT_REACHED
    else:
        assert walked(before, cost, free.size - 1, 0) == pytest.approx(best)


def test_without_a_path_all_that_can_be_reached_is_known():
    free = np.ones((6, 9), dtype=bool)
    free[:, 5] = False
    before = tree(free, np.ones(free.shape), 0, 8).reshape(free.shape)
    assert (before[:, :5] != NOT_REACHED).all()
    assert (before[:, 5:] == NOT_REACHED).all()


def test_from_inside_an_obstacle_nothing_is_reached():
    free = np.ones((3, 3), dtype=bool)
    free[1, 1] = False
    assert (tree(free, np.ones(free.shape), 4, 0) == NOT_REACHED).all()
