"""Two well-known localizers on a map, for comparison: a particle filter and plain ICP.

Both take the same deskewed scans, odometry and map, and the same start.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between, compose, inverse
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.match.odometry_covariance import inverted
from cohelm.perceive.match.scan_matching import MatchParams, align
from cohelm.perceive.match.surfaces import FlatPoints, flat_points
from cohelm.perceive.scan.deskew import DeskewedScan, deskew
from cohelm.perceive.scan.odometry_buffer import EMPTY, extended, pose_at
from cohelm.robot.port import Readings
from cohelm.robot.sensors import Lidar


class Estimate(NamedTuple):
    """The fields of `perceive.pipeline.Seen` that are compared."""

    pose: Pose
    covariance: Floats
    lost: bool = False
    reason: str = ""


class Other(ABC):
    """Propagates a pose by odometry, and corrects it at each scan. Never reports itself lost."""

    def __init__(self, lidar: Lidar, known: LocalizationMap, start: Pose) -> None:
        self.lidar, self.known, self.pose = lidar, known, start
        self.covariance: Floats = np.diag([0.1, 0.1, 0.05]) ** 2
        self._trail, self._scan = EMPTY, -1
        self._last: Pose | None = None
        self._map_odom: Pose | None = None

    def take(self, now: float, readings: Readings) -> Estimate:
        """As `Perception.take`."""
        if readings.odometry is not None:
            self._trail = extended(self._trail, readings.odometry)
        if self._map_odom is None:
            self._map_odom = compose(self.pose, inverse(pose_at(self._trail, now)))
        scan = readings.scan
        if scan is not None and scan.number != self._scan:
            self._scan = scan.number
            seen = deskew(self.lidar, scan.ranges, scan.stamp, scan.duration, self._trail)
            odometry = seen.pose
            self.pose = compose(self._map_odom, odometry) if self._last is None else self.pose
            step = between(self._last, odometry) if self._last else Pose(0.0, 0.0, 0.0)
            self._last = odometry
            self.correct(step, seen)
            self._map_odom = compose(self.pose, inverse(odometry))
        return Estimate(compose(self._map_odom, pose_at(self._trail, now)), self.covariance)

    @abstractmethod
    def correct(self, step: Pose, seen: DeskewedScan) -> None:
        """Take in an odometry step and the scan at its end."""


class PlainIcp(Other):
    """Point-to-line ICP on the map from the odometry's pose; without adaptation or validation."""

    def correct(self, step: Pose, seen: DeskewedScan) -> None:
        flat = flat_points(seen.points, seen.beams, self.lidar)
        every = max(1, -(-len(flat.points) // 360))
        flat = FlatPoints(*(np.ascontiguousarray(part[::every]) for part in flat))
        weak = 1e-3 * np.eye(3)
        fit = align(self.known.surfaces, flat, compose(self.pose, step), weak, MatchParams())
        self.pose, self.covariance = fit.pose, inverted(fit.information + weak)


class ParticleFilter(Other):
    """Adaptive Monte Carlo localisation as Nav2 ships it (`nav2_amcl`, its default parameters):
    likelihood field, odometry model with alpha 0.2, 60 beams, 500 to 2000 particles by KLD
    sampling, an update every 0.25 m or 0.2 rad."""

    def __init__(self, lidar: Lidar, known: LocalizationMap, start: Pose, seed: int = 0) -> None:
        super().__init__(lidar, known, start)
        self._rng = np.random.default_rng(seed)
        spread = self._rng.normal(0.0, 1.0, (2000, 3)) * (0.1, 0.1, 0.05)
        self._particles = np.array(start, dtype=np.float64) + spread
        self._since, self._begun = Pose(0.0, 0.0, 0.0), False

    def correct(self, step: Pose, seen: DeskewedScan) -> None:
        self._since = compose(self._since, step)
        self.pose = compose(self.pose, step)
        far = math.hypot(self._since.x, self._since.y) > 0.25 or abs(self._since.psi) > 0.2
        if self._begun and not far:
            return
        self._begun = True
        self._moved(self._since)
        self._since = Pose(0.0, 0.0, 0.0)
        chosen = np.linspace(0, len(seen.points) - 1, min(60, len(seen.points))).astype(int)
        weights = _likely(self.known, self._particles, seen.points[chosen], self.lidar.range_max)
        weights /= weights.sum()
        at = self._particles
        x, y = weights @ at[:, 0], weights @ at[:, 1]
        psi = math.atan2(float(weights @ np.sin(at[:, 2])), float(weights @ np.cos(at[:, 2])))
        self.pose = Pose(float(x), float(y), psi)
        off = np.column_stack((at[:, 0] - x, at[:, 1] - y, np.angle(np.exp(1j * (at[:, 2] - psi)))))
        self.covariance = (off * weights[:, None]).T @ off + 1e-6 * np.eye(3)
        self._resample(weights)

    def _moved(self, step: Pose) -> None:
        """Sample from the odometry motion model (Thrun, Burgard, Fox, table 5.6)."""
        a = 0.2
        way, n = math.hypot(step.x, step.y), len(self._particles)
        first = math.atan2(step.y, step.x) if way > 0.01 else 0.0
        second = math.remainder(step.psi - first, 2.0 * math.pi)
        # backing up is not turning round twice
        one, two = (
            min(abs(turn), abs(math.remainder(turn - math.pi, 2.0 * math.pi)))
            for turn in (first, second)
        )
        normal = self._rng.normal(0.0, 1.0, (n, 3))
        turn = first - math.sqrt(a * one**2 + a * way**2) * normal[:, 0]
        far = way - math.sqrt(a * way**2 + a * one**2 + a * two**2) * normal[:, 1]
        last = second - math.sqrt(a * two**2 + a * way**2) * normal[:, 2]
        p = self._particles
        p[:, 0] += far * np.cos(p[:, 2] + turn)
        p[:, 1] += far * np.sin(p[:, 2] + turn)
        p[:, 2] += turn + last

    def _resample(self, weights: Floats) -> None:
        """As many as KLD sampling asks for (err 0.05, z 0.99; cells of 0.5 m and 10 degrees)."""
        drawn = self._rng.choice(len(weights), 2000, p=weights)
        cells = np.floor(self._particles[drawn] / (0.5, 0.5, math.radians(10.0))).astype(int)
        _, first = np.unique(cells, axis=0, return_index=True)
        k = np.arange(1, len(first) + 1)
        b = 2.0 / (9.0 * np.maximum(k - 1, 1))
        wanted = np.maximum((k - 1) / 0.1 * (1.0 - b + np.sqrt(b) * 0.99) ** 3, 500)
        count = np.searchsorted(np.sort(first), np.arange(2000), side="right")
        enough = np.flatnonzero(np.arange(2000) >= wanted[count - 1])
        kept = int(enough[0]) if len(enough) else 2000
        self._particles = self._particles[drawn[:kept]].copy()


@jit
def _likely(known: LocalizationMap, particles: Floats, points: Floats, farthest: float) -> Floats:
    """Weights by the likelihood field (sigma 0.2 m, 2 m at most; z_hit 0.5, z_rand 0.5)."""
    weights = np.empty(len(particles))
    rows, columns = known.gap.shape
    c0, s0 = math.cos(known.origin.psi), math.sin(known.origin.psi)
    for k in range(len(particles)):
        c, s = math.cos(particles[k, 2]), math.sin(particles[k, 2])
        p = 1.0
        for i in range(len(points)):
            x = particles[k, 0] + c * points[i, 0] - s * points[i, 1] - known.origin.x
            y = particles[k, 1] + s * points[i, 0] + c * points[i, 1] - known.origin.y
            u, v = (c0 * x + s0 * y) / known.resolution, (-s0 * x + c0 * y) / known.resolution
            gap = 2.0
            if 0.0 <= u < columns and 0.0 <= v < rows:
                gap = known.gap[int(v), int(u)]
            z = 0.5 * math.exp(-0.5 * (gap / 0.2) ** 2) + 0.5 / farthest
            p += z * z * z
        weights[k] = p
    return weights
