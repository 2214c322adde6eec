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
from cohelm.robot.footprint import disc_clearance, segment_clearance


@dataclass(frozen=True)
class Body:
    """A disc of a world. At t = 0 it is at `row`; it drifts with the row's velocity, or, with
    a path, rests at the path's start until `start` [s], follows it, and rests at its end."""

    row: tuple[float, float, float, float, float, float]
    path: Reference | None = None
    start: float = 0.0
    noticed: bool = True
    """Whether the simulated person minds it."""


class World(NamedTuple):
    """Any number of worlds as flat arrays; world w has discs first[w]:first[w + 1].

    discs: (D, 6) at t = 0. noticed: (D,). path_first: (D + 1,) rows of a disc's knots; none if
    it rests or drifts. knots: (K,) times [s]. coeffs: (K, 8) as in `law.reference` (the last
    row of each path is not used). walls: (S, 4) segments x1, y1, x2, y2 [m].
    """

    first: Ints
    discs: Floats
    noticed: NDArray[np.bool_]
    path_first: Ints
    knots: Floats
    coeffs: Floats
    wall_first: Ints
    walls: Floats


def world(*scenes: tuple[Sequence[Body], Floats]) -> World:
    """Worlds from (bodies, walls) pairs; walls (s, 4) may be empty."""
    bodies = [body for scene, _ in scenes for body in scene]
    knots: list[Floats] = []
    coeffs: list[Floats] = []
    lengths: list[int] = []
    for body in bodies:
        if body.path is None:
            lengths.append(0)
            continue
        knots.append(body.path.knots + body.start)
        coeffs.append(np.vstack((body.path.coeffs, np.zeros((1, 8)))))
        lengths.append(len(body.path.knots))
    walls = [np.asarray(w, dtype=np.float64).reshape(-1, 4) for _, w in scenes]
    return World(
        first=_starts([len(scene) for scene, _ in scenes]),
        discs=np.array([body.row for body in bodies], dtype=np.float64).reshape(-1, 6),
        noticed=np.array([body.noticed for body in bodies], dtype=np.bool_),
        path_first=_starts(lengths),
        knots=np.concatenate([*knots, np.empty(0)]),
        coeffs=np.concatenate([*coeffs, np.empty((0, 8))]),
        wall_first=_starts([len(w) for w in walls]),
        walls=np.concatenate([*walls, np.empty((0, 4))]),
    )


def _starts(lengths: list[int]) -> Ints:
    return np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64)


@jit_inline
def moves(w: int, worlds: World) -> bool:
    """Whether any disc of world w ever moves."""
    for i in range(worlds.first[w], worlds.first[w + 1]):
        drifts = worlds.discs[i, VX] != 0.0 or worlds.discs[i, VY] != 0.0
        if drifts or worlds.path_first[i] < worlds.path_first[i + 1]:
            return True
    return False


@jit_inline
def place(discs: Floats, w: int, worlds: World, t: float) -> None:
    """Write the discs of world w as they are at time t into `discs`."""
    offset = worlds.first[w]
    for j in range(discs.shape[0]):
        i = offset + j
        a, b = worlds.path_first[i], worlds.path_first[i + 1]
        discs[j, RADIUS], discs[j, SAFE] = worlds.discs[i, RADIUS], worlds.discs[i, SAFE]
        if a == b:
            discs[j, X] = worlds.discs[i, X] + t * worlds.discs[i, VX]
            discs[j, Y] = worlds.discs[i, Y] + t * worlds.discs[i, VY]
            discs[j, VX], discs[j, VY] = worlds.discs[i, VX], worlds.discs[i, VY]
        else:
            m = evaluate(worlds.knots[a:b], worlds.coeffs[a:b], t)
            going = worlds.knots[a] <= t < worlds.knots[b - 1]
            discs[j, X], discs[j, Y] = m.x, m.y
            discs[j, VX], discs[j, VY] = (m.vx, m.vy) if going else (0.0, 0.0)


@jit_inline
def clearance(
    pose: Pose, outline: Floats, reach: float, discs: Floats, walls: Floats, least: float
) -> float:
    """The smaller of `least` and the outline's gap to the nearest disc or wall [m].

    `reach` is the outline's farthest corner: what is farther than `least` even from that circle
    is skipped, so the exact test runs only where a new smallest gap is possible.
    """
    for i in range(discs.shape[0]):
        dx, dy = discs[i, X] - pose.x, discs[i, Y] - pose.y
        near = max(least + reach + discs[i, RADIUS], 0.0)
        if dx * dx + dy * dy < near * near:
            gap = disc_clearance(pose, outline, discs[i, X], discs[i, Y], discs[i, RADIUS])
            least = min(least, gap)
    for i in range(walls.shape[0]):
        ex, ey = walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]
        wx, wy = pose.x - walls[i, 0], pose.y - walls[i, 1]
        length = ex * ex + ey * ey
        s = min(max((wx * ex + wy * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
        gx, gy = wx - s * ex, wy - s * ey
        near = max(least + reach, 0.0)
        if gx * gx + gy * gy < near * near:
            gap = segment_clearance(
                pose, outline, walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3]
            )
            least = min(least, gap)
    return least


NOWHERE = math.inf
"""Clearance where there is nothing to hit."""
