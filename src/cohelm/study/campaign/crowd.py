"""`crowd`: recorded pedestrians, who avoid nobody, walk where the robot has to cross.

`about` describes the suite. The smoothing splines (penalty 0.05 on the squared acceleration) are
for the sway of steps and the annotators' error.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly, make_smoothing_spline

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.law.reference import Reference, evaluate, through
from cohelm.scenario.load import robot
from cohelm.scenario.worlds.tracks import ELSEWHERE, Track, read_tracks
from cohelm.sim.world import Body, world
from cohelm.study.campaign.data import csv_files
from cohelm.study.campaign.episode import Episode, EpisodeGoal, crossing, sequence
from cohelm.study.campaign.rooms import extremes

FOLDER = "crowd"
"""Of recorded pedestrians, in a folder of data."""
FASTEST = 2.5
"""Assumed of pedestrians [m/s]."""
MAX_ACCELERATION = 1.0
"""Assumed of pedestrians [m/s^2]."""
RADIUS = 0.25
"""Of a pedestrian [m]."""
REACH = 6.5
"""No pedestrian appears nearer to the middle of the scene [m]."""
STARTS = 20
"""Different moments in each scene; more episodes are other directions at the same ones."""

_SPEED, _LIMIT, _NEAR, _HALF = 0.8, 60.0, 0.3, 4.0
_SMOOTH = 0.05
_ON = 10.0  # s of walking straight on at both ends
_FEW = 5  # samples, below which a spline can not be smoothed


class Walk(NamedTuple):
    """One person as they walk in the simulator."""

    name: str
    first: float
    """When they come into being [s]; the path's time 0."""
    path: Reference


class Crowd(NamedTuple):
    """One recorded scene."""

    name: str
    walks: tuple[Walk, ...]
    middle: tuple[float, float]
    moments: tuple[float, ...]
    """At which episodes begin [s]."""
    left_out: tuple[str, ...]
    """Pedestrians left out, and why."""


def read(folder: Path) -> tuple[Crowd, ...]:
    """The scenes in a folder, or in `crowd` in it: CSV files with t, id, x, y.

    Raises CohelmError where there are none.
    """
    inside, there = csv_files(folder, FOLDER)
    if not there:
        raise CohelmError(
            f"{inside}: holds no CSV file of tracks (t,id,x,y); give their folder with --data"
        )
    return tuple(crowd(file.name.split(".")[0], read_tracks(file)) for file in there)


def crowd(name: str, tracks: list[Track]) -> Crowd:
    """A scene from its tracks."""
    times = np.concatenate([track.times for track in tracks])
    points = np.concatenate([track.points for track in tracks])
    at = np.quantile(times, (np.arange(STARTS) + 0.5) / STARTS)
    x, y = np.median(points, axis=0).tolist()
    walks: list[Walk] = []
    left_out: list[str] = []
    for track in tracks:
        if len(track.times) < 2:
            left_out.append(f"{name}, person {track.name}: seen only once")
            continue
        path = walked(track)
        begin = float(track.times[0]) - _ON
        first = evaluate(path.knots, path.coeffs, 1.0)
        during = ((at < begin) & (begin < at + _LIMIT)).any()
        speed, push = extremes(_middle(path))
        if speed > FASTEST or push > MAX_ACCELERATION:
            why = f"{speed:.1f} m/s" if speed > FASTEST else f"{push:.1f} m/s²"
            left_out.append(f"{name}, person {track.name}: up to {why}")
        elif during and (near := math.dist((first.x, first.y), (x, y))) < REACH:
            left_out.append(
                f"{name}, person {track.name}: would come into being {near:.1f} m from the middle"
            )
        else:
            walks.append(Walk(track.name, begin - 1.0, path))
    if not walks:
        raise CohelmError(
            f"{name}: no pedestrian in it is within the assumed bounds; nothing to do"
        )
    return Crowd(name, tuple(walks), (x, y), tuple(at.tolist()), tuple(left_out))


def walked(track: Track) -> Reference:
    """The motion of a pedestrian: smoothed, straight on at both ends, ELSEWHERE before and
    after."""
    t, points = track.times, track.points
    if len(t) < _FEW:
        design = np.column_stack((t - t[0], np.ones(len(t))))
        slope = np.linalg.lstsq(design, points)[0]  # (2, 2): per second, and at the first sample
        knots = t[[0, -1]]
        coeffs = np.zeros((1, 8))
        coeffs[0, [2, 3, 6, 7]] = slope[0, 0], slope[1, 0], slope[0, 1], slope[1, 1]
    else:
        splines = [make_smoothing_spline(t, points[:, c], lam=_SMOOTH) for c in (0, 1)]
        parts = [PPoly.from_spline(spline.tck) for spline in splines]
        inner = (parts[0].x >= t[0]) & (parts[0].x < t[-1])
        keep = np.flatnonzero(inner & (np.diff(parts[0].x, append=math.inf) > 0.0))
        knots = np.append(parts[0].x[keep], t[-1])
        coeffs = np.concatenate([part.c[:, keep].T for part in parts], axis=1)
    return _extended(knots, coeffs)


def _extended(knots: Floats, coeffs: Floats) -> Reference:
    """A path with _ON seconds straight on before and after it, and ELSEWHERE for 1 s around."""
    path = Reference(np.ascontiguousarray(knots), np.ascontiguousarray(coeffs), 1.0)
    a = evaluate(path.knots, path.coeffs, float(knots[0]))
    b = evaluate(path.knots, path.coeffs, float(knots[-1]))
    away = np.zeros((1, 8))
    away[0, [3, 7]] = ELSEWHERE
    before, after = np.zeros((1, 8)), np.zeros((1, 8))
    before[0, [2, 3, 6, 7]] = a.vx, a.x - a.vx * _ON, a.vy, a.y - a.vy * _ON
    after[0, [2, 3, 6, 7]] = b.vx, b.x, b.vy, b.y
    begin, end = float(knots[0]), float(knots[-1])
    times = np.concatenate(
        ([begin - _ON - 1.0, begin - _ON], knots, [end + _ON, end + _ON + 1.0])
    )  # fmt: skip
    pieces = np.concatenate((away, before, coeffs, after, away))
    return Reference(times - times[0], np.ascontiguousarray(pieces), 1.0)


def _middle(path: Reference) -> Reference:
    """A walk without the time ELSEWHERE."""
    return Reference(path.knots[1:-1], path.coeffs[1:-1], path.speed)


def case(crowds: tuple[Crowd, ...], seed: int, number: int) -> Episode:
    """Crossing `number` of the campaign with this seed."""
    scene = crowds[number % len(crowds)]
    moment = scene.moments[number // len(crowds) % STARTS]
    rng = sequence(seed, "crowd", number)
    sally = robot("sally")
    there = [w for w in scene.walks if w.first < moment + _LIMIT
             and w.first + w.path.duration > moment]  # fmt: skip
    start, goal = _crossing(rng, scene, there, moment)
    row = (ELSEWHERE, ELSEWHERE, 0.0, 0.0, RADIUS, RADIUS + sally.reach)
    bodies = [Body(row, w.path, w.first - moment) for w in there]
    setup = crossing(
        sally, start, goal, through(np.linspace(start, goal, 9), _SPEED),
        world((bodies, np.empty((0, 4)))), tuple(f"person_{w.name}" for w in there), _LIMIT, number,
    )  # fmt: skip
    return Episode("crowd", number, scene.name, setup, EpisodeGoal(*goal, _NEAR))


def _crossing(
    rng: np.random.Generator, scene: Crowd, there: list[Walk], moment: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Start and goal on opposite sides of the middle, no pedestrian near the start."""
    x, y = scene.middle
    places = [evaluate(w.path.knots, w.path.coeffs, moment - w.first) for w in there]
    clear = 1.5
    while True:
        turn = float(rng.uniform(-math.pi, math.pi))
        dx, dy = _HALF * math.cos(turn), _HALF * math.sin(turn)
        if all(math.dist((p.x, p.y), (x - dx, y - dy)) > clear for p in places):
            return (x - dx, y - dy), (x + dx, y + dy)
        clear *= 0.99  # a ring full of pedestrians would leave no place at all
