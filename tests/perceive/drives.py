"""Drives through the lab with the sensors' errors, and what was true: readings as they come.

Independent of the robots behind the port: an exact unicycle on waypoints, wheels that measure
wrongly, a gyro that drifts, a LiDAR whose beams are measured one after the other.
"""

import math
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import between, compose
from cohelm.core.types import Desired, Pose, Twist, disc, discs
from cohelm.law.gains import Gains
from cohelm.law.reference import desired, through
from cohelm.law.track import track
from cohelm.robot.kinematics import arc
from cohelm.robot.port import Odometry, Readings, Scan
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import NO_GRID
from cohelm.sim.lidar import scan as cast

WALLS = np.array([
    [-1, -4, 14, -4], [-1, -4, -1, 3], [14, -4, 14, 3], [-3.5, 3, -0.45, 3], [0.45, 3, 12.55, 3],
    [13.45, 3, 16.5, 3], [-3.5, 3, -3.5, 5], [-3.5, 5, 16.5, 5], [16.5, 3, 16.5, 5],
], dtype=float)  # fmt: skip
CONES = discs(disc(0, 1, 0.1), disc(0, 0, 0.1), disc(10, 4, 0.1))
TOUR = [
    (-0.5, -1.75), (-0.55, -0.5), (-0.5, 0.8), (-0.1, 1.9), (0.0, 3.0), (0.7, 3.9), (2, 4), (4, 4),
    (6, 4), (8, 4), (9.2, 4.4), (10.5, 4.4), (12.2, 4.1), (13, 3.2), (13, 2), (13, 1), (12.25, 0),
    (11, 0), (9, 0), (7, 0), (5, 0), (3, -0.6), (1.5, -2), (0, -2.6),
]  # fmt: skip
LIDAR = LidarModel(
    beams=720, field_of_view_deg=270.0, range_max_m=12.0, rate_hz=10.0, noise_m=0.02, mount_x_m=0.3
)
START = Pose(-0.5, -1.75, math.pi / 2)
DT = 0.02
DELAY = 0.05


class Moment(NamedTuple):
    """One control period: the clock, the readings that have arrived, and where the robot is.
    scanned: whether the scan is a new one."""

    now: float
    readings: Readings
    truth: Pose
    twist: Twist
    scanned: bool


def along(waypoints, speed=0.5, start=None, most=None):
    """Twists at every DT of an exact robot that tracks waypoints, and its poses. most: so many
    twists, where no more of a long way is wanted."""
    reference = through([list(map(float, p)) for p in waypoints], speed)
    gains = Gains()
    d = desired(reference, 0.0, False)
    pose = start or Pose(d.x, d.y, d.psi)
    poses, twists = [pose], []
    before = Twist(0.0, 0.0)
    steps = int(reference.duration / DT)
    for k in range(steps if most is None else min(most, steps)):
        d = Desired(*desired(reference, k * DT, False))
        nominal = track(pose, d, gains)
        v = before.v + np.clip(nominal.v - before.v, -1.0 * DT, 1.0 * DT)
        omega = before.omega + np.clip(nominal.omega - before.omega, -4.0 * DT, 4.0 * DT)
        before = Twist(float(v), float(np.clip(omega, -1.5, 1.5)))
        pose = arc(pose, before, DT)
        poses.append(pose)
        twists.append(before)
    return poses, twists


Shift = tuple[float, float, float]


def shifted(poses, pushes):
    """Where a robot is that is pushed on its way: (time, (dx, dy, turn)) each. It drives on to
    where it then looks."""
    found, at, moved = [], poses[0], poses[0]
    for k, pose in enumerate(poses):
        here = compose(moved, between(at, pose))
        for when, by in pushes:
            if round(when / DT) == k:
                here = Pose(here.x + by[0], here.y + by[1], here.psi + by[2])
                at, moved = pose, here
        found.append(here)
    return found


def drive(
    poses, twists, seed=0, around=CONES, walls=WALLS, model=LIDAR, grid=NO_GRID, pushes=(),
    error=0.015, drift=0.02, duration=0.075,
):  # fmt: skip
    """Moments of a drive. around: discs, or a function of time. pushes: (time, pose shift) that
    the wheels do not notice. error: of each wheel's scale, one sigma; drift: of the gyro [deg/s].
    """
    rng = np.random.default_rng(seed)
    scale = 1.0 + error * rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.3)
    bias = math.radians(drift) * rng.choice([-1.0, 1.0])
    lidar = model.lidar()
    odom = Pose(*rng.uniform(-1.0, 1.0, 3).tolist())
    n = len(lidar.beams)
    parts = 8 if duration > 0.0 else 1
    every = round(1.0 / (model.rate_hz * DT))
    waiting, scan, number = [], None, 0
    way = shifted(poses, pushes)

    def true_at(t):
        k = min(max(t / DT, 0.0), len(way) - 1.0)
        i = min(int(k), len(twists) - 1)
        return arc(way[i], twists[i], (k - i) * DT) if twists else way[0]

    for k, pose in enumerate(way):
        now = k * DT
        twist = twists[min(k, len(twists) - 1)] if twists else Twist(0.0, 0.0)
        noisy = Twist(
            twist.v * scale + (0.003 * rng.normal() if twist.v else 0.0),
            twist.omega + bias + math.radians(0.1) * rng.normal(),
        )
        if k:
            odom = arc(odom, noisy, DT)
        if k % every == 0:
            begin = now - duration
            ranges, piece = np.empty(n), np.empty(n)
            for p in range(parts):
                a, b = p * n // parts, (p + 1) * n // parts
                t = begin + duration * (0.5 * (a + b) / n)
                bodies = around(t) if callable(around) else around
                cast(true_at(t), lidar, bodies, walls, grid, seed, number, piece)
                ranges[a:b] = piece[a:b]
            waiting.append((now + DELAY, Scan(begin, number, ranges, duration)))
            number += 1
        last = scan
        while waiting and waiting[0][0] <= now + 1e-9:
            scan = waiting.pop(0)[1]
        reading = Odometry(now, odom, noisy)
        yield Moment(now, Readings(reading, scan, None, None), pose, twist, scan is not last)


def lab_map(resolution=0.025, spread=0.02, seed=0, cones=True):
    """Cells of the lab as a good mapping leaves them: occupied, free, resolution, origin."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-4.0, -4.5]), np.array([17.0, 5.5])
    size = np.ceil((high - low) / resolution).astype(int)
    points = []
    for x1, y1, x2, y2 in WALLS:
        m = int(np.hypot(x2 - x1, y2 - y1) / 0.002)
        s = np.linspace(0.0, 1.0, m)[:, None]
        points.append(np.array([x1, y1]) + s * np.array([x2 - x1, y2 - y1]))
    if cones:
        a = np.linspace(0.0, 2.0 * np.pi, 400)
        points += [c[:2] + c[4] * np.column_stack((np.cos(a), np.sin(a))) for c in CONES]
    all_ = np.vstack(points)
    cells = np.floor((all_ + rng.normal(0.0, spread, all_.shape) - low) / resolution).astype(int)
    hits = np.zeros((size[1], size[0]))
    np.add.at(hits, (cells[:, 1], cells[:, 0]), 1.0)
    occupied = hits > 0.35 * hits.max()
    y, x = np.mgrid[0 : size[1], 0 : size[0]]
    wx, wy = low[0] + (x + 0.5) * resolution, low[1] + (y + 0.5) * resolution
    room = (wx > -1) & (wx < 14) & (wy > -4) & (wy < 3)
    corridor = (wx > -3.5) & (wx < 16.5) & (wy >= 3) & (wy < 5)
    free = (room | corridor) & ~occupied
    return occupied, free, resolution, Pose(float(low[0]), float(low[1]), 0.0)


def nearby(pose, rng, sigma=0.05):
    """A first guess."""
    shift = Pose(*(rng.normal(0.0, 1.0, 3) * (sigma, sigma, sigma)).tolist())
    return compose(pose, shift)
