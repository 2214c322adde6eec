"""The paper's law a second time: slow, plain NumPy, written from the paper's equations alone.

Nothing here comes from `cohelm.law`; the tests compare the two. World frame: x forward, y
left, yaw counter-clockwise (E1). SI and radians. Equation numbers are the paper's; E1, E2, … are
its errata as docs/paper.md reads them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Parameters:
    """Table II, and what the paper leaves open (E3)."""

    k_x: float = 0.9
    k_psi: float = 1.0
    K: float = 0.5
    C: float = 0.5
    k_cbf: float = 1.5
    k_hx: float = 0.5
    k_hpsi: float = 0.5
    k_s: float = 5.0
    c_joy: float = 0.05
    joint: bool = True
    """(47)(48) rather than (43)(44)."""
    printed_sign: bool = False
    """The sign of (27) as printed, which is wrong (E2)."""
    barrier: bool = True


@dataclass(frozen=True)
class Goal:
    """What the reference asks for at one moment: pose, surge speed, yaw rate."""

    x: float
    y: float
    psi: float
    u: float
    r: float


def wrap(angle: float) -> float:
    """The same angle in (−π, π]."""
    wrapped = math.atan2(math.sin(angle), math.cos(angle))
    return math.pi if wrapped == -math.pi else wrapped


# ---------------------------------------------------------------- reference (7)–(13)


class Spline:
    """Natural cubic splines S_X(t), S_Y(t), by the dense system for the knots' bends (7)–(11)."""

    def __init__(self, waypoints: list[tuple[float, float]], speed: float) -> None:
        self.points = np.asarray(waypoints, dtype=float)
        chords = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        self.knots = np.concatenate([[0.0], np.cumsum(chords / speed)])
        n = len(self.knots)
        step = np.diff(self.knots)
        slope = np.diff(self.points, axis=0) / step[:, None]
        matrix, right = np.eye(n), np.zeros((n, 2))
        for i in range(1, n - 1):
            matrix[i, i - 1 : i + 2] = step[i - 1] / 6, (step[i - 1] + step[i]) / 3, step[i] / 6
            right[i] = slope[i] - slope[i - 1]
        self.bend = np.linalg.solve(matrix, right)

    def __call__(self, t: Vector | float) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration at times within the knots, each (..., 2)."""
        t = np.asarray(t, dtype=float)
        i = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        d = (self.knots[i + 1] - self.knots[i])[..., None]
        b = (t - self.knots[i])[..., None] / d
        a = 1 - b
        p, q, m, n = self.points[i], self.points[i + 1], self.bend[i], self.bend[i + 1]
        place = a * p + b * q + ((a**3 - a) * m + (b**3 - b) * n) * d**2 / 6
        speed = (q - p) / d + ((3 * b**2 - 1) * n - (3 * a**2 - 1) * m) * d / 6
        return place, speed, a * m + b * n

    def goals(self, t: Vector, u_d: float | None) -> list[Goal]:
        """Desired pose, speed, yaw rate (12)(13)(E9); `u_d` None takes the spline's own (E10)."""
        place, velocity, acceleration = self(t)
        (vx, vy), (ax, ay) = velocity.T, acceleration.T
        speed = np.hypot(vx, vy)
        u = speed if u_d is None else np.full_like(speed, u_d)
        columns = (*place.T, np.arctan2(vy, vx), u, (vx * ay - vy * ax) / speed**2)
        return [Goal(*row) for row in np.column_stack(columns).tolist()]

    def goal(self, t: float, u_d: float | None) -> Goal:
        """The same at one time."""
        return self.goals(np.array([t]), u_d)[0]


# ---------------------------------------------------------------- tracking (14)–(17)


def tracking(eta: Vector, goal: Goal, p: Parameters) -> Vector:
    """τ_c (15)."""
    x, y, psi = eta
    ex, ey, epsi = goal.x - x, goal.y - y, wrap(goal.psi - psi)
    exb = ex * math.cos(psi) + ey * math.sin(psi)
    eyb = -ex * math.sin(psi) + ey * math.cos(psi)
    surge = goal.u * math.cos(epsi) + p.k_x * exb
    return np.array([surge, goal.r + p.k_psi * math.sin(epsi) + eyb * goal.u])


# ---------------------------------------------------------------- human and blend (34)–(48)


def wish(stick: Vector, u_d: float, p: Parameters) -> Vector:
    """τ_h (45)(46), with the missing case of (45) read as the fore-aft rule (E8)."""
    fore, left = stick
    fore_out, left_out = abs(fore) > p.c_joy, abs(left) > p.c_joy
    if fore_out:
        surge = p.k_hx * fore * u_d
    elif left_out:
        surge = p.k_hx * u_d
    else:
        surge = 0.0
    return np.array([surge, p.k_hpsi * left if left_out else 0.0])


def intent(stick: Vector, p: Parameters) -> Vector:
    """(V_hx, V_hψ) (41)(42); an axis inside the dead band has none."""
    return np.where(np.abs(stick) > p.c_joy, 0.5 * p.k_s * stick**2, 0.0)


def authority(stick: Vector, p: Parameters) -> Vector:
    """Diagonal of K_c: the controller's share per axis (44)(48)."""
    v = intent(stick, p)
    return np.exp(-np.array([v.sum(), v.sum()] if p.joint else v))


def blended(tau_c: Vector, tau_h: Vector, k_c: Vector) -> Vector:
    """τ (34)."""
    return np.diag(1 - k_c) @ tau_h + np.diag(k_c) @ tau_c


# ---------------------------------------------------------------- barrier (19)–(33)


def margins(eta: Vector, discs: Vector) -> Vector:
    """h_i for rows (x, y, vx, vy, r)."""
    return (eta[0] - discs[:, 0]) ** 2 + (eta[1] - discs[:, 1]) ** 2 - discs[:, 4] ** 2


def B(eta: Vector, discs: Vector) -> float:
    """(22)."""
    return float(np.sum(1 / margins(eta, discs)) + np.cos(eta[2]) ** 2)


def L_gB(eta: Vector, discs: Vector) -> Vector:
    """(26): the gradient of B through the unicycle (5)."""
    h = margins(eta, discs)
    dx = np.sum(-2 * (eta[0] - discs[:, 0]) / h**2)
    dy = np.sum(-2 * (eta[1] - discs[:, 1]) / h**2)
    g = np.array([[np.cos(eta[2]), 0], [np.sin(eta[2]), 0], [0, 1]])
    return np.array([dx, dy, -np.sin(2 * eta[2])]) @ g


def drift(eta: Vector, discs: Vector, p: Parameters) -> float:
    """Σ ∂B/∂o_i · ȯ_i (27), the true sign or the printed one (E2)."""
    h = margins(eta, discs)
    closing = (eta[0] - discs[:, 0]) * discs[:, 2] + (eta[1] - discs[:, 1]) * discs[:, 3]
    return float(np.sum((-2 if p.printed_sign else 2) * closing / h**2))


def I_and_J(eta: Vector, tau: Vector, discs: Vector, p: Parameters) -> tuple[float, float]:
    """(31) and (32)."""
    return float(L_gB(eta, discs) @ tau) + drift(eta, discs, p), p.K * B(eta, discs) + p.C


def avoidance(eta: Vector, tau: Vector, discs: Vector, p: Parameters) -> Vector:
    """**u** (33), unguarded: it divides by ‖L_gB‖²."""
    I, J = I_and_J(eta, tau, discs, p)
    if I <= J or not p.barrier:
        return np.zeros(2)
    slope = L_gB(eta, discs)
    turn = p.k_cbf * np.tanh(1 / margins(eta, discs).min()) if len(discs) else 0.0
    return -(I - J) / (slope @ slope) * slope - np.array([0.0, turn])


# ---------------------------------------------------------------- all of it (49)


@dataclass(frozen=True)
class Step:
    tau_c: Vector
    tau_h: Vector
    k_c: Vector
    tau: Vector
    u: Vector
    U: Vector
    I: float
    J: float


def step(eta: Vector, goal: Goal, u_d: float, stick: Vector, discs: Vector, p: Parameters) -> Step:
    """One control step: U = τ + **u** (49). `u_d` scales the person's wish (45)."""
    tau_c, tau_h, k_c = tracking(eta, goal, p), wish(stick, u_d, p), authority(stick, p)
    tau = blended(tau_c, tau_h, k_c)
    u = avoidance(eta, tau, discs, p)
    return Step(tau_c, tau_h, k_c, tau, u, tau + u, *I_and_J(eta, tau, discs, p))


def plant(eta: Vector, U: Vector) -> Vector:
    """η̇ = g(η) U (5)(6)."""
    return np.array([U[0] * math.cos(eta[2]), U[0] * math.sin(eta[2]), U[1]])


def closed_loop(
    start: Vector, spline: Spline, u_d: float, p: Parameters, dt: float = 1e-3
) -> tuple[Vector, Vector]:
    """Tracking in continuous time, by RK4 with the law at every stage: times and poses."""
    steps = int(spline.knots[-1] / dt)
    goals = spline.goals(dt / 2 * np.arange(2 * steps + 1), u_d)

    def rate(half: int, eta: Vector) -> Vector:
        return plant(eta, tracking(eta, goals[half], p))

    poses = np.empty((steps + 1, 3))
    poses[0] = start
    for k in range(steps):
        eta = poses[k]
        a = rate(2 * k, eta)
        b = rate(2 * k + 1, eta + dt / 2 * a)
        c = rate(2 * k + 1, eta + dt / 2 * b)
        d = rate(2 * k + 2, eta + dt * c)
        poses[k + 1] = eta + dt / 6 * (a + 2 * b + 2 * c + d)
    return dt * np.arange(steps + 1), poses


def pose_error(eta: Vector, goal: Goal) -> float:
    """E_P (51), the heading difference wrapped (E9)."""
    return float(
        np.sqrt((eta[0] - goal.x) ** 2 + (eta[1] - goal.y) ** 2 + wrap(eta[2] - goal.psi) ** 2)
    )
