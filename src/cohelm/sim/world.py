"""Discs that rest, drift or follow a path, and walls: the world around the simulated robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit_inline
from cohelm.core.types import RADIUS, SAFE, VX, VY, Floats, Ints, Pose, X, Y
from cohelm.law.reference import Reference, evaluate
from cohelm.robot.clearance import disc_clearance, segment_clearance


@dataclass(frozen=True)
class Body:
    """A disc of a world. At t = 0 it is at `row`; it drifts with the row's velocity, or, with
    a path, rests at the path's start until `start` [s], follows it, and rests at its end."""

    row: tuple[float, float, float, float, float, float]
    path: Reference | None = None
    start: float = 0.0
    noticed: bool = True
    """Whether the simulated operator dodges it."""


class World(NamedTuple):
    """Discs and walls as flat arrays.

    discs: (n, 6) at t = 0. noticed: (n,). path_first: (n + 1,) rows of a disc's knots; none if
    it rests or drifts. knots: (K,) times [s]. coeffs: (K, 8) as in `law.reference` (the last
    row of each path is not used). walls: (s, 4) segments x1, y1, x2, y2 [m].
    """

    discs: Floats
    noticed: NDArray[np.bool_]
    path_first: Ints
    knots: Floats
    coeffs: Floats
    walls: Floats


def world(scene: tuple[Sequence[Body], Floats]) -> World:
    """A world from (bodies, walls); walls (s, 4) may be empty."""
    bodies, walls = scene
    paths = [body.path for body in bodies]
    lengths = [0 if path is None else len(path.knots) for path in paths]
    return World(
        discs=np.array([body.row for body in bodies], dtype=np.float64).reshape(-1, 6),
        noticed=np.array([body.noticed for body in bodies], dtype=np.bool_),
        path_first=np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64),
        knots=np.concatenate([*[b.path.knots + b.start for b in bodies if b.path], np.empty(0)]),
        coeffs=np.concatenate([
            *[np.vstack((path.coeffs, np.zeros((1, 8)))) for path in paths if path],
            np.empty((0, 8)),
        ]),
        walls=np.asarray(walls, dtype=np.float64).reshape(-1, 4),
    )  # fmt: skip


def ever_moving(world: World) -> NDArray[np.bool_]:
    """(n,): which discs ever move."""
    drifts = (world.discs[:, VX] != 0.0) | (world.discs[:, VY] != 0.0)
    return drifts | (np.diff(world.path_first) > 0)


@jit_inline
def place_one(disc: Floats, i: int, world: World, t: float) -> None:
    """Write disc i as it is at time t into the row `disc`."""
    a, b = world.path_first[i], world.path_first[i + 1]
    disc[RADIUS], disc[SAFE] = world.discs[i, RADIUS], world.discs[i, SAFE]
    if a == b:
        disc[X] = world.discs[i, X] + t * world.discs[i, VX]
        disc[Y] = world.discs[i, Y] + t * world.discs[i, VY]
        disc[VX], disc[VY] = world.discs[i, VX], world.discs[i, VY]
    else:
        m = evaluate(world.knots[a:b], world.coeffs[a:b], t)
        going = world.knots[a] <= t < world.knots[b - 1]
        disc[X], disc[Y] = m.x, m.y
        disc[VX], disc[VY] = (m.vx, m.vy) if going else (0.0, 0.0)


@jit_inline
def place(discs: Floats, world: World, t: float) -> None:
    """Write all discs as they are at time t into `discs`."""
    for i in range(discs.shape[0]):
        place_one(discs[i], i, world, t)


@jit_inline
def from_wall(pose: Pose, walls: Floats, i: int) -> tuple[float, float]:
    """From the nearest point of wall i to where something is [m]."""
    ex, ey = walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]
    wx, wy = pose.x - walls[i, 0], pose.y - walls[i, 1]
    length = ex * ex + ey * ey
    s = min(max((wx * ex + wy * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
    return wx - s * ex, wy - s * ey


@jit_inline
def outline_clearance(
    pose: Pose, outline: Floats, reach: float, discs: Floats, walls: Floats, least: float
) -> float:
    """The smaller of `least` and the outline's clearance to the nearest disc or wall [m].

    `reach` is the outline's farthest corner: what is farther than `least` even from that circle
    is skipped, so the exact test runs only where a new smallest clearance is possible.
    """
    for i in range(discs.shape[0]):
        dx, dy = discs[i, X] - pose.x, discs[i, Y] - pose.y
        near = max(least + reach + discs[i, RADIUS], 0.0)
        if dx * dx + dy * dy < near * near:
            clearance = disc_clearance(pose, outline, discs[i, X], discs[i, Y], discs[i, RADIUS])
            least = min(least, clearance)
    for i in range(walls.shape[0]):
        gx, gy = from_wall(pose, walls, i)
        near = max(least + reach, 0.0)
        if gx * gx + gy * gy < near * near:
            clearance = segment_clearance(
                pose, outline, walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3]
            )
            least = min(least, clearance)
    return least


NOWHERE = math.inf
"""Clearance where there is nothing to hit."""
