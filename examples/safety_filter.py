"""The filter around one's own controller, with one's own footprint, limits and LiDAR.

A delivery cart goes for a goal behind a wall, as fast as it can; only the filter knows of the wall.
"""

import math

import numpy as np

import cohelm

PERIOD = 0.05  # 20 Hz [s]
FOOTPRINT = [[0.5, 0.3], [-0.2, 0.3], [-0.2, -0.3], [0.5, -0.3]]  # around the wheel axle [m]
LIMITS = cohelm.Limits(speed=1.5, acceleration=1.0, yaw_rate=1.5, yaw_acceleration=3.0)
CART = cohelm.RobotModel.of("cart", FOOTPRINT, LIMITS, delay=0.08)
WALL = 4.0  # x of a wall that goes on to both sides [m]


def lidar(pose: cohelm.Pose) -> np.ndarray:
    """Ranges of 360 beams all round, noisy by 1 cm; infinite where they hit nothing [m]."""
    bearings = pose.psi + math.radians(1.0) * np.arange(360)
    with np.errstate(divide="ignore"):
        ranges = (WALL - pose.x) / np.cos(bearings)
    noise = np.random.default_rng(1).normal(0.0, 0.01, 360)
    return np.where((ranges > 0.0) & (ranges < 10.0), ranges + noise, math.inf)


def controller(pose: cohelm.Pose) -> cohelm.Twist:
    """Straight at a goal 10 m ahead, mindless of anything in between."""
    turn = math.remainder(math.atan2(-pose.y, 10.0 - pose.x) - pose.psi, 2.0 * math.pi)
    return cohelm.Twist(1.5, 2.0 * turn)


def main(seconds: float = 10.0) -> float:
    """Drive; how near the bow came to the wall [m]."""
    safe = cohelm.SafetyFilter(CART, PERIOD, position_error=0.02)
    pose, twist = cohelm.Pose(0.0, 0.0, 0.1), cohelm.Twist(0.0, 0.0)
    under_way = [twist] * 2  # the cart obeys late, as its model says
    for k in range(round(seconds / PERIOD)):
        seen = cohelm.Obstacles.from_ranges(lidar(pose), 0.0, math.radians(1.0))
        out = safe(pose, twist, controller(pose), seen.placed(pose))
        under_way.append(out.twist)
        twist = under_way.pop(0)
        ahead, left = math.cos(pose.psi) * PERIOD, math.sin(pose.psi) * PERIOD
        pose = cohelm.Pose(pose.x + twist.v * ahead, pose.y + twist.v * left,
                           pose.psi + twist.omega * PERIOD)  # fmt: skip
        if k % 20 == 0:
            print(f"{k * PERIOD:4.1f} s  v {twist.v:.2f} m/s  {out.verdict.name}")
    return WALL - max(
        pose.x + c * math.cos(pose.psi) - s * math.sin(pose.psi) for c, s in FOOTPRINT
    )


if __name__ == "__main__":
    print(f"the bow stands {100 * main():.0f} cm before the wall")
