"""Cells of the ground that have been in view, and the border of those that have not.

Pure functions; `perceive.space.unobserved` keeps their cells from one sweep to the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import Floats, Ints, Pose
from cohelm.perceive.scan.deskew import DeskewedScan, beam_at, in_view
from cohelm.perceive.space.assumed import (
    NX,
    NY,
    SX,
    SY,
)
from cohelm.perceive.space.cell_window import CELL, NEVER, SIDE, cell, holds, nowhere
from cohelm.perceive.space.free_space_memory import NEAR
from cohelm.perceive.track.departed import HVX, HVY, HX, HY, REACH, UNSEEN
from cohelm.robot.clearance import circumscribed_radius, disc_clearance
from cohelm.robot.sensors import Lidar

KEPT = 2.7
"""Ground is remembered up to this distance from the LiDAR: less than by the collision monitor
(`free_space`, 2.85 m and half a step), which would stop the robot on it [m]. Of a robot that
reaches farther from its LiDAR it is remembered farther, as by the monitor."""

_ARRIVAL_TIME = 4.0  # a mover that left the view farther away matters if it arrives within it [s]
_APART = 0.03  # minimum distance of a mover out of view from the outline [m]
_JUST_LEFT = 0.25  # a mover seen so recently is where it is predicted [s]
_REPORTED = 1.0  # beyond the turning circle, within which the border is reported, at least [m]


class ObservedCells(NamedTuple):
    """A window of cells that have been in view, see `perceive.space.cell_window`.

    occupied: (n, n), whether a mover that left the view may be in a cell. assumed: (n, n), whether
    it has only been assumed to be free.
    """

    which: Ints
    occupied: NDArray[np.bool_]
    assumed: NDArray[np.bool_]


class Extent(NamedTuple):
    """How far ground matters and is remembered."""

    kept: float
    """From each LiDAR [m]."""
    seen: float
    """From each LiDAR, up to which ground in its view becomes known [m]."""
    reported: float
    """From the body's origin, within which the border is reported [m]."""
    side: int
    """Cells along one side of a window that holds all of that, wherever the LiDARs are."""


def extent(lidars: Sequence[Lidar], reach: float, circle: float, stopping: float) -> Extent:
    """The extent for a robot. reach: of its outline. circle: radius of the ground in which it has
    to be able to turn. stopping: distance in which it stops from full speed [m]."""
    away = max(math.hypot(one.mount.x, one.mount.y) for one in lidars)
    kept = max(KEPT, away + circle + _REPORTED)
    # Beyond what is kept nothing borders on observed ground.
    reported = reach + min(max(_REPORTED, stopping), kept + away + CELL)
    side = max(SIDE, 2 * math.ceil((kept + away) / CELL) + 2)
    return Extent(kept, kept - (KEPT - NEAR), reported, side)


def no_cells(side: int = SIDE) -> ObservedCells:
    """No cell has been in view."""
    return ObservedCells(
        nowhere(side), np.zeros((side, side), np.bool_), np.zeros((side, side), np.bool_)
    )


def enlarged(cells: ObservedCells, side: int) -> ObservedCells:
    """The same cells in a window of at least so many to a side."""
    if side <= len(cells.which):
        return cells
    made, held = no_cells(side), cells.which[..., 0] != NEVER
    i, j = cells.which[held].T
    made.which[i % side, j % side] = cells.which[held]
    made.occupied[i % side, j % side] = cells.occupied[held]
    made.assumed[i % side, j % side] = cells.assumed[held]
    return made


@jit
def assumed_free(cells: ObservedCells, pose: Pose, outline: Floats, radius: float) -> ObservedCells:
    """With the ground within a radius of a robot's origin assumed free [m]. That which it stands on
    is observed."""
    which, occupied, assumed = cells.which.copy(), cells.occupied.copy(), cells.assumed.copy()
    side, reach = len(which), max(radius, circumscribed_radius(outline))
    low_x, low_y = cell(pose.x - reach), cell(pose.y - reach)
    wide = math.ceil(2.0 * reach / CELL) + 1
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            x, y = (i + 0.5) * CELL, (j + 0.5) * CELL
            stood_on = disc_clearance(pose, outline, x, y, 0.0) <= 0.0
            if stood_on or math.hypot(x - pose.x, y - pose.y) < radius:
                _set_observed(which, occupied, i, j)
                assumed[i % side, j % side] = not stood_on
    return ObservedCells(which, occupied, assumed)


@jit
def without_covered(
    cells: ObservedCells, surfaces: Floats, sweeps: tuple[DeskewedScan, ...], pose: Pose,
    outline: Floats,
) -> ObservedCells:  # fmt: skip
    """Without the assumed ground that a surface may cover, see `space.assumed`: out of view, beyond
    it, and nothing between has been seen free. Ground that the robot stands on is observed."""
    which, assumed = cells.which.copy(), cells.assumed.copy()
    other = np.ones(len(surfaces), np.bool_)  # than the robot itself
    for k in range(len(surfaces)):
        other[k] = disc_clearance(pose, outline, surfaces[k, SX], surfaces[k, SY], 0.0) > 0.0
    surfaces = surfaces[other]
    for a in range(len(which)):
        for b in range(len(which)):
            if not assumed[a, b] or which[a, b, 0] == NEVER:
                continue
            x, y = (which[a, b, 0] + 0.5) * CELL, (which[a, b, 1] + 0.5) * CELL
            if disc_clearance(pose, outline, x, y, 0.0) <= 0.0:
                assumed[a, b] = False
            elif not _in_view(sweeps, x, y) and _covered(cells, surfaces, sweeps, x, y):
                which[a, b, 0] = NEVER
    return ObservedCells(which, cells.occupied, assumed)


@jit_inline
def _covered(
    cells: ObservedCells, surfaces: Floats, sweeps: tuple[DeskewedScan, ...], x: float, y: float
) -> bool:
    """Whether a surface may go on as far as a cell. x, y: its middle."""
    covered, side = False, len(cells.which)
    for k in range(len(surfaces)):
        nx, ny = surfaces[k, NX], surfaces[k, NY]
        wx, wy = x - surfaces[k, SX], y - surfaces[k, SY]
        goes_on = wx * nx + wy * ny > -0.5 * CELL * (abs(nx) + abs(ny))
        steps = math.ceil(2.0 * math.hypot(wx, wy) / CELL)
        for n in range(steps):
            if goes_on:
                i, j = cell(x - wx * n / steps), cell(y - wy * n / steps)
                seen = holds(cells.which, i, j) and not cells.assumed[i % side, j % side]
                goes_on = not seen or _in_view(sweeps, (i + 0.5) * CELL, (j + 0.5) * CELL)
        covered = covered or goes_on
    return covered


@jit
def with_scan(
    cells: ObservedCells, sweep: DeskewedScan, kept: float, seen: float, floor: bool = False
) -> ObservedCells:
    """With the ground in view of a sweep, up to its returns; or with the floor that it sees, within
    the sensor's floor range and before its returns.

    kept: cells farther than this from the LiDAR are forgotten [m]. seen: and those farther than
    this not seen [m]."""
    which, occupied, assumed = cells.which.copy(), cells.occupied.copy(), cells.assumed.copy()
    sensor, lidar, n, side = sweep.sensor, sweep.lidar, len(sweep.ranges), len(cells.which)
    _forget(which, sensor, kept)
    c, s = math.cos(sensor.psi), math.sin(sensor.psi)
    low_x, low_y = cell(sensor.x - seen), cell(sensor.y - seen)
    wide = math.ceil(2.0 * seen / CELL)
    for i in range(low_x, low_x + wide):
        wx = (i + 0.5) * CELL - sensor.x
        for j in range(low_y, low_y + wide):
            wy = (j + 0.5) * CELL - sensor.y
            far = math.hypot(wx, wy)
            a, b = i % side, j % side
            if far > seen or (holds(which, i, j) and not (occupied[a, b] or assumed[a, b])):
                continue
            if floor and not lidar.floor_from <= far <= lidar.floor_to:
                continue
            beam = beam_at(lidar, c * wx + s * wy, -s * wx + c * wy)
            if not 0 <= beam < n:
                continue
            reach = sweep.ranges[beam]
            # NaN of an obstacle; the floor beside it was seen
            if floor and math.isnan(reach) and 0 < beam < n - 1:
                reach = min(sweep.ranges[beam - 1], sweep.ranges[beam + 1])
            if reach > (far if floor else far - CELL):
                _set_observed(which, occupied, i, j)
                assumed[a, b] = False
    return ObservedCells(which, occupied, assumed)


@jit_inline
def _forget(which: Ints, sensor: Pose, kept: float) -> None:
    for a in range(len(which)):
        for b in range(len(which)):
            wx = (which[a, b, 0] + 0.5) * CELL - sensor.x
            wy = (which[a, b, 1] + 0.5) * CELL - sensor.y
            if wx * wx + wy * wy > kept * kept:
                which[a, b, 0] = NEVER


@jit_inline
def _in_view(sweeps: tuple[DeskewedScan, ...], x: float, y: float) -> bool:
    """Whether any LiDAR has a beam towards an `odom` point, occluded or not."""
    seen = False
    for k in range(len(sweeps)):
        seen = seen or in_view(sweeps[k].lidar, sweeps[k].sensor, x, y)
    return seen


@jit
def approaching(out_of_view: Floats, pose: Pose, far: float) -> Floats:
    """Movers out of view, see `track.departed`, that are within `far` [m] of a pose, or were
    heading there when they left the view."""
    near = np.zeros(len(out_of_view), np.bool_)
    for k in range(len(out_of_view)):
        vx, vy, ago = out_of_view[k, HVX], out_of_view[k, HVY], out_of_view[k, UNSEEN]
        wx, wy = out_of_view[k, HX] - ago * vx - pose.x, out_of_view[k, HY] - ago * vy - pose.y
        t = min(max(-(wx * vx + wy * vy) / max(vx * vx + vy * vy, 1e-6), 0.0), _ARRIVAL_TIME)
        near[k] = math.hypot(wx + t * vx, wy + t * vy) < far
    return out_of_view[near]


@jit
def occupied(
    cells: ObservedCells, sweeps: tuple[DeskewedScan, ...], out_of_view: Floats, pose: Pose,
    outline: Floats, steps: tuple[int, int], kept: float,
) -> ObservedCells:  # fmt: skip
    """With the cells that movers out of view may occupy some steps of a cell later: where they left
    the view, and what they can reach from there, or from beyond the known cells, over unobserved
    cells within the bounds of their predicted tracks.

    steps: how many were made, and how many are then, since movers are out of view. Every second one
    is diagonal too, so that the steps cover a circle, in an octagon about it. kept: within this of
    the body's origin [m].
    """
    before, side = cells.occupied, len(cells.which)
    after = np.zeros_like(before)
    if not len(out_of_view):
        return ObservedCells(cells.which, after, cells.assumed)
    any_away = False
    for k in range(len(out_of_view)):
        any_away = any_away or out_of_view[k, UNSEEN] >= _JUST_LEFT
    low_x, low_y = cell(pose.x - kept), cell(pose.y - kept)
    wide = math.ceil(2.0 * kept / CELL) + 1
    reachable, filled = np.zeros((wide, wide), np.bool_), np.zeros((wide, wide), np.bool_)
    for a in range(wide):
        for b in range(wide):
            i, j = low_x + a, low_y + b
            x, y = (i + 0.5) * CELL, (j + 0.5) * CELL
            if _in_view(sweeps, x, y) or disc_clearance(pose, outline, x, y, 0.0) < _APART:
                continue
            for k in range(len(out_of_view)):
                away = math.hypot(x - out_of_view[k, HX], y - out_of_view[k, HY])
                if away < out_of_view[k, REACH]:
                    reachable[a, b] = True
                    filled[a, b] |= out_of_view[k, UNSEEN] < _JUST_LEFT
            filled[a, b] |= before[i % side, j % side] or (
                any_away and not holds(cells.which, i, j)
            )
            filled[a, b] &= reachable[a, b]
    for step in range(steps[0], steps[1]):
        previous, diagonal = filled.copy(), step % 2 == 0
        for a in range(1, wide - 1):
            for b in range(1, wide - 1):
                if reachable[a, b] and not previous[a, b]:
                    filled[a, b] = (
                        previous[a - 1, b] or previous[a + 1, b]
                        or previous[a, b - 1] or previous[a, b + 1]
                        or (diagonal and (
                            previous[a - 1, b - 1] or previous[a - 1, b + 1]
                            or previous[a + 1, b - 1] or previous[a + 1, b + 1]
                        ))
                    )  # fmt: skip
    for a in range(wide):
        for b in range(wide):
            after[(low_x + a) % side, (low_y + b) % side] = filled[a, b]
    return ObservedCells(cells.which, after, cells.assumed)


@jit
def possibly_occupied(cells: ObservedCells, pose: Pose, kept: float) -> Floats:
    """Centres of the cells that movers out of view may occupy near a pose, (p, 2), in `odom`."""
    side = len(cells.which)
    low_x, low_y = cell(pose.x - kept), cell(pose.y - kept)
    wide = math.ceil(2.0 * kept / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        for j in range(low_y, low_y + wide):
            if cells.occupied[i % side, j % side]:
                out[k, 0], out[k, 1] = (i + 0.5) * CELL, (j + 0.5) * CELL
                k += 1
    return out[:k].copy()


@jit
def unobserved_border(
    cells: ObservedCells, sweeps: tuple[DeskewedScan, ...], pose: Pose, outline: Floats, far: float,
    floor: bool = False,
) -> Floats:  # fmt: skip
    """The border of unobserved ground, or floor, (p, 2), in `odom`, within `far` [m] of a robot
    with this outline at this pose: cells beside an observed one, or beside the robot itself."""
    low_x, low_y = cell(pose.x - far), cell(pose.y - far)
    wide = math.ceil(2.0 * far / CELL) + 1
    out = np.empty((wide * wide, 2))
    k = 0
    for i in range(low_x, low_x + wide):
        px = (i + 0.5) * CELL
        for j in range(low_y, low_y + wide):
            py = (j + 0.5) * CELL
            if math.hypot(px - pose.x, py - pose.y) > far or _is_free(cells, i, j):
                continue
            if not floor and _in_view(sweeps, px, py):
                continue  # occluded by a return
            clearance = disc_clearance(pose, outline, px, py, 0.0)
            if clearance <= 0.0:
                continue
            if (
                clearance < _APART + 1.5 * CELL
                or _is_free(cells, i - 1, j) or _is_free(cells, i + 1, j)
                or _is_free(cells, i, j - 1) or _is_free(cells, i, j + 1)
            ):  # fmt: skip
                out[k, 0], out[k, 1] = px, py
                k += 1
    return out[:k].copy()


@jit
def assumed_gap(cells: ObservedCells, pose: Pose, outline: Floats) -> float:
    """Distance of a robot with this outline at this pose from ground that is only assumed free [m];
    infinite without any."""
    which, gap = cells.which, math.inf
    for a in range(len(which)):
        for b in range(len(which)):
            if cells.assumed[a, b] and which[a, b, 0] != NEVER:
                x, y = (which[a, b, 0] + 0.5) * CELL, (which[a, b, 1] + 0.5) * CELL
                gap = min(gap, disc_clearance(pose, outline, x, y, CELL))  # all of it, and some
    return max(gap, 0.0)


@jit_inline
def _set_observed(which: Ints, occupied: NDArray[np.bool_], i: int, j: int) -> None:
    a, b = i % len(which), j % len(which)
    which[a, b, 0], which[a, b, 1] = i, j
    occupied[a, b] = False


@jit_inline
def _is_free(cells: ObservedCells, i: int, j: int) -> bool:
    side = len(cells.which)
    return holds(cells.which, i, j) and not cells.occupied[i % side, j % side]
