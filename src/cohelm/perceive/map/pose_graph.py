"""Pose graph optimisation, solved by gtsam."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from cohelm.core.extras import missing
from cohelm.core.frames import between, compose
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.match.odometry_covariance import inverted

_CHANCE = 0.999  # share of right loops that pass the test alone
CONTRADICTS = 16.3
"""99.9 % quantile of chi squared with three degrees of freedom."""
ROUGH: Floats = np.array([0.01, 0.01, 0.004])
"""Lower bound of the sigma of a match of two submaps [m, rad]."""


class Link(NamedTuple):
    """Place `b` as seen from place `a`, with the information (3, 3) of that pose in the axes of
    b. A loop may be wrong and is rejected then; a step from one place to the next never is."""

    a: int
    b: int
    pose: Pose
    information: Floats
    loop: bool


def loop_link(a: int, b: int, pose: Pose, information: Floats, psi: float) -> Link:
    """The link of a match; information: in axes in which place b has heading psi."""
    rough = np.diag(ROUGH**2)
    weak = into_axes(Pose(0.0, 0.0, psi), information) + np.eye(3)
    return Link(a, b, pose, inverted(inverted(weak) + rough), True)


def into_axes(frame: Pose, information: Floats) -> Floats:
    """Information in world axes, put into the axes of a pose."""
    c, s = math.cos(frame.psi), math.sin(frame.psi)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ information @ turn.T, dtype=np.float64)


def rows(links: Sequence[Link]) -> Floats:
    """Links as rows of numbers, (n, 15)."""
    found = [(k.a, k.b, *k.pose, *k.information.ravel(), k.loop) for k in links]
    return np.array(found, dtype=np.float64).reshape(-1, 15)


def from_rows(found: Floats) -> list[Link]:
    """Links of such rows."""
    return [
        Link(
            int(row[0]), int(row[1]), Pose(*row[2:5].tolist()), row[5:14].reshape(3, 3), row[14] > 0
        )
        for row in found
    ]


def library() -> Any:
    """gtsam, which only mapping needs. CohelmError where it is not installed."""
    try:
        import gtsam
    except ImportError as error:
        raise missing("mapping", "map") from error
    return gtsam


def solved(poses: list[Pose], links: list[Link], wide: float = 1.0) -> list[Pose]:
    """The optimized poses; the first is fixed. `wide`: scale of the Cauchy kernel in sigmas."""
    g = library()
    cauchy = g.noiseModel.mEstimator.Cauchy.Create(wide)
    graph, values = _graph(poses, links, lambda noise: g.noiseModel.Robust.Create(cauchy, noise))
    return _poses(g.LevenbergMarquardtOptimizer(graph, values).optimize())


def consistent(poses: list[Pose], links: list[Link]) -> list[Link]:
    """A consistent subset of the links: all steps, and most of the loops.

    Graduated non-convexity (Yang et al. 2020) on truncated squares: it finds the false loops
    whatever the poses are to begin with, so that none is believed for having come first.
    """
    g = library()
    graph, values = _graph(poses, links, lambda noise: noise)
    params = g.GncLMParams(g.LevenbergMarquardtParams())
    params.setKnownInliers([0, *(i + 1 for i, link in enumerate(links) if not link.loop)])
    optimizer = g.GncLMOptimizer(graph, values, params)
    optimizer.setInlierCostThresholdsAtProbability(_CHANCE)
    optimizer.optimize()
    weights = np.asarray(optimizer.getWeights())[1:]
    return [link for link, weight in zip(links, weights, strict=True) if weight > 0.5]


def _graph(poses: list[Pose], links: list[Link], loop: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Factors, the first place fixed and then the links in order, and values; `loop`: the noise of
    loops, from that of their matches."""
    g = library()
    graph, values = g.NonlinearFactorGraph(), g.Values()
    fixed = g.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))
    graph.add(g.PriorFactorPose2(0, g.Pose2(*poses[0]), fixed))
    informations = np.array([link.information for link in links]).reshape(-1, 3, 3)
    for link, information in zip(links, 0.5 * (informations + informations.mT), strict=True):
        noise = g.noiseModel.Gaussian.Information(information)
        noise = loop(noise) if link.loop else noise
        graph.add(g.BetweenFactorPose2(link.a, link.b, g.Pose2(*link.pose), noise))
    for k, pose in enumerate(poses):
        values.insert(k, g.Pose2(*pose))
    return graph, values


def _poses(result: Any) -> list[Pose]:
    return [Pose(*pose) for pose in library().utilities.extractPose2(result).tolist()]


def off(poses: Sequence[Pose], link: Link) -> Floats:
    """(3,): error of a link at its second place, in the axes of that [m, rad]."""
    return np.array(between(poses[link.b], compose(poses[link.a], link.pose)))


def contradicted(poses: Sequence[Pose], link: Link) -> bool:
    """Whether a loop contradicts the current poses."""
    e = off(poses, link)
    return float(e @ link.information @ e) > CONTRADICTS


def spread(poses: Sequence[Pose], links: Sequence[Link], k: int) -> Floats:
    """(n, 3, 3): covariance of each place relative to place k, along the most certain chain of
    links.

    Covariances of x, y and heading, in the axes of the map.
    """
    n = len(poses)
    own = _covariances(np.array([link.information for link in links]))
    ends = np.array([[link.a for link in links], [link.b for link in links]]).T
    keys, number = np.unique(ends.min(axis=1) * n + ends.max(axis=1), return_index=True)
    joined = np.divmod(keys, n)
    weights = scipy.sparse.csr_array((own[number, 2, 2], joined), shape=(n, n))
    which = scipy.sparse.csr_array((number + 1, joined), shape=(n, n))
    lengths, before = scipy.sparse.csgraph.dijkstra(weights, False, [k], return_predecessors=True)
    order = np.argsort(np.asarray(lengths, np.float64)[0])[1:].astype(np.int64)
    last = np.asarray(before, np.int64)[0, order]
    along = np.asarray(which[last, order] + which[order, last], np.int64).ravel() - 1
    trail = np.fromiter(itertools.chain.from_iterable(poses), np.float64).reshape(-1, 3)
    return _spread(trail, own, ends, order, last, along)


@jit
def _covariances(informations: Floats) -> Floats:
    """(n, 3, 3): inverses, of symmetric matrices, by their cofactors."""
    out = np.empty_like(informations)
    for n in range(len(informations)):
        m, w = informations[n], out[n]
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                c, d = (j + 1) % 3, (j + 2) % 3
                w[i, j] = m[c, a] * m[d, b] - m[d, a] * m[c, b]
        w /= m[0, 0] * w[0, 0] + m[0, 1] * w[1, 0] + m[0, 2] * w[2, 0]
    return out


@jit
def _spread(
    poses: Floats, own: Floats, ends: Ints, order: Ints, before: Ints, along: Ints
) -> Floats:
    out = np.zeros((len(poses), 3, 3))
    lever, turn = np.eye(3), np.eye(3)
    for m in range(len(order)):
        j, i = order[m], before[m]
        lever[0, 2], lever[1, 2] = poses[i, 1] - poses[j, 1], poses[j, 0] - poses[i, 0]
        psi = poses[ends[along[m], 1], 2]
        turn[0, 0], turn[0, 1] = math.cos(psi), -math.sin(psi)
        turn[1, 0], turn[1, 1] = math.sin(psi), math.cos(psi)
        _add_moved(out[j], lever, out[i])
        _add_moved(out[j], turn, own[along[m]])
    return out


@jit_inline
def _add_moved(out: Floats, jacobian: Floats, covariance: Floats) -> None:
    """Without the calls of a matrix product, which take longer than nine numbers do."""
    for a in range(3):
        for b in range(3):
            for c in range(3):
                for d in range(3):
                    out[a, b] += jacobian[a, c] * covariance[c, d] * jacobian[b, d]
