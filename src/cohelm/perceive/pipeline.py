"""Perception: odometry and LiDARs in; pose, obstacles, movers and unobserved ground out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.frames import compose, inverse
from cohelm.core.obstacles import Surroundings, placed_discs
from cohelm.core.types import Floats, Pose, Twist
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.localize.localizer import Localization, Localizer
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.scan.deskew import all_round
from cohelm.perceive.scan.odometry_buffer import (
    ANY_SPEED,
    EMPTY,
    GAP,
    extended,
    fastest,
    is_new,
    jump,
    pose_at,
)
from cohelm.perceive.source.contact_memory import ContactMemory
from cohelm.perceive.source.observation_source import NOTHING, ObservationSource
from cohelm.perceive.source.range_source import RangeSource
from cohelm.perceive.space.scan_memory import KEEP
from cohelm.perceive.space.unobserved import UnobservedFloor, UnobservedSpace
from cohelm.perceive.track.params import TrackerParams
from cohelm.perceive.track.tracker import discs_at, movers_out_of_view
from cohelm.robot.achievable import stopping_distance
from cohelm.robot.footprint import farthest_corner
from cohelm.robot.model import RobotModel
from cohelm.robot.port import AHEAD, Odometry, Readings, Scan, untouched
from cohelm.robot.sensors import Lidar, LidarModel

_APPEARS = 1.4  # what appears within this of the turning circle may move [m]
_MARGIN = 0.5  # what the filter keeps clear, and more [m]
_NO_WALLS: Floats = np.empty((0, 4))


class Seen(NamedTuple):
    """The result of perception at one instant, in the frame of the map. What it remembers it keeps
    in `odom`, which is smooth, drifts, and never jumps: when localization jumps, pose and obstacles
    jump together, and nothing comes nearer."""

    stamp: float
    """The instant, of the robot's clock [s]; all poses and discs are predicted to it."""
    pose: Pose
    """Of the body in the map. Without a map, and when lost from the start, that is `odom`."""
    covariance: Floats
    """(3, 3) of `pose`, in x, y, psi."""
    share: float
    """Share of the beams that agree with the map, in [0, 1]."""
    lost: bool
    """Whether `pose` must not be relied on."""
    reason: str
    """Why, in words; empty if not lost."""
    odometry: Pose
    """Of the body in `odom`."""
    twist: Twist
    """As measured, in the body frame."""
    map_odom: Pose
    """The pose of `odom` in the map: compose(map_odom, p) puts a pose of `odom` on the map."""
    odom_received: Pose
    """The pose of the received odometry's frame in `odom`: the origin, until that one jumps."""
    obstacles: Surroundings
    """Points: static ones, and behind them the border of unobserved space. Discs: of each LiDAR
    its `movers`, then small ones for potentially dynamic points. No segments."""
    unobserved: slice
    """Which of the points are that border; behind it are those of keep-out zones, if any."""
    assumed_gap: float
    """Distance from ground that is assumed free since the robot was switched on, and was never in
    view [m]; infinite without any."""
    movers: Floats
    """(n, 6) as in `core.types`."""
    scans: int = 0
    """How many scans have updated the movers so far."""


class Perception:
    """Perception of one robot: takes readings in order.

    `known`: the map to localize on; without, the pose in the map is that of the odometry and
    never lost. `start`: pose on the map; without, it is searched for.
    """

    def __init__(
        self, model: RobotModel | Lidar, known: LocalizationMap | None = None,
        start: Pose | None = None, tracker_params: TrackerParams | None = None,
        outline: Floats | None = None, further: Sequence[LidarModel] = (), stopping: float = 0.0,
    ) -> None:  # fmt: skip
        """Of a robot, or of LiDARs alone. Raises CohelmError for a robot without a LiDAR.

        outline: with a LiDAR alone, (k, 2) of the robot [m]; without, unobserved space is not
        reported. further: LiDARs beside that one. stopping: distance in which the robot stops from
        full speed, from a scan on [m].
        """
        if isinstance(model, Lidar):
            self.lidar = model
        elif model.lidar is None:
            raise CohelmError(f"{model.name} has no LiDAR, and nothing to perceive with: add one")
        else:
            self.lidar, outline, further = model.lidar.lidar(), model.outline, model.further_lidars
            stopping = stopping_distance(model.bounds(), model.delay_s + model.scan_age)
        keep = KEEP
        if outline is not None and math.isfinite(stopping):
            keep = max(keep, _reach(outline, self.lidar) + stopping)
        self._tracker_params = tracker_params or TrackerParams()
        if outline is not None:
            self._tracker_params = _around(self._tracker_params, outline)
        if isinstance(model, RobotModel):
            longest = max([self._tracker_params.longest, *(one.timeout for one in model.lidars)])
            self._tracker_params = self._tracker_params._replace(longest=longest)
        self._first = ObservationSource(self.lidar, "", keep, self._tracker_params)
        self._further = tuple(
            RangeSource(one) if one.range_sensor
            else ObservationSource(one.lidar(), one.name, keep, self._tracker_params)
            for one in further
        )  # fmt: skip
        self._sources = (self._first, *self._further)
        self._looking = [one for one in self._sources if isinstance(one, ObservationSource)]
        lidars = [source.lidar for source in self._looking]
        self._unobserved_space = None
        if outline is not None and not any(map(all_round, lidars)):
            self._unobserved_space = UnobservedSpace(outline, lidars, stopping)
        floors = [lidar for lidar in lidars if lidar.floor_from > 0.0]
        self._floor_space = None
        if outline is not None and floors:
            self._floor_space = UnobservedFloor(outline, floors, stopping)
        self._unobserved = self._unobserved_floor = NOTHING
        self._contact_memory = None
        if isinstance(model, RobotModel) and model.contacts:
            self._contact_memory = ContactMemory(model.contacts)
        self.known = known
        """The map to localize on, if any."""
        self._localizer = Localizer(known, self.lidar, start) if known is not None else None
        self._odometry_buffer = EMPTY
        self._fastest = ANY_SPEED
        if isinstance(model, RobotModel):
            self._fastest = fastest(model.bounds(), model.delay_s)
        self._read: Odometry | None = None  # the newest
        self._received: Pose | None = None  # its frame in `odom`; None: it is the same
        self._twist = Twist(0.0, 0.0)
        self._map_odom = start or Pose(0.0, 0.0, 0.0)
        self._placed = start is None
        self._localization: Localization | None = None
        self._scans = 0
        self._matched = Pose(0.0, 0.0, 0.0)  # odometry pose of the newest scan

    def place(self, pose: Pose, sigma: float = 0.3) -> None:
        """Set the pose on the map, as a person does, within about sigma [m]."""
        if self._localizer is not None:
            self._localizer.place(pose, sigma)

    def reshape(self, outline: Floats) -> None:
        """Use another outline, (k, 2) [m], from the next scan on, for unobserved space."""
        for one in (self._unobserved_space, self._floor_space):
            if one is not None:
                one.reshape(outline)

    def take(self, now: float, readings: Readings) -> Seen:
        """Process the newest readings; returns the result at `now` [s]. May be called at any rate.

        A reading received before adds nothing; a scan older than the odometry that is kept is
        ignored.
        """
        self.receive(now, readings)
        return self.seen(now)

    def receive(self, now: float, readings: Readings) -> None:
        """Process readings, without a result yet: that is `seen`. Readings from the future are
        ignored: nothing received once the clock is right would be newer."""
        latest, odometry, taken = now + AHEAD, readings.odometry, False
        if odometry is not None and not odometry.stamp > latest:
            self._odometry(odometry)
        if len(self._odometry_buffer):
            for source in self._further:
                self._take_scan(source, readings.of_lidar(source.sensor), latest)
            if self._contact_memory is not None:
                here = pose_at(self._odometry_buffer, now)
                self._contact_memory.take(now, readings.contacts, here)
            taken = self._take_scan(self._first, readings.scan, latest)
        if not taken and self._localizer is not None and self._localization is not None:
            self._localization = self._localizer.search_step()
            if not self._localization.lost and len(self._odometry_buffer):
                self._map_odom = compose(self._localization.pose, inverse(self._matched))

    def _odometry(self, odometry: Odometry) -> None:
        if is_new(self._odometry_buffer, odometry):
            odometry = self._continued(odometry)
        self._odometry_buffer = extended(self._odometry_buffer, odometry)
        if all(map(math.isfinite, odometry.twist)):
            self._twist = odometry.twist
        if not self._placed and len(self._odometry_buffer):
            first = Pose(*self._odometry_buffer[-1, 1:4].tolist())
            self._map_odom = compose(self._map_odom, inverse(first))
            self._placed = True

    def _continued(self, odometry: Odometry) -> Odometry:
        """A new reading in `odom`, which goes on where odometry jumps or begins anew: neither the
        robot has jumped, nor what it remembers around it."""
        before, self._read = self._read, odometry
        pose = Pose(*map(float, odometry.pose))
        if before is not None:
            anew, buffer = odometry.stamp < before.stamp, self._odometry_buffer
            if anew or jump(before, odometry, self._fastest):
                newest = float(buffer[-1, 0])
                here = pose_at(buffer, newest if anew else min(odometry.stamp, newest + GAP))
                self._received = compose(here, inverse(pose))
        if self._received is None:
            return odometry
        return odometry._replace(pose=compose(self._received, pose))

    def _take_scan(
        self, source: ObservationSource | RangeSource, scan: Scan | None, latest: float
    ) -> bool:
        """Take a scan, if it is new and not later than this [s]. Returns whether it is."""
        if scan is None or scan.number == source.number or scan.stamp + scan.duration > latest:
            return False
        if isinstance(source, RangeSource):
            source.take(scan, self._odometry_buffer)
            return True
        lost = self._localization is None or self._localization.lost
        known = None if lost else self.known
        before = source.tracked.stamp
        static = source.take(scan, self._odometry_buffer, known, self._map_odom)
        self._scans += source.tracked.stamp != before
        if static is None:
            return True
        self._update_unobserved(source)
        if source is self._first and self._localizer is not None:
            self._localization = self._localizer.correct(static)
            self._map_odom = compose(self._localization.pose, inverse(static.pose))
            self._matched = static.pose
        return True

    def _update_unobserved(self, source: ObservationSource) -> None:
        """Update unobserved space and floor after a scan of a LiDAR."""
        sweep = source.sweep
        if sweep is None:
            return
        if self._floor_space is not None and source.lidar.floor_from > 0.0:
            self._unobserved_floor = self._floor_space.points(sweep)
        if self._unobserved_space is None:
            return
        params, looking = self._tracker_params, self._looking
        last = tuple(one.sweep for one in looking if one.sweep is not None)
        out = np.vstack([movers_out_of_view(one.tracked, params) for one in looking])
        self._unobserved = self._unobserved_space.points(sweep, last, out, params.dynamic.fastest)
        occupied = self._unobserved_space.possibly_occupied(sweep.pose)
        for one in looking:
            one.mark_possibly_occupied(occupied)

    def _points(self) -> tuple[Floats, slice]:
        """Static points of all LiDARs and of contacts of bumpers, then unobserved ground, in
        `odom`; and which of them are that ground."""
        contacts = NOTHING if self._contact_memory is None else self._contact_memory.points
        points = np.concatenate((
            *(source.points for source in self._sources), contacts, self._unobserved,
            self._unobserved_floor,
        ))  # fmt: skip
        end = len(points)
        return points, slice(end - len(self._unobserved) - len(self._unobserved_floor), end)

    def seen(self, now: float) -> Seen:
        """The result at `now` [s] of all readings received."""
        if len(self._odometry_buffer):
            here = pose_at(self._odometry_buffer, now)
        else:
            here = Pose(0.0, 0.0, 0.0)
        located = self._localization
        if located is None and self._localizer is not None:
            located = self._localizer.located._replace(
                lost=True, reason="no scan has been matched yet"
            )
        if located is None:
            located = Localization(here, np.zeros((3, 3)), 1.0, False, "")
        movers, discs, velocity_error = self._moving(now)
        acceleration = np.full(len(discs), self._tracker_params.max_acceleration)
        space, (points, unobserved) = self._unobserved_space, self._points()
        obstacles = Surroundings(discs, acceleration, velocity_error, _NO_WALLS, points)
        return Seen(
            stamp=now, pose=compose(self._map_odom, here), covariance=located.covariance,
            share=located.share, lost=located.lost, reason=located.reason, odometry=here,
            twist=self._twist, map_odom=self._map_odom,
            odom_received=self._received or Pose(0.0, 0.0, 0.0),
            obstacles=obstacles.placed(self._map_odom), unobserved=unobserved,
            assumed_gap=space.assumed_gap(here) if space is not None else math.inf,
            movers=placed_discs(movers, self._map_odom), scans=self._scans,
        )  # fmt: skip

    def _moving(self, now: float) -> tuple[Floats, Floats, Floats]:
        """Movers, all discs for the guard, and bounds of their velocity errors, predicted to
        now, in `odom`."""
        parts = [discs_at(source.tracked, now, self._tracker_params) for source in self._looking]
        if len(parts) == 1:
            return parts[0]
        movers, discs, velocity_error = zip(*parts, strict=True)
        return np.vstack(movers), np.vstack(discs), np.concatenate(velocity_error)


def _around(params: TrackerParams, outline: Floats) -> TrackerParams:
    """Parameters with which what appears around a large robot counts as around a small one."""
    near = max(params.dynamic.near, farthest_corner(outline) + _APPEARS)
    return params._replace(dynamic=params.dynamic._replace(near=near))


def _reach(outline: Floats, lidar: Lidar) -> float:
    """From a LiDAR to beyond the turning circle of the outline, with a margin [m]."""
    return math.hypot(lidar.mount.x, lidar.mount.y) + farthest_corner(outline) + _MARGIN


def warm_up(model: RobotModel, mapped: bool) -> None:
    """Warm up: run all of it once, so that nothing is left to compile in real time.

    mapped: whether there will be a map; a small room is used for it.
    """
    corner = np.array([[-2, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], np.float64)
    here = Pose(0.0, 0.0, 0.0)
    perception = Perception(model, map_from_geometry(corner, here) if mapped else None)
    for k in range(14):
        t = 0.1 * k
        odometry = Odometry(t + 0.05, Pose(0.02 * k, 0.0, 0.01 * k), Twist(0.2, 0.1))
        scan = Scan(t, k, _in_a_room(perception.lidar, k), 0.05)
        further = tuple(
            Scan(t, k, _in_a_room(one.lidar(), k), 0.05, one.name) for one in model.further_lidars
        )
        for _ in range(20):  # a search works in slices, one for each call
            contacts = untouched(model, t)
            perception.take(t + 0.05, Readings(odometry, scan, None, None, further, contacts))
        if k == 9:
            perception.place(here)
    alone = ObservationSource(perception.lidar, "", KEEP, TrackerParams())
    alone.mark_possibly_occupied(np.zeros((1, 2)))  # no mover has left the view above


def _in_a_room(lidar: Lidar, k: int) -> Floats:
    """Ranges of scan k in a small room with a walker; something is too near for the first beam."""
    n = len(lidar.beams)
    bearings = np.arctan2(lidar.beams[:, 1], lidar.beams[:, 0])
    room = 2.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    ranges = np.where(np.abs(np.arange(n) - n // 2 - 12 * k) < 8, 1.2, room)
    ranges[0] = -math.inf
    return ranges
