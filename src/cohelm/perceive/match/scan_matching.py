"""Scan matching: the pose at which a scan lies on known surfaces, and its covariance.

Point-to-line ICP (PLICP, Censi 2008) by Gauss-Newton, with Huber weights against unmapped objects
and a prior from odometry: along a featureless corridor the prior decides, and the information
shows it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.match.surfaces import FlatPoints, Surfaces, row_at


class MatchParams(NamedTuple):
    """Parameters of scan matching."""

    reach: float = 0.4
    """Association distance of the first iteration [m], which decreases"""
    least: float = 0.12
    """to this [m]."""
    sigma: float = 0.03
    """Standard deviation of a point from its surface, sensor and map together [m]."""
    share: float = 0.15
    """Errors of neighbouring beams are correlated (map, calibration): the share of them that counts
    as independent."""
    rounds: int = 20
    correlated: float = 1.0
    """Correlation length of map errors, along a wall and along the robot's path [m]."""
    offset: float = 0.0
    """Distance of points in front of their surface, towards the sensor [m]."""


class ScanFit(NamedTuple):
    """pose: where the sweep fits best. information: (3, 3) of the match alone, without the
    prior, in x, y, psi. share: of the points that lie within `least` of a surface of the same
    direction. rms: of their distances [m]. before: their mean distance in front of the surfaces,
    beyond `MatchParams.offset` [m]."""

    pose: Pose
    information: Floats
    share: float
    rms: float
    before: float = 0.0


@jit
def align(
    known: Surfaces, flat: FlatPoints, start: Pose, prior: Floats, params: MatchParams
) -> ScanFit:
    """Match points with normals, in the body frame, from a first guess.

    If the surfaces' normals face the visible side, those of the points must too. prior: (3, 3)
    information of the guess. Failure shows as a small share.
    """
    x, y, psi = start.x, start.y, start.psi
    reach = params.reach
    information, slope = np.empty((3, 3)), np.empty(3)
    share, rms, before = 0.0, math.inf, 0.0
    weights = np.full(len(flat.points), params.share)
    for turn in range(params.rounds):
        share, rms, before = _gather(
            known, flat, Pose(x, y, psi), reach, params, information, slope, weights, params.sigma,
        )  # fmt: skip
        ex, ey, epsi = x - start.x, y - start.y, wrap(psi - start.psi)
        full = information + prior
        b = np.empty(3)
        for i in range(3):
            b[i] = slope[i] + prior[i, 0] * ex + prior[i, 1] * ey + prior[i, 2] * epsi
        if not abs(np.linalg.det(full)) > 0.0:
            break
        step = np.linalg.solve(full, b)
        x, y, psi = x - step[0], y - step[1], wrap(psi - step[2])
        small = abs(step[0]) + abs(step[1]) < 3e-4 and abs(step[2]) < 1e-4
        if small and reach <= params.least:
            break
        reach = max(params.least, 0.75 * reach) if turn > 0 else reach
    pose = Pose(x, y, psi)
    share, rms, before = _gather(
        known, flat, pose, params.least, params, information, slope, weights, params.sigma
    )
    return ScanFit(pose, information, share, rms, before)


@jit
def _gather(
    known: Surfaces, flat: FlatPoints, pose: Pose, reach: float, params: MatchParams,
    information: Floats, slope: Floats, weights: Floats, sigma: float, crossed: bool = False,
) -> tuple[float, float, float]:  # fmt: skip
    """Normal equations of one iteration, written into `information` and `slope`; returns share,
    rms, and mean of the distances towards the visible side.

    weights: (n,) of the points. sigma: standard deviation of a point from its surface [m].
    crossed: the information as of `observed`.
    """
    information[:, :] = 0.0
    slope[:] = 0.0
    points, normals = flat.points, flat.normals
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    weight = 1.0 / (sigma * sigma)
    two_sided = len(known.back) > 0
    square, count, mean, total_weight = 0.0, 0, 0.0, 0.0
    for k in range(len(points)):
        qx = c * points[k, 0] - s * points[k, 1]
        qy = s * points[k, 0] + c * points[k, 1]
        px, py = pose.x + qx, pose.y + qy
        i = row_at(known, px, py)
        if i < 0:
            continue
        nx, ny = known.normals[i, 0], known.normals[i, 1]
        ax = c * normals[k, 0] - s * normals[k, 1]
        ay = s * normals[k, 0] + c * normals[k, 1]
        alignment = ax * nx + ay * ny
        if two_sided:
            if alignment < -0.85:  # the other side of the wall is nearer
                i = known.back[i]
                if i < 0:
                    continue
                nx, ny = known.normals[i, 0], known.normals[i, 1]
                alignment = ax * nx + ay * ny
            if alignment < 0.85:
                continue
        elif abs(alignment) < 0.85:
            continue
        dx, dy = px - known.points[i, 0], py - known.points[i, 1]
        if dx * dx + dy * dy > reach * reach:
            continue
        e = dx * nx + dy * ny - params.offset
        w = weight * weights[k] * min(1.0, sigma / max(abs(e), 1e-9))
        turn = ny * qx - nx * qy
        if crossed:
            way = 1.0 if alignment > 0.0 else -1.0
            ax, ay = way * ax, way * ay
            other = ay * qx - ax * qy
            information[0, 0] += w * nx * ax
            information[0, 1] += 0.5 * w * (nx * ay + ny * ax)
            information[0, 2] += 0.5 * w * (nx * other + turn * ax)
            information[1, 1] += w * ny * ay
            information[1, 2] += 0.5 * w * (ny * other + turn * ay)
            information[2, 2] += w * turn * other
        else:
            information[0, 0] += w * nx * nx
            information[0, 1] += w * nx * ny
            information[0, 2] += w * nx * turn
            information[1, 1] += w * ny * ny
            information[1, 2] += w * ny * turn
            information[2, 2] += w * turn * turn
        slope[0] += w * e * nx
        slope[1] += w * e * ny
        slope[2] += w * e * turn
        square += e * e
        count += 1
        mean += w * e
        total_weight += w
    information[1, 0] = information[0, 1]
    information[2, 0] = information[0, 2]
    information[2, 1] = information[1, 2]
    if count == 0:
        return 0.0, math.inf, 0.0
    return count / len(points), math.sqrt(square / count), mean / max(total_weight, 1e-9)


@jit
def observed(known: Surfaces, flat: FlatPoints, pose: Pose, params: MatchParams) -> Floats:
    """(3, 3) information of a match from what both sides show.

    Normals are estimated, so along a plain corridor those of either side point a little forwards or
    backwards, and their squares add up to information that is not there. The errors of the two
    normals of a pair are independent: their product has none in the mean, as in an estimate with
    instrumental variables.
    """
    information, slope = np.empty((3, 3)), np.empty(3)
    weights = np.full(len(flat.points), params.share)
    _gather(
        known, flat, pose, params.least, params, information, slope, weights, params.sigma, True
    )
    values, axes = np.linalg.eigh(information)
    return (axes * np.maximum(values, 0.0)) @ axes.T


@jit
def independent(
    known: Surfaces, flat: FlatPoints, pose: Pose, params: MatchParams, rms: float
) -> Floats:
    """(3, 3) information of a match by independent errors only.

    Map errors are correlated along walls: each correlation length of wall counts once, and no
    better than half a cell, or than the residual of its points.
    """
    information, slope = np.empty((3, 3)), np.empty(3)
    points = flat.points
    n = len(points)
    weights = np.empty(n)
    for k in range(n):
        d = params.correlated
        if k > 0:
            gap = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
            d = min(gap, d)
        weights[k] = d / params.correlated
    sigma = math.sqrt(0.25 * known.resolution * known.resolution + min(rms, 1.0) ** 2)
    _gather(known, flat, pose, params.least, params, information, slope, weights, sigma)
    return information
