"""Buildings nobody has drawn, and the maps that a mapping robot might have left of them.

A building is a free area with holes: corridors around blocks, rooms behind doors, recesses,
pillars, furniture. The truth is its outline, exactly. Its map has what published maps have: walls
as thick as hits scatter, stair-steps of a grid that is turned, gentle warping, parts nobody saw,
and walls and blobs that are not there. Same seed, same building.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from shapely import Polygon, box, contains_xy, unary_union
from shapely.affinity import rotate

from cohelm.core.frames import between, compose
from cohelm.core.scalars import wrap
from cohelm.core.types import Pose
from cohelm.perceive.localize.localization_map import LocalizationMap, map_from_occupancy
from cohelm.perceive.scan.deskew import DeskewedScan, deskew
from cohelm.robot.sensors import Lidar, LidarModel
from cohelm.sim.grid import NO_GRID, Grid
from cohelm.sim.lidar import scan as cast

NO_DISCS = np.empty((0, 6))


class Place(NamedTuple):
    """walls (s, 4) and grid: the world as it is. known: the map that the robot is given. clear:
    (rows, columns), distance of each cell of 0.1 m to what stands [m]; low: its corner."""

    name: str
    walls: np.ndarray
    grid: Grid
    known: LocalizationMap
    clear: np.ndarray
    low: np.ndarray


class Artefacts(NamedTuple):
    """What is wrong with a map."""

    resolution: float = 0.05
    scatter: float = 0.025
    """Of hits about their wall, one sigma [m]."""
    warp: float = 0.02
    """How far the map is bent, at most, over some ten metres [m]."""
    turned: float = 0.35
    """The grid is turned by up to this, so that walls are stair-steps [rad]."""
    missing: float = 0.05
    """Share of the walls, in pieces of 0.3 to 2 m, that nobody drew;"""
    gone: float = 0.0
    """and that are drawn but stand no more: doors that were closed, shelves that were moved."""
    ghosts: int = 6
    """Pieces of wall up to 1 m that do not stand, or that are drawn twice, 10 to 20 cm apart."""


CLEAN = Artefacts(0.025, 0.01, 0.0, 0.0, 0.0, 0.0, 0)


def outline(seed, larger=1.0, alike=False):
    """The free area of a building, a polygon with holes; so many times as long and wide. alike:
    every room looks like the next, and nothing stands in the corridors."""
    rng = np.random.default_rng(seed)
    width = rng.uniform(1.7, 2.8)
    w, h = larger * rng.uniform(16, 32), larger * rng.uniform(9, 18)
    parts = [box(0, 0, w, h).difference(box(width, width, w - width, h - width))]
    if rng.random() < 0.6:  # a corridor across
        x = rng.uniform(0.3, 0.7) * w
        parts.append(box(x, 0, x + rng.uniform(1.6, 2.6), h))
    for side in range(4):  # rooms outside the ring
        along = w if side in (0, 1) else h
        at = rng.uniform(0.2, 1.5)
        while alike and at < along - 5.0:
            room = unary_union((box(at, -4.2, at + 4.0, -0.2), box(at + 1, -0.25, at + 2, 0.05)))
            parts.append(_onto(room, side, w, h))
            at += 4.2
        while not alike and at < along - 2.5:
            wide = min(rng.uniform(2.5, 6.0), along - at)
            deep, gap = rng.uniform(2.5, 5.5), rng.uniform(0.1, 0.25)
            door = at + rng.uniform(0.3, wide - 1.3)
            room = box(at, -gap - deep, at + wide, -gap)
            way = box(door, -gap - 0.05, door + rng.uniform(0.85, 1.1), 0.05)
            if rng.random() < 0.35:  # closed: a recess only
                room, way = box(0, 0, 0, 0), box(door, -rng.uniform(0.05, gap), door + 0.95, 0.05)
            for _ in range(int(rng.integers(0, 4))):  # furniture, not before the door
                x, y = rng.uniform(at, at + wide), -gap - rng.uniform(1.2, deep)
                thing = box(x, y, x + rng.uniform(0.2, 1.2), y + rng.uniform(0.2, 0.8))
                room = room.difference(rotate(thing, rng.choice([0, 0, rng.uniform(0, 90)])))
            for part in (*getattr(room, "geoms", (room,)), way):  # cut in two by furniture
                if part.area > 0.0:
                    parts.append(_onto(part, side, w, h))
            at += wide + rng.uniform(0.1, 0.3)
            at += rng.exponential(1.0)
    free = unary_union(parts)
    for _ in range(0 if alike else int(rng.integers(2, 7))):  # pillars, bins by the walls
        s, x, y = rng.uniform(0.1, 0.35), rng.uniform(0, w), rng.choice([0.0, h, width, h - width])
        free = free.difference(box(x, y - s, x + rng.uniform(0.1, 0.5), y + s))
    free = rotate(free, math.degrees(rng.uniform(-math.pi, math.pi)), origin=(0, 0))
    if free.geom_type == "MultiPolygon":
        free = max(free.geoms, key=lambda part: part.area)
    return free.simplify(1e-6)


def _onto(part, side, w, h):
    """A part drawn below the ring, moved to one of its four sides."""
    if side == 0:
        return part
    if side == 1:
        return _mirrored(part, h)
    return _flipped(_mirrored(part, w) if side == 3 else part)


def _mirrored(part, height):
    rings = [[(x, height - y) for x, y in r.coords] for r in (part.exterior, *part.interiors)]
    return Polygon(rings[0], rings[1:])


def _flipped(part):
    parts = [[(y, x) for x, y in ring.coords] for ring in (part.exterior, *part.interiors)]
    return Polygon(parts[0], parts[1:])


def segments(free):
    """The walls around a free area, (s, 4)."""
    rows = []
    for ring in (free.exterior, *free.interiors):
        c = np.asarray(ring.coords)
        rows.append(np.hstack((c[:-1], c[1:])))
    return np.vstack(rows)


def pieces(walls, share, rng):
    """Walls cut where a share of them, in pieces of 0.3 to 2 m, is taken out: left, taken."""
    left, taken = [], []
    for ax, ay, bx, by in walls.tolist():
        a, d = np.array([ax, ay]), np.array([bx - ax, by - ay])
        length = float(np.hypot(*d))
        at = 0.0
        while at < length:
            gone = rng.random() < share
            end = min(at + rng.uniform(0.3, 2.0), length)
            (taken if gone else left).append([*(a + d * at / length), *(a + d * end / length)])
            at = end
    return np.array(left).reshape(-1, 4), np.array(taken).reshape(-1, 4)


def building(seed, artefacts=None, larger=1.0, alike=False):
    """A building and its map, in the building's own axes."""
    how = artefacts or Artefacts()
    free, rng = outline(seed, larger, alike), np.random.default_rng([seed, 1])
    walls = segments(free)
    stands, gone = pieces(walls, how.gone, rng) if how.gone else (walls, walls[:0])
    drawn, _ = pieces(stands, how.missing, rng) if how.missing else (stands, walls[:0])
    made = drawing(free, np.vstack((drawn, gone)), how, rng)
    low, clear = _clearance(free)
    name = f"building {seed}" + (", alike" if alike else "")
    return Place(name, stands, NO_GRID, made, clear, low)


def drawing(free, walls, how, rng):
    """The map of a free area with these walls."""
    angle = rng.uniform(-how.turned, how.turned)
    c, s = math.cos(angle), math.sin(angle)
    points = []
    for ax, ay, bx, by in walls.tolist():
        n = max(int(math.hypot(bx - ax, by - ay) / 0.004), 1)
        t = np.linspace(0.0, 1.0, n)[:, None]
        points.append(np.array([ax, ay]) + t * np.array([bx - ax, by - ay]))
    for _ in range(how.ghosts):
        ax, ay, bx, by = walls[rng.integers(len(walls))]
        turn = math.atan2(by - ay, bx - ax)
        size = min(math.hypot(bx - ax, by - ay), rng.uniform(0.2, 1.0))
        off = rng.choice([-1, 1]) * rng.uniform(0.1, 0.2)
        begin = np.array([ax - off * math.sin(turn), ay + off * math.cos(turn)])
        t = np.linspace(0.0, size, 200)[:, None]
        points.append(begin + t * np.array([math.cos(turn), math.sin(turn)]))
    all_ = np.vstack(points)
    waves = rng.uniform(0.3, 0.8, (2, 2)), rng.uniform(0, 2 * math.pi, 2)
    if how.warp:
        all_ = all_ + how.warp * np.sin(all_ @ waves[0].T + waves[1])
    all_ = all_ + rng.normal(0.0, how.scatter, all_.shape)
    # the grid's axes are turned by angle in the world: cells of R^T p
    local = all_ @ np.array([[c, -s], [s, c]])
    low = np.floor((local.min(axis=0) - 0.5) / how.resolution) * how.resolution
    size = np.ceil((local.max(axis=0) + 0.5 - low) / how.resolution).astype(int)
    hits = np.zeros((size[1], size[0]))
    cells = np.floor((local - low) / how.resolution).astype(int)
    np.add.at(hits, (cells[:, 1], cells[:, 0]), 1.0)
    per_cell = how.resolution / 0.004
    occupied = hits > 0.2 * per_cell
    y, x = np.mgrid[0 : size[1], 0 : size[0]]
    lx = low[0] + (x.ravel() + 0.5) * how.resolution
    ly = low[1] + (y.ravel() + 0.5) * how.resolution
    inside = contains_xy(free, c * lx - s * ly, s * lx + c * ly).reshape(occupied.shape)
    origin = Pose(float(c * low[0] - s * low[1]), float(s * low[0] + c * low[1]), angle)
    return map_from_occupancy(occupied, inside & ~occupied, how.resolution, origin)


def _clearance(free, side=0.1):
    x1, y1, x2, y2 = free.bounds
    low = np.array([x1 - side, y1 - side])
    rows, columns = math.ceil((y2 - y1) / side) + 2, math.ceil((x2 - x1) / side) + 2
    y, x = np.mgrid[0:rows, 0:columns]
    inside = contains_xy(
        free, low[0] + (x.ravel() + 0.5) * side, low[1] + (y.ravel() + 0.5) * side
    ).reshape(rows, columns)
    return low, ndimage.distance_transform_edt(inside) * side


def tour(place, seed, length, room=0.38, side=0.1):
    """Waypoints of a drive of about that length through what can be reached with that room [m]."""
    rng = np.random.default_rng([seed, 2])
    every = 2
    clear = place.clear[::every, ::every]
    labels, _ = ndimage.label(clear > room)
    counts = np.bincount(labels.ravel())
    counts[0] = 0
    cells = np.argwhere(labels == counts.argmax())
    number = -np.ones(clear.shape, dtype=int)
    number[tuple(cells.T)] = np.arange(len(cells))
    starts, ends, costs = [], [], []
    for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = cells + np.array([di, dj])
        ok = ((other >= 0) & (other < clear.shape)).all(axis=1)
        to = np.where(ok, number[tuple(np.where(ok[:, None], other, 0).T)], -1)
        a = np.flatnonzero(to >= 0)
        near = np.minimum(clear[tuple(cells[a].T)], 1.2)
        starts.append(a)
        ends.append(to[a])
        costs.append(math.hypot(di, dj) * (1.0 + 0.6 / near**2))
    graph = csr_array(
        (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))),
        shape=(len(cells), len(cells)),
    )
    here, way, far = int(rng.integers(len(cells))), [], 0.0
    while far < length:
        _, before = dijkstra(graph, False, here, return_predecessors=True)
        goal = int(rng.integers(len(cells)))
        steps, k = [], goal
        while k != here and k >= 0:
            steps.append(k)
            k = int(before[k])
        if k < 0 or len(steps) < 10:
            continue
        leg = cells[[*steps[::-1]]].astype(float)
        way.append(leg)
        far += every * side * float(np.hypot(*np.diff(leg, axis=0).T).sum())
        here = goal
    path = (np.vstack(way)[:, ::-1] * every + 0.5) * side + place.low
    smooth = ndimage.uniform_filter1d(path, 7, axis=0, mode="nearest")
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(smooth, axis=0).T))))
    keep = np.concatenate(([True], np.diff(along) > 1e-6))
    even = np.arange(0.0, min(along[-1], length), 0.7)
    return [
        (float(np.interp(d, along[keep], smooth[keep, 0])),
         float(np.interp(d, along[keep], smooth[keep, 1]))) for d in even
    ]  # fmt: skip


def boxes(place, poses, count, seed, room=0.45):
    """So many boxes on no map, within 1.5 m of a drive and with that room to it: their walls."""
    rng = np.random.default_rng([seed, 3])
    way = np.array([p[:2] for p in poses[::10]])
    found = []
    for _ in range(4000):
        if len(found) == 4 * count:
            break
        at = way[rng.integers(len(way))] + rng.uniform(-1.5, 1.5, 2)
        a, b, turn = rng.uniform(0.15, 0.4), rng.uniform(0.15, 0.4), rng.uniform(0, math.pi)
        if np.hypot(*(way - at).T).min() < room + math.hypot(a, b):
            continue
        c, s = math.cos(turn), math.sin(turn)
        corners = np.array([[a, b], [-a, b], [-a, -b], [a, -b]]) @ np.array([[c, s], [-s, c]]) + at
        found += np.hstack((corners, np.roll(corners, -1, axis=0))).tolist()
    return np.array(found).reshape(-1, 4)


LIDARS = (
    LidarModel(beams=720, field_of_view_deg=270.0, range_max_m=12.0, noise_m=0.02, mount_x_m=0.3),
    LidarModel(beams=180, field_of_view_deg=179.0, range_max_m=50.0, noise_m=0.02),
    LidarModel(beams=360, field_of_view_deg=359.0, range_max_m=25.0, noise_m=0.03),
)


class Surveying(NamedTuple):
    """A drive to be mapped: its LiDAR, what it saw with the odometry of it, and where it was."""

    lidar: Lidar
    seen: list[DeskewedScan]
    truth: list[Pose]


def surveying(seed, alike=False):
    """150 to 2000 m through a building one to four times as large, alike twice that, with one of
    LIDARS; the wheels 0.5 to 3 % wrong, lines bent by 0.02 to 0.25 deg/m either way, turns 2 %."""
    rng = np.random.default_rng([seed, 7])
    larger = float(rng.uniform(1.0, 4.0)) * (2.0 if alike else 1.0)
    length = float(np.exp(rng.uniform(np.log(150), np.log(2000))))
    lidar, free = LIDARS[seed % 3].lidar(), outline(seed, larger, alike)
    walls, (low, clear) = segments(free), _clearance(free)
    way = np.array(tour(Place("", walls, NO_GRID, None, clear, low), seed, length))
    far = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    fine = np.arange(0.0, far[-1], 0.05)
    xy = np.column_stack([np.interp(fine, far, way[:, i]) for i in (0, 1)])
    xy = ndimage.uniform_filter1d(xy, 9, axis=0, mode="nearest")
    psi = np.unwrap(np.arctan2(*np.gradient(xy, axis=0).T[::-1]))
    every = float(rng.choice([0.1, 0.25, 0.5]))
    truth, since, turned = [], 1e9, 1e9
    for k in range(len(xy)):
        if k:
            since, turned = since + math.dist(xy[k], xy[k - 1]), turned + abs(psi[k] - psi[k - 1])
        if since >= every or turned >= 0.25:
            truth.append(Pose(float(xy[k, 0]), float(xy[k, 1]), wrap(float(psi[k]))))
            since = turned = 0.0
    scale = 1.0 + rng.choice([-1, 1]) * rng.uniform(0.005, 0.03)
    bend = math.radians(rng.choice([-1, 1]) * rng.uniform(0.02, 0.25))
    turns = 1.0 + rng.choice([-1, 1]) * rng.uniform(0.0, 0.02)
    odometry, seen, ranges = Pose(0.0, 0.0, 0.0), [], np.empty(len(lidar.beams))
    for k, pose in enumerate(truth):
        if k:
            step = between(truth[k - 1], pose)
            d = math.hypot(step.x, step.y)
            step = Pose(
                step.x * scale + 0.01 * d * rng.normal(), step.y * scale + 0.01 * d * rng.normal(),
                step.psi * turns + bend * d + math.radians(0.3) * math.sqrt(d) * rng.normal()
                + 0.02 * step.psi * rng.normal(),
            )  # fmt: skip
            odometry = compose(odometry, step)
        cast(pose, lidar, NO_DISCS, walls, NO_GRID, seed, k, ranges)
        swept = deskew(lidar, ranges, 0.1 * k, 0.0, np.array([[0.1 * k, *odometry, 0.0, 0.0]]))
        seen.append(swept)
    return Surveying(lidar, seen, truth)


def loop_errors(found, truth, most=4000):
    """How far found places are off, as seen from others within 1.5 m but 20 m of way apart [m]."""
    at = np.array(truth)[:, :2]
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))))
    pairs = cKDTree(at).query_pairs(1.5, output_type="ndarray")
    pairs = pairs[np.abs(way[pairs[:, 0]] - way[pairs[:, 1]]) > 20.0]
    rng = np.random.default_rng(0)
    pairs = pairs[rng.choice(len(pairs), most, replace=False)] if len(pairs) > most else pairs
    return np.array([
        math.hypot(*between(between(truth[a], truth[b]), between(found[a], found[b]))[:2])
        for a, b in pairs
    ])  # fmt: skip
