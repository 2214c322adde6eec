"""Wheel scale, heading scale and the LiDAR's mount, from scans of the standing robot.

Hand-eye calibration: between two rests the LiDAR moves by S, measured by scan matching, and the
body by B, by the odometry up to the scales of distance and heading; and B M = M S for the mount M.
Turns on the spot determine the LiDAR's position, straights its direction and the distance scale.
Only scans at rest are used: their stamps do not matter then.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cohelm.calibrate.excitation import scan_points
from cohelm.calibrate.interval import half_widths_alike
from cohelm.calibrate.response import Measured, steps
from cohelm.calibrate.ride import Rest, Ride
from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose, inverse
from cohelm.core.scalars import wrap
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.match.scan_matching import MatchParams, align
from cohelm.perceive.match.surfaces import (
    FlatPoints,
    Surfaces,
    flat_points,
    seen_from,
    stacked,
    surfaces,
    thinned,
)
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import Lidar

_CELL = 0.02  # of the index of surfaces [m]
_REACH = 0.5  # a match is looked for so far from where it is expected [m]
_NEIGHBOURS, _NEAR, _SAME_WAY = 8, 0.15, 0.95  # to either side; nearer than [m]; cosine
_LEAST = 0.5  # of the points, so many have to lie on what was seen before
_NOTHING = np.diag([1e-2, 1e-2, 1e-2])  # information of a guess that is worth little


class MeasuredMount(NamedTuple):
    """What the scans show."""

    x: Measured
    y: Measured
    yaw: Measured
    """Of the LiDAR in the body frame [m, m, rad]."""
    way: Measured
    """True metres for a metre of the odometry."""
    heading: Measured
    """True radians for a radian of the odometry."""
    residuals: Floats
    """(k, 3): of each motion, how far the scans are from what is fitted [m, m, rad]."""
    noise: float
    """Standard deviation of a range at rest [m]."""


def mount(model: RobotModel, ride: Ride) -> MeasuredMount:
    """Fit all rests of a ride. Raises CohelmError where the scans can not be matched."""
    if model.lidar is None:
        raise CohelmError(f"{model.name} has no LiDAR: give lidar in its file")
    lidar = model.lidar.lidar()
    trail = ride.trail()
    moves = steps(trail)
    between_rests = [_moved(trail, moves, a, b)
                     for a, b in zip(ride.rests[:-1], ride.rests[1:], strict=True)]  # fmt: skip
    if len(between_rests) < 12:
        raise CohelmError("too little was driven to find the LiDAR's mount: let it drive on")
    poses = _matched(lidar, ride.rests, between_rests)
    seen = [between(a, b) for a, b in itertools.pairwise(poses)]
    nominal = lidar.mount

    def residual(p: Floats) -> Floats:
        place = Pose(float(p[0]), float(p[1]), float(p[2]))
        out = np.empty((len(seen), 3))
        for i, (rows, sees) in enumerate(zip(between_rests, seen, strict=True)):
            body = _integrated(rows, p[3], p[4])
            meant = compose(inverse(place), compose(body, place))
            off = between(meant, sees)
            out[i] = off.x, off.y, off.psi
        return (out / scale).ravel()

    scale = np.array([0.005, 0.005, 0.003])
    p = np.array([nominal.x, nominal.y, nominal.psi, 1.0, 1.0])
    for _ in range(2):
        fit = least_squares(residual, p, loss="soft_l1", x_scale=[0.1, 0.1, 0.05, 0.02, 0.02])
        p = fit.x
        rest = residual(p).reshape(-1, 3) * scale
        scale = np.maximum(1.4826 * np.median(np.abs(rest), axis=0), 1e-5)
    jacobian = np.asarray(least_squares(residual, p, max_nfev=1).jac, dtype=np.float64)
    off = residual(p)
    weight = (1.0 + off**2) ** -0.25  # of soft_l1, its root
    half = half_widths_alike(
        (weight[:, None] * jacobian).reshape(-1, 3, 5), (weight * off).reshape(-1, 3), _alike(ride)
    )
    x, y, yaw, way, heading = (Measured(float(a), float(b)) for a, b in zip(p, half, strict=True))
    rest = residual(p).reshape(-1, 3) * scale
    return MeasuredMount(
        x, y, yaw._replace(value=wrap(yaw.value)), way, heading, rest, _noise(ride.rests)
    )


def _alike(ride: Ride) -> Ints:
    """Numbers of motions that err alike: the straights, between the same two places, there and
    back; and the half turns at either of them."""
    numbers = [3 + n if not s.legs and not s.twist.v else 0 if s.twist.v else 1 + s.legs % 2
               for n, (_, _, s) in enumerate(ride.segments)]  # fmt: skip
    return np.array(numbers[: len(ride.rests) - 1])


def _moved(trail: Floats, moves: Floats, a: Rest, b: Rest) -> Floats:
    """Way and turn of each reading between the middles of two rests, (n, 2)."""
    start, end = (0.5 * (r.since + min(r.until, r.since + 10.0)) for r in (a, b))
    inside = (trail[1:, 0] > start) & (trail[1:, 0] <= end)
    return moves[inside]


def _integrated(rows: Floats, way: float, heading: float) -> Pose:
    """The motion of the body that so many small ways and turns make."""
    turn = heading * rows[:, 1]
    psi = np.cumsum(turn) - 0.5 * turn
    travelled = way * rows[:, 0]
    return Pose(
        float(travelled @ np.cos(psi)), float(travelled @ np.sin(psi)), wrap(float(turn.sum()))
    )


def _matched(lidar: Lidar, rests: list[Rest], moves: list[Floats]) -> list[Pose]:
    """Pose of the LiDAR at each rest, in its frame at the first.

    Every rest is matched with all that was seen before it. What the odometry's turns are worth is
    learnt on the way, from the small ones, before the half turns need it.
    """
    params = MatchParams(reach=_REACH, least=0.08, sigma=0.02, rounds=40)
    known: Surfaces | None = None
    around: list[FlatPoints] = []
    poses: list[Pose] = []
    seen, reported = 0.0, 0.0
    at = Pose(0.0, 0.0, 0.0)
    for number, rest in enumerate(rests):
        flat = _flat(lidar, _at_rest(rest))
        if number:
            heading = seen / reported if reported > 0.5 else 1.0
            body = _integrated(moves[number - 1], 1.0, heading)
            step = compose(inverse(lidar.mount), compose(body, lidar.mount))
            guess = compose(poses[-1], step)
            fit = None if known is None else align(known, flat, guess, _NOTHING, params)
            if fit is None or not (fit.share > _LEAST and len(flat.points) > 20):
                raise CohelmError(
                    "the scans can not be matched with each other: the LiDAR needs walls within "
                    "its range that stay, and its mount known to some 10 cm and 5 degrees"
                )
            at = fit.pose
            small = between(poses[-1], at).psi
            turned = float(moves[number - 1][:, 1].sum())
            if 0.1 < abs(turned) < 1.5:
                seen, reported = seen + small * math.copysign(1.0, turned), reported + abs(turned)
        poses.append(at)
        around.append(seen_from(at, flat))
        known = surfaces(thinned(stacked(around), _CELL), 2.0 * _CELL, _REACH)
    return poses


def _at_rest(rest: Rest) -> Floats:
    """Of each beam the median of its ranges while the robot stood; inf where half had none."""
    return np.median(np.where(np.isfinite(rest.scans), rest.scans, math.inf), axis=0)


def _flat(lidar: Lidar, ranges: Floats) -> FlatPoints:
    """Points on something flat, in the sensor's frame."""
    points, beams = scan_points(ranges, lidar.beams), np.flatnonzero(np.isfinite(ranges))
    return _smoothed(flat_points(points, beams, lidar._replace(mount=Pose(0.0, 0.0, 0.0))))


def _smoothed(flat: FlatPoints) -> FlatPoints:
    """Each moved along its normal onto the middle of its neighbours. Walls as thick as the noise
    would hold a match wherever it begins: there is a point near enough to everything."""
    points, normals = flat
    away, count = np.zeros(len(points)), np.ones(len(points))
    for shift in range(1, _NEIGHBOURS + 1):
        for a, b in ((slice(shift, None), slice(None, -shift)),
                     (slice(None, -shift), slice(shift, None))):  # fmt: skip
            d = points[b] - points[a]
            near = np.hypot(d[:, 0], d[:, 1]) < _NEAR
            near &= np.abs(np.sum(normals[a] * normals[b], axis=1)) > _SAME_WAY
            away[a] += np.where(near, np.sum(d * normals[a], axis=1), 0.0)
            count[a] += near
    return FlatPoints(points + (away / count)[:, None] * normals, normals)


def _noise(rests: list[Rest]) -> float:
    """Of single ranges while the robot stands, by the median beam [m]."""
    found: list[float] = []
    for rest in rests:
        scans = np.array(rest.scans)
        if len(scans) > 2:
            whole = scans[:, np.isfinite(scans).all(axis=0)]
            if whole.size:
                found.append(float(np.sqrt(np.median(whole.var(axis=0, ddof=1)))))
    return float(np.median(found)) if found else 0.0
