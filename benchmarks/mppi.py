"""Model predictive path integral control as a peer in campaigns: tau-ctrl's, with costs of ours.

    .venv/bin/uv pip install tau-ctrl
    python -m cohelm campaign random --compare guard,rvo,vo,benchmarks.mppi:controller

The method (Williams et al. 2017) is the package's: 300 sequences of 30 twists, 0.1 s apart, with
noise that is correlated along a sequence, weighed by the exponential of their reward. What a
sequence is worth is ours, in the manner of Nav2's critics: at each of its steps the distance from
the goal, the clearance, contacts, and speed above the reference. Each mover is predicted with
constant velocity. The outline is two circles. It runs ten times a second, without a filter behind
it. It knows discs, walls, and the limits of the wheels.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

import cohelm
from cohelm.core.types import RADIUS, VX, VY, Floats, X, Y
from cohelm.study.controlled import Observation

HOLD = 5  # control steps for which one of its commands is held: 0.1 s
STEP, HORIZON, SAMPLES = 0.1, 30, 300
NEAR = 0.4  # gap below which a step is the worse the nearer it is [m]
SHY, TOUCH = 3.0, 100.0  # what a step right beside something costs, and one in it [m]
BACKWARD = 0.3  # what a step backwards costs [m]
HASTE = 3.0  # what a step costs for each m/s that it is faster than the reference [s]
TEMPERATURE = 1.0


def controller(robot: cohelm.RobotModel, period: float) -> Controller:
    """A new controller for each episode."""
    return Controller(robot, period)


class Controller:
    """Runs the package's controller every 0.1 s."""

    def __init__(self, robot: cohelm.RobotModel, period: float) -> None:
        from gymnasium.spaces import Box

        self.rollouts = Rollouts(robot)
        self.observation_space, self.action_space = None, Box(-1.0, 1.0, (2,))
        mppi: Any = importlib.import_module("tau_ctrl").make
        self.mppi = mppi(
            "mppi", self, horizon=HORIZON, n_samples=SAMPLES, noise_sigma=0.5, noise_beta=0.8,
            temperature=TEMPERATURE, vector_env_fn=lambda _: self.rollouts, seed=1, device="cpu",
        )  # fmt: skip
        self.steps, self.command = 0, cohelm.Twist(0.0, 0.0)

    def get_state(self) -> Observation:
        return self.now

    def set_state(self, _state: Observation) -> None:
        """Nothing here moves."""

    def __call__(self, now: Observation) -> cohelm.Twist:
        if self.steps % HOLD == 0:
            self.now = now
            action, _ = self.mppi.predict(None)
            v, omega = self.rollouts.twists(action[None])[0]
            self.command = cohelm.Twist(float(v), float(omega))
        self.steps += 1
        return self.command


class Rollouts:
    """All sequences at once, as the package requires."""

    def __init__(self, robot: cohelm.RobotModel) -> None:
        self.limits = robot.bounds()
        size = np.ptp(robot.outline, axis=0)
        self.off = 0.25 * float(size[0])  # of the two circles from the middle [m]
        self.radius = math.hypot(self.off, 0.5 * float(size[1]))

    def twists(self, actions: Floats) -> Floats:
        return actions * np.array([self.limits.speed, self.limits.yaw_rate])

    def reset(self) -> None:
        """Restart with `set_state`."""

    def set_state(self, states: list[Observation]) -> None:
        now, n = states[0], len(states)
        self.pose = np.tile(np.array(now.pose), (n, 1))
        self.twist = np.tile(np.array(now.twist), (n, 1))
        self.discs, self.walls = now.obstacles.discs, now.obstacles.segments
        self.goal, self.wanted, self.t = np.array(now.goal), now.reference.u, 0.0
        self.over = np.zeros(n, dtype=bool)

    def step(self, actions: Floats) -> tuple[None, Floats, Any, Any, None]:
        """One step of all sequences: no observation, rewards, terminated, truncated, no info."""
        self.t += STEP
        most = self.limits.wheel_acceleration * STEP
        change = self.twists(actions) - self.twist
        rim = np.abs(change[:, 0]) + 0.5 * self.limits.track * np.abs(change[:, 1])
        self.twist += change * np.minimum(1.0, most / np.maximum(rim, 1e-9))[:, None]
        psi = self.pose[:, 2] + 0.5 * STEP * self.twist[:, 1]
        self.pose[:, 0] += STEP * self.twist[:, 0] * np.cos(psi)
        self.pose[:, 1] += STEP * self.twist[:, 0] * np.sin(psi)
        self.pose[:, 2] += STEP * self.twist[:, 1]
        gap = self.gap()
        far = np.hypot(*(self.pose[:, :2] - self.goal).T)
        near = np.clip(1.0 - gap / NEAR, 0.0, 1.0)
        cost = far + SHY * near * near + TOUCH * (gap <= 0.0) + BACKWARD * (self.twist[:, 0] < 0.0)
        cost += HASTE * np.maximum(np.abs(self.twist[:, 0]) - self.wanted, 0.0)
        return None, -cost * STEP, self.over, self.over, None

    def gap(self) -> Floats:
        """Clearance of each pose to the nearest predicted obstacle [m]."""
        c, s = np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])
        least = np.full(len(self.pose), math.inf)
        d = self.discs
        for side in (-self.off, self.off):
            x, y = self.pose[:, 0] + side * c, self.pose[:, 1] + side * s
            if len(d):
                dx = d[:, X] + self.t * d[:, VX] - x[:, None]
                dy = d[:, Y] + self.t * d[:, VY] - y[:, None]
                least = np.minimum(least, (np.hypot(dx, dy) - d[:, RADIUS]).min(axis=1))
            if len(self.walls):
                a, e = self.walls[:, :2], self.walls[:, 2:] - self.walls[:, :2]
                wx, wy = x[:, None] - a[:, 0], y[:, None] - a[:, 1]
                along = np.clip((wx * e[:, 0] + wy * e[:, 1]) / (e * e).sum(axis=1), 0.0, 1.0)
                off = np.hypot(wx - along * e[:, 0], wy - along * e[:, 1])
                least = np.minimum(least, off.min(axis=1))
        return least - self.radius
