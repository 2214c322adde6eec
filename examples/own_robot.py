"""A robot of one's own with loop, gate and station: three methods around whatever moves it. The
hardware here is some arithmetic; put your driver in its place.

    python examples/own_robot.py
    cohelm drive lab-guard --driver own_robot:Cart    # in this folder: the same, from a browser
"""

import math

import numpy as np

import cohelm

WALLS = np.array(cohelm.load_scenario("lab-guard").walls_m)  # x1, y1, x2, y2 [m]


class Cart(cohelm.Robot):
    """Wheels that do what they are told, and a LiDAR that sees the lab's walls."""

    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model)
        self.pose, self.twist = cohelm.Pose(0.0, -1.75, math.pi / 2), cohelm.Twist(0.0, 0.0)
        self.moved = self.scanned = self.now()
        self.noise = np.random.default_rng(1)

    def read(self) -> cohelm.Readings:
        """Odometry, and a scan ten times a second."""
        dt, (x, y, psi), (v, omega) = self.now() - self.moved, self.pose, self.twist
        self.moved, turned = self.moved + dt, psi + 0.5 * omega * dt
        x, y = x + v * dt * math.cos(turned), y + v * dt * math.sin(turned)
        self.pose = cohelm.Pose(x, y, psi + omega * dt)
        odometry = self.odometry(self.pose, self.twist)
        if self.now() - self.scanned < 0.1:
            return cohelm.Readings(odometry)
        self.scanned = self.now()
        return cohelm.Readings(odometry, self.scan(self.look()))

    def send(self, twist: cohelm.Twist) -> None:
        self.twist = twist

    def stop(self) -> None:
        self.twist = cohelm.Twist(0.0, 0.0)

    def look(self) -> np.ndarray:
        """Where each beam meets the nearest wall [m]."""
        x, y, psi = self.pose
        bearings = psi + np.radians(np.linspace(-135.0, 135.0, 720))[:, None]
        ux, uy = np.cos(bearings), np.sin(bearings)
        ox, oy = x + 0.3 * math.cos(psi), y + 0.3 * math.sin(psi)  # the sensor is on the bow
        ax, ay, ex, ey = (*WALLS[:, :2].T, *(WALLS[:, 2:] - WALLS[:, :2]).T)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((ax - ox) * ey - (ay - oy) * ex) / (ux * ey - uy * ex)
            share = ((ax - ox) * uy - (ay - oy) * ux) / (ux * ey - uy * ex)
        hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0)
        return np.where(hit, along, math.inf).min(axis=1) + self.noise.normal(0.0, 0.01, 720)


if __name__ == "__main__":
    end = cohelm.drive(Cart, "lab-guard", model="sally", seconds=20.0)
    print(f"{end['periods']} periods, latest by {1e3 * end['late_worst']:.1f} ms; {end['reason']}")
