"""Scan matching: the pose from which a scan lies on known surfaces, and its covariance.

Point-to-line ICP (Censi 2008 calls it PLICP) by Gauss-Newton, with Huber weights against what
is not on the map and a prior from odometry: along a corridor without features the prior decides,
and the information says so.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.jit import jit
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Pose
from cohelm.perceive.match.surfaces import Surfaces


class MatchParams(NamedTuple):
    """How a sweep is matched."""

    reach: float = 0.4
    """At first, surfaces are looked for within this distance [m]; then nearer and nearer."""
    least: float = 0.12
    """And at last within this [m]."""
    sigma: float = 0.03
    """Standard deviation of a point from its surface, sensor and map together [m]."""
    share: float = 0.15
    """Neighbouring beams err alike (map, calibration): the share of them that counts as told
    independently."""
    rounds: int = 20
    correlated: float = 1.0
    """A map errs alike along so much of a wall, and along so much of the way [m]."""
    offset: float = 0.0
    """So far before their surface, to where it is seen from, points lie in truth [m]."""


class ScanFit(NamedTuple):
    """pose: where the sweep fits best. information: (3, 3) of the match alone, without the
    prior, in x, y, psi. share: of the points that lie within `least` of a surface of the same
    direction. rms: of their distances [m]. converged: whether the last round changed nothing.
    before: how far they lie before their surfaces, in the mean, beyond `MatchParams.offset` [m]."""

    pose: Pose
    information: Floats
    share: float
    rms: float
    converged: bool
    before: float = 0.0


@jit
def align(
    known: Surfaces, points: Floats, across: Floats, start: Pose, prior: Floats, care: MatchParams
) -> ScanFit:
    """Match points (n, 2) with normals (n, 2), in the body frame, from a first guess.

    Where the surfaces' normals say from where they are seen, those of the points must as well.
    prior: (3, 3) information of the guess. Failure is in the numbers: a small share.
    """
    x, y, psi = start.x, start.y, start.psi
    reach = care.reach
    converged = False
    information, slope = np.empty((3, 3)), np.empty(3)
    share, rms, before = 0.0, math.inf, 0.0
    weights = np.full(len(points), care.share)
    for turn in range(care.rounds):
        share, rms, before = _gather(
            known,
            points,
            across,
            Pose(x, y, psi),
            reach,
            care,
            information,
            slope,
            weights,
            care.sigma,
        )
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
        if small and reach <= care.least:
            converged = True
            break
        reach = max(care.least, 0.75 * reach) if turn > 0 else reach
    pose = Pose(x, y, psi)
    share, rms, before = _gather(
        known, points, across, pose, care.least, care, information, slope, weights, care.sigma
    )
    return ScanFit(pose, information, share, rms, converged, before)


@jit
def _gather(
    known: Surfaces, points: Floats, across: Floats, pose: Pose, reach: float, care: MatchParams,
    information: Floats, slope: Floats, weights: Floats, sigma: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Normal equations of one round, written into `information` and `slope`; share, rms, and mean
    of the distances, to where the surfaces are seen from.

    weights: (n,) of the points. sigma: standard deviation of a point from its surface [m].
    """
    information[:, :] = 0.0
    slope[:] = 0.0
    rows, columns = known.nearest.shape
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    weight = 1.0 / (sigma * sigma)
    sided = len(known.back) > 0
    square, count, mean, whole = 0.0, 0, 0.0, 0.0
    for k in range(len(points)):
        qx = c * points[k, 0] - s * points[k, 1]
        qy = s * points[k, 0] + c * points[k, 1]
        px, py = pose.x + qx, pose.y + qy
        u, v = (px - known.x) / known.resolution, (py - known.y) / known.resolution
        if not (0.0 <= u < columns and 0.0 <= v < rows):
            continue
        i = known.nearest[int(v), int(u)]
        if i < 0:
            continue
        nx, ny = known.normals[i, 0], known.normals[i, 1]
        ax = c * across[k, 0] - s * across[k, 1]
        ay = s * across[k, 0] + c * across[k, 1]
        same = ax * nx + ay * ny
        if sided:
            if same < -0.85:  # of a wall, the other side is nearer
                i = known.back[i]
                if i < 0:
                    continue
                nx, ny = known.normals[i, 0], known.normals[i, 1]
                same = ax * nx + ay * ny
            if same < 0.85:
                continue
        elif abs(same) < 0.85:
            continue
        dx, dy = px - known.points[i, 0], py - known.points[i, 1]
        if dx * dx + dy * dy > reach * reach:
            continue
        e = dx * nx + dy * ny - care.offset
        w = weight * weights[k] * min(1.0, sigma / max(abs(e), 1e-9))
        turn = ny * qx - nx * qy
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
        whole += w
    information[1, 0] = information[0, 1]
    information[2, 0] = information[0, 2]
    information[2, 1] = information[1, 2]
    if count == 0:
        return 0.0, math.inf, 0.0
    return count / len(points), math.sqrt(square / count), mean / max(whole, 1e-9)


@jit
def independent(
    known: Surfaces, points: Floats, across: Floats, pose: Pose, care: MatchParams, rms: float
) -> Floats:
    """(3, 3) information of a match, as far as what it rests on errs independently.

    A map errs by walls, not by beams: each correlation length of wall tells once, and no better
    than half a cell, or than the points lie off it.
    """
    information, slope = np.empty((3, 3)), np.empty(3)
    n = len(points)
    weights = np.empty(n)
    for k in range(n):
        d = care.correlated
        if k > 0:
            gap = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
            d = min(gap, d)
        weights[k] = d / care.correlated
    sigma = math.sqrt(0.25 * known.resolution * known.resolution + min(rms, 1.0) ** 2)
    _gather(known, points, across, pose, care.least, care, information, slope, weights, sigma)
    return information
