"""Estimates a constant bias of all ranges from straight walls, which it makes look bowed.

A wall at the distance d is seen along a beam u at the range d / (n u), n its normal. With b added
to each range its points lie at d + b (n u): farthest where the wall is looked at squarely, nearer
to both sides. Scan-to-scan motion does not show that on the way to a wall, since b drops out of
what two scans differ by; the shape of every long wall does, at once.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats
from cohelm.robot.plausibility.sight import Sight, normals
from cohelm.robot.sensors import Lidar

_MIN_LENGTH, _MIN_POINTS = 0.8, 20  # of a wall: surface seen square on [m], and points
_EDGE = 0.2  # left out next to edges and corners [m]
_GAP = 0.3  # consecutive points farther apart are on different surfaces [m]
_FLAT = 0.01
"""Unevenness of straight walls and of their measurement [m]; it does not average out over the
points of one wall."""
_MAX_SIGMA = 0.5
"""Walls with a larger standard deviation of the bias are ignored: such fits err upwards [m]."""
_STEP, _TURN = 0.15, 0.3  # distance between the places from which walls are fitted [m, rad]
_STEP_DOUBTED = 0.03  # ... while scans and odometry are doubted [m]
_MIN_PLACES, _KEPT = 3, 10  # places before a bias is reported, and places remembered
_MIN_WALLS = 2  # the bow of a single wall may be its own shape
_SAME_TURN, _SAME_PLACE = 0.5, 1.0
"""Two views that differ by less, by odometry, show the same wall; allows for the bias [rad, m]."""
_SIGMAS = 4.0  # standard deviations
_BOUND = 2.0  # ... for the upper bound of the bias
_MIN_BIAS = 0.12  # a smaller bias is not reported [m]
_AGREE = 0.8  # share of the places, and of the walls, that show at least half of it


class Bow(NamedTuple):
    """The range bias estimated from one wall."""

    bias: float
    """Ranges are too long by this, if the wall is straight [m]."""
    sigma: float
    """Standard deviation of the bias, from noise and the walls' unevenness [m]."""
    normal: float
    """Direction from the LiDAR square to the wall, in its frame [rad]."""
    x: float
    y: float
    """Middle of the measured part of the wall, in the LiDAR's frame [m]."""

    @property
    def weight(self) -> float:
        """[1/m^2]"""
        return self.sigma**-2


class _Wall(NamedTuple):
    """A wall seen from one place, in the odometry's frame."""

    normal: float
    x: float
    y: float
    bow: Bow


class RangeBias:
    """Estimates the bias from sights in order, one for each new place."""

    def __init__(self, lidar: Lidar) -> None:
        self._lidar = lidar
        self._places: deque[list[_Wall]] = deque(maxlen=_KEPT)
        self._last: Floats | None = None
        self._most = math.inf
        """Upper bound of the bias, from the walls [m]."""
        self.bias = 0.0
        """Ranges are too long by this; 0 where no bias is detected [m]."""

    def rules_out(self, bias: float) -> bool:
        """Whether the walls exclude a bias this large [m]."""
        return self._most < bias

    def forget(self) -> None:
        """Reset: as if no sight had been taken."""
        self._places.clear()
        self._most = math.inf
        self._last = None

    def take(self, sight: Sight, doubted: bool) -> None:
        """Add a sight. doubted: scans and odometry have disagreed: use smaller steps."""
        if self._last is not None:
            dx, dy, turn = (sight.pose - self._last).tolist()
            if math.hypot(dx, dy) < (_STEP_DOUBTED if doubted else _STEP) and abs(turn) < _TURN:
                return
        self._last = sight.pose
        found = bows(sight, self._lidar)
        if found:
            self._places.append([self._placed(sight.pose, one) for one in found])
        self.bias = self._judged()

    def _placed(self, pose: Floats, bow: Bow) -> _Wall:
        x, y, psi = pose.tolist()
        mount, c, s = self._lidar.mount, math.cos(psi), math.sin(psi)
        ahead, left = mount.x + bow.x, mount.y + bow.y
        return _Wall(psi + bow.normal, x + c * ahead - s * left, y + s * ahead + c * left, bow)

    def _judged(self) -> float:
        places = self._places
        if len(places) < _MIN_PLACES:
            return 0.0
        walls = _grouped_by_wall([one for place in places for one in place])
        # Seen again from elsewhere a wall is as straight as it was: the best view of it counts.
        weights = [max(one.bow.weight for one in wall) for wall in walls]
        weight = sum(weights)
        biases = [_mean(wall) for wall in walls]
        bias = sum(w * b for w, b in zip(weights, biases, strict=True)) / weight
        self._most = bias + _BOUND / math.sqrt(weight) if len(walls) >= _MIN_WALLS else math.inf
        agree = sum(_mean(place) > 0.5 * bias for place in places) >= _AGREE * len(places)
        most = sum(w for w, b in zip(weights, biases, strict=True) if b > 0.5 * bias)
        agree = agree and most >= _AGREE * weight and len(walls) >= _MIN_WALLS
        return bias if agree and bias * math.sqrt(weight) > _SIGMAS and bias > _MIN_BIAS else 0.0


def _grouped_by_wall(seen: list[_Wall]) -> list[list[_Wall]]:
    walls: list[list[_Wall]] = []
    for one in seen:
        for wall in walls:
            first = wall[0]
            turned = math.remainder(one.normal - first.normal, math.tau)
            apart = math.hypot(one.x - first.x, one.y - first.y)
            if abs(turned) < _SAME_TURN and apart < _SAME_PLACE:
                wall.append(one)
                break
        else:
            walls.append([one])
    return walls


def _mean(seen: list[_Wall]) -> float:
    """[m]"""
    return sum(one.bow.bias * one.bow.weight for one in seen) / sum(one.bow.weight for one in seen)


def bows(sight: Sight, lidar: Lidar) -> list[Bow]:
    """The bias estimate of each wall of which enough is visible."""
    sigma = max(lidar.noise, 0.005)
    _, flat = normals(sight, sigma)
    if len(flat) < _MIN_POINTS:
        return []
    q = sight.points - (lidar.mount.x, lidar.mount.y)
    apart = np.hypot(*np.diff(q[flat], axis=0).T)
    new = np.flatnonzero((np.diff(flat) > 1) | (apart > _GAP)) + 1
    found: list[Bow] = []
    for run in np.split(flat, new):
        along = np.cumsum(sight.arc[run])
        if along[-1] < _MIN_LENGTH + 2.0 * _EDGE:
            continue
        inner = run[(along > _EDGE) & (along < along[-1] - _EDGE)]
        one = _fitted(q[inner], sigma, lidar.range_min) if len(inner) >= _MIN_POINTS else None
        if one is not None:
            found.append(one)
    return found


def _fitted(q: Floats, sigma: float, nearest: float) -> Bow | None:
    """A line and a bias, by least squares; q: points from the LiDAR (n, 2). None: not one wall,
    or too distant to look bowed, or nearer to the LiDAR than `nearest`."""
    r = np.hypot(q[:, 0], q[:, 1])
    u = q / r[:, None]
    chord = q[-1] - q[0]
    n = np.array([chord[1], -chord[0]]) / math.hypot(chord[0], chord[1])  # away from the LiDAR
    if float(np.ptp(u @ n)) < 0.05:
        return None
    d, b = float((q @ n).mean()), 0.0
    inverse: Floats = np.eye(3)
    for _ in range(3):
        square, aside = u @ n, u @ np.array([-n[1], n[0]])
        short = r - b
        residual = short * square - d
        design = np.column_stack((short * aside, -np.ones(len(r)), -square))
        inverse = np.asarray(np.linalg.inv(design.T @ design + 1e-9 * np.eye(3)), dtype=np.float64)
        turn, further, longer = (inverse @ (design.T @ -residual)).tolist()
        n = np.array([n[0] - turn * n[1], n[1] + turn * n[0]]) / math.hypot(1.0, turn)
        d, b = d + further, b + longer
    square = u @ n
    residual = (r - b) * square - d
    if not (math.sqrt(float(residual @ residual) / len(r)) < 1.5 * sigma + _FLAT and d > nearest):
        return None
    # a straight wall's unevenness looks like so much bow, spread over all its points
    error = sigma**2 + len(r) * _FLAT**2
    spread = math.sqrt(error * float(inverse[2, 2]))
    if abs(b) > spread:
        # For a large b the inverse gives its precision if it is about right, not whether it is:
        # with b as long as the ranges are, all points lie at the LiDAR, and any line fits them. The
        # improvement over the straight line does tell; for a small b both agree.
        better = _line_residual(q) - float(residual @ residual)
        spread = max(spread, abs(b) * math.sqrt(error / max(better, 1e-12)))
    middle = q.mean(axis=0).tolist()
    if spread > _MAX_SIGMA:
        return None
    return Bow(b, spread, math.atan2(n[1], n[0]), middle[0], middle[1])


def _line_residual(q: Floats) -> float:
    """Sum of the squared distances from the best-fitting line [m^2]."""
    c = q - q.mean(axis=0)
    return float(np.linalg.eigvalsh(c.T @ c)[0])
