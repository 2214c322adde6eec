"""Worlds by others in a scenario: the `world` key, and what is read from the files it names."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from cohelm.core.errors import CohelmError
from cohelm.core.schema import Schema
from cohelm.core.types import Floats
from cohelm.scenario.worlds.barn import Barn, read_barn, read_collection
from cohelm.scenario.worlds.gazebo import read_gazebo
from cohelm.scenario.worlds.maps import read_map
from cohelm.scenario.worlds.tracks import bodies as walkers, read_tracks
from cohelm.sim.grid import NO_GRID, Grid, borders
from cohelm.sim.world import Body

File = Annotated[str, Field(min_length=1)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None


class GazeboWorld(Schema):
    """A Gazebo world, and the BARN challenge's path through it if there is one."""

    kind: Literal["gazebo"]
    """A Gazebo .world or .sdf file, plain or gzip: cylinders, spheres, boxes, movers."""
    file: File
    """The file, relative to this one."""
    path_file: File | None = None
    """The path_N.npy of a BARN world: with it come start, waypoints, goal and time limit."""
    sha256: Sha256 = None
    """Digest of the file; when given, a file that has changed since is refused."""


class BarnWorld(Schema):
    """One world of a JSON collection of BARN worlds."""

    kind: Literal["barn"]
    """One world of a JSON collection of BARN worlds, with start, waypoints, goal, time limit."""
    file: File
    """The file, relative to this one."""
    number: Annotated[int, Field(ge=0)]
    """Which of its worlds."""
    sha256: Sha256 = None
    """Digest of the file; when given, a file that has changed since is refused."""


class MapWorld(Schema):
    """An occupancy map of ROS map_server."""

    kind: Literal["map"]
    """The YAML file of a ROS map_server map, beside its PGM or PNG."""
    file: File
    """The file, relative to this one."""
    unknown: Literal["free", "solid"] = "free"
    """How unknown cells count."""
    sha256: Sha256 = None
    """Digest of the YAML file; when given, a file that has changed since is refused."""


class TracksWorld(Schema):
    """Recorded pedestrians, who avoid nobody."""

    kind: Literal["tracks"]
    """A CSV file of pedestrians with columns t [s], id, x and y [m]."""
    file: File
    """The file, relative to this one."""
    begin_s: Annotated[float, Field(ge=-1e12, le=1e12)] | None = None
    """Time of the file at which the run begins; by default that of its first row."""
    radius_m: Annotated[float, Field(gt=0.0, le=10.0)] = 0.3
    """Radius of a pedestrian."""
    sha256: Sha256 = None
    """Digest of the file; when given, a file that has changed since is refused."""


AnyWorld = GazeboWorld | BarnWorld | MapWorld | TracksWorld
WorldFile = Annotated[AnyWorld, Field(discriminator="kind")]
"""One of the four, selected by `kind`."""


class Read(NamedTuple):
    """What stands and walks in a world, and its route if it has one."""

    names: tuple[str, ...] = ()
    bodies: tuple[Body, ...] = ()
    walls: Floats = np.empty((0, 4))
    """All there is to hit but discs, (s, 4)."""
    grid: Grid = NO_GRID
    """Where the walls are the borders of a map's cells: the map itself, for a LiDAR."""
    left_out: tuple[str, ...] = ()
    """What of the file could not be read, a sentence each."""


def has_route(world: AnyWorld | None) -> bool:
    """Whether a world comes with a route."""
    return isinstance(world, BarnWorld) or (
        isinstance(world, GazeboWorld) and world.path_file is not None
    )


def read(world: AnyWorld, reach: float, duration: float) -> Read:
    """A world from its file.

    reach: kept from the robot's centre to a surface, for the paper's r_i (19) [m]. duration: of the
    run, for pedestrians [s]. Raises CohelmError where the file can not be used.
    """
    if isinstance(world, MapWorld):
        made = read_map(world.file).grid(world.unknown == "solid")
        return Read(walls=borders(made), grid=made)
    if isinstance(world, TracksWorld):
        tracks = read_tracks(world.file)
        begin = world.begin_s
        if begin is None:
            begin = min((float(track.times[0]) for track in tracks), default=0.0)
        names, people = walkers(tracks, world.radius_m, reach, begin, duration)
        if not names:
            raise CohelmError(
                f"{world.file}: no pedestrian is there at {begin:g} s; set world.begin_s"
            )
        return Read(tuple(f"person {name}" for name in names), tuple(people))
    barn = barn_of(world, reach)
    if barn is not None:
        names = tuple(f"cylinder {i}" for i in range(len(barn.discs)))
        return Read(names, _resting_bodies(barn.discs), barn.walls, NO_GRID, barn.left_out)
    seen = read_gazebo(world.file, reach)
    bodies = tuple(
        body if moved is None else replace(body, path=moved.way(duration))
        for body, moved in zip(_resting_bodies(seen.discs), seen.animations, strict=True)
    )
    return Read(_apart(seen.names), bodies, seen.walls, NO_GRID, seen.left_out)


def barn_of(world: AnyWorld, reach: float = 0.0) -> Barn | None:
    """A world of the BARN challenge, which comes with a route; None if it is none. CohelmError as
    in `read`."""
    if isinstance(world, BarnWorld):
        file = Path(world.file)
        known = _collection(world.file, reach, file.stat().st_mtime_ns if file.exists() else 0)
        if world.number not in known:
            there = ", ".join(str(number) for number in sorted(known)[:60])
            raise CohelmError(f"{world.file}: has no world {world.number}; there are {there}")
        return known[world.number]
    if isinstance(world, GazeboWorld) and world.path_file is not None:
        return read_barn(world.file, world.path_file, reach)
    return None


@lru_cache(maxsize=4)
def _collection(file: str, reach: float, changed: int) -> dict[int, Barn]:
    """A collection, read once. changed: when the file was [ns]."""
    return read_collection(file, reach)


def _resting_bodies(discs: Floats) -> tuple[Body, ...]:
    return tuple(Body((d[0], d[1], 0.0, 0.0, d[4], d[5])) for d in discs.tolist())


def _apart(names: tuple[str, ...]) -> tuple[str, ...]:
    """The same names, numbered where two are equal."""
    seen: dict[str, int] = {}
    made: list[str] = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        made.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return tuple(made)
