"""Pose graph optimisation, solved by gtsam."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cohelm.core.extras import missing
from cohelm.core.types import Floats, Pose


class Link(NamedTuple):
    """Place `b` as seen from place `a`, with the information (3, 3) of that pose in the axes of
    b. A loop may be wrong, and is then outvoted; a step from one place to the next is never."""

    a: int
    b: int
    pose: Pose
    information: Floats
    loop: bool


def library() -> Any:
    """gtsam, which only mapping needs. CohelmError where it is not installed."""
    try:
        import gtsam
    except ImportError as error:
        raise missing("mapping", "map") from error
    return gtsam


def solved(poses: list[Pose], links: list[Link]) -> list[Pose]:
    """The poses that agree best with all links; the first stays where it is."""
    g = library()
    graph, values = g.NonlinearFactorGraph(), g.Values()
    fixed = g.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))
    graph.add(g.PriorFactorPose2(0, g.Pose2(*poses[0]), fixed))
    cauchy = g.noiseModel.mEstimator.Cauchy.Create(1.0)
    for link in links:
        noise = g.noiseModel.Gaussian.Information(0.5 * (link.information + link.information.T))
        if link.loop:
            noise = g.noiseModel.Robust.Create(cauchy, noise)
        graph.add(g.BetweenFactorPose2(link.a, link.b, g.Pose2(*link.pose), noise))
    for k, pose in enumerate(poses):
        values.insert(k, g.Pose2(*pose))
    result = g.LevenbergMarquardtOptimizer(graph, values).optimize()
    found = [result.atPose2(k) for k in range(len(poses))]
    return [Pose(float(p.x()), float(p.y()), float(p.theta())) for p in found]
