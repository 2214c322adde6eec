"""Perception: odometry and LiDARs in; pose, obstacles, movers and unobserved ground out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose, inverse
from cohelm.core.types import Floats, Pose, Twist
from cohelm.perceive.localize.localization_map import LocalizationMap, on_walls
from cohelm.perceive.localize.localizer import Located, Locator
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.scan.deskew import DeskewedScan, all_round
from cohelm.perceive.scan.odometry_buffer import EMPTY, extended, pose_at
from cohelm.perceive.source.contact_memory import ContactMemory
from cohelm.perceive.source.observation_source import NOTHING, ObservationSource
from cohelm.perceive.source.range_source import RangeSource
from cohelm.perceive.space.scan_memory import ScanMemoryParams
from cohelm.perceive.space.unobserved import Blind, UnwatchedFloor
from cohelm.perceive.track.tracker import TrackerParams, bodies, hidden, strays
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Contact, Odometry, Readings, Scan, not_ahead, untouched
from cohelm.robot.sensors import Lidar, LidarModel

_NOBODY = np.empty((0, 6)), np.empty((0, 6)), np.empty(0)
_ON_WALL = 0.1  # what ends as near to a wall of the map as this stands [m]


class Seen(NamedTuple):
    """What is known at one instant. Two frames: `odom`, which is smooth, drifts, and never
    jumps, for keeping clear of things; and the map's, for following a reference."""

    stamp: float
    """The instant, of the robot's clock [s]; all poses and discs are foretold to it."""
    pose: Pose
    """Of the body in the map. Without a map, and when lost from the start, as in `odom`."""
    covariance: Floats
    """(3, 3) of `pose`, in x, y, psi."""
    share: float
    """Of the beams that agree with the map, in [0, 1]."""
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
    points: Floats
    """Standing things, and behind them where ground begins that may hold anything, as nothing looks
    there, (p, 2), in `odom` [m]."""
    blind: int
    """How many of the points are such ground."""
    discs: Floats
    """Moving things, (n, 6) as in `core.types`, in `odom`."""
    mobile: Floats
    """What the guard is told to move: `discs`, and behind them, as small discs that may go
    anywhere, what may set off though nobody knows that it moves, (m, 6), in `odom`."""
    mobile_max_acceleration: Floats
    """(m,), how fast each of those may change its velocity [m/s^2]."""
    mobile_velocity_error: Floats
    """(m,), by how much the velocity of each may be another one already [m/s]."""
    odometry_stamp: float
    """Of the newest odometry [s]; -inf before the first."""
    scan_stamp: float
    """Of the newest scan's last beam [s]; of several LiDARs, of the one that is longest ago; -inf
    before the first."""


class Perception:
    """Takes in readings as they come, in order; one for each robot.

    `known`: the map to localise on; without, the pose in the map is that of the odometry and
    never lost. `start`: where the robot is on the map; without, it is looked for.
    """

    def __init__(
        self, model: RobotModel | Lidar, known: LocalizationMap | None = None,
        start: Pose | None = None,
        remembering: ScanMemoryParams | None = None, watching: TrackerParams | None = None,
        outline: Floats | None = None, further: Sequence[LidarModel] = (),
    ) -> None:  # fmt: skip
        """Of a robot, or of LiDARs alone. Raises CohelmError for a robot without a LiDAR.

        outline: with a LiDAR alone, (k, 2) of what it is on [m]; without, ground that may hold
        anything is not told. further: LiDARs beside that one.
        """
        if isinstance(model, Lidar):
            self.lidar = model
        elif model.lidar is None:
            raise CohelmError(f"{model.name} has no LiDAR, and nothing to perceive with: add one")
        else:
            self.lidar, outline, further = model.lidar.lidar(), model.outline, model.further_lidars
        care, self._watching = remembering or ScanMemoryParams(), watching or TrackerParams()
        self._first = ObservationSource(self.lidar, "", care, self._watching)
        self._further = tuple(
            RangeSource(one) if one.range_sensor
            else ObservationSource(one.lidar(), one.name, care, self._watching)
            for one in further
        )  # fmt: skip
        self._sources = (self._first, *self._further)
        self._blind = None
        looking = [one for one in self._sources if isinstance(one, ObservationSource)]
        if outline is not None and not any(all_round(source.lidar) for source in looking):
            self._blind = Blind(outline)
        floors = [one.lidar for one in looking if one.lidar.floor_from > 0.0]
        self._floor = None
        if outline is not None and floors:
            self._floor = UnwatchedFloor(outline, floors)
        self._unwatched = NOTHING
        self._touched = None
        if isinstance(model, RobotModel) and model.contacts:
            self._touched = ContactMemory(model.contacts)
        self.known = known
        """The map to localise on, if there is one."""
        self._locator = Locator(known, self.lidar, start) if known is not None else None
        self._trail = EMPTY
        self._twist = Twist(0.0, 0.0)
        self._points = self._unobserved = self._told = NOTHING
        self._map_odom = start or Pose(0.0, 0.0, 0.0)
        self._placed = start is None
        self._located: Located | None = None
        self._matched = Pose(0.0, 0.0, 0.0)  # odometry pose of the newest scan

    def place(self, pose: Pose, sigma: float = 0.3) -> None:
        """A person says where the robot is on the map, within about sigma [m]."""
        if self._locator is not None:
            self._locator.place(pose, sigma)

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline, (k, 2) [m], from the next scan on: no ground is doubtful
        where it is itself."""
        for one in (self._blind, self._floor):
            if one is not None:
                one.reshape(outline)

    def take(self, now: float, readings: Readings) -> Seen:
        """What is known at `now` [s], with these newest readings; may be called at any rate.

        A reading seen before adds nothing; a scan that is older than all odometry is left out.
        """
        self.hear(now, readings)
        return self.seen(now)

    def hear(self, now: float, readings: Readings) -> None:
        """Take readings in, without asking yet what is known: `seen` tells. Those from
        the future are left out: nothing that comes once the clock is right would be newer."""
        readings = not_ahead(readings, now)
        if readings.odometry is not None:
            self._odometry(readings.odometry)
        if len(self._trail):
            for source in self._further:
                scan = readings.of_lidar(source.sensor)
                if scan is not None and source.new(scan):
                    self._look(source, scan)
            self._feel(now, readings.contacts)
        scan = readings.scan
        if scan is not None and self._first.new(scan) and len(self._trail):
            self._look(self._first, scan)
        elif self._locator is not None and self._located is not None:
            self._located = self._locator.think()
            if not self._located.lost and len(self._trail):
                self._map_odom = compose(self._located.pose, inverse(self._matched))

    def _odometry(self, odometry: Odometry) -> None:
        self._trail = extended(self._trail, odometry)
        if all(map(math.isfinite, odometry.twist)):
            self._twist = odometry.twist
        if not self._placed and len(self._trail):
            first = Pose(*self._trail[-1, 1:4].tolist())
            self._map_odom = compose(self._map_odom, inverse(first))
            self._placed = True

    def _look(self, source: ObservationSource | RangeSource, scan: Scan) -> None:
        if isinstance(source, RangeSource):
            source.take(scan, self._trail)
            self._points = self._standing()
        else:
            found = source.take(scan, self._trail, self._mapped)
            if found is None:
                return
            seen, pose = found
            self._points = self._standing()
            self._look_at_ground(source, pose)
            if source is self._first and self._locator is not None:
                self._located = self._locator.correct(seen, pose, source.stamp)
                self._map_odom = compose(self._located.pose, inverse(pose))
                self._matched = pose
        self._tell()

    def _feel(self, now: float, contacts: Sequence[Contact]) -> None:
        if self._touched is None:
            return
        if self._touched.take(now, contacts, pose_at(self._trail, now)):
            self._points = self._standing()
            self._tell()

    def _tell(self) -> None:
        self._told = self._points
        if len(self._unobserved) or len(self._unwatched):
            self._told = np.vstack((self._points, self._unobserved, self._unwatched))

    def _look_at_ground(self, source: ObservationSource, pose: Pose) -> None:
        """Which ground nobody looks at any more, and which floor nobody has seen, as a LiDAR has
        looked from a pose."""
        if source.look is None:
            return
        if self._floor is not None and source.lidar.floor_from > 0.0:
            self._unwatched = self._floor.points(source.lidar, source.look, pose)
        if self._blind is None:
            return
        sources = [one for one in self._sources if isinstance(one, ObservationSource)]
        looking = [(one.lidar, one.look) for one in sources if one.look is not None]
        out = np.vstack([hidden(one.movers, self._watching) for one in sources])
        self._unobserved = self._blind.points(
            source.lidar, source.look, looking, pose, out, self._watching.wary.fastest
        )
        doubtful = self._blind.doubtful(pose)
        for one in sources:
            one.doubt(doubtful)

    def _standing(self) -> Floats:
        """Points that any LiDAR sees standing, or remembers, and that a bumper has met."""
        parts = [source.points for source in self._sources]
        if self._touched is not None:
            parts.append(self._touched.points)
        return parts[0] if len(parts) == 1 else np.vstack(parts)

    def _mapped(self, seen: DeskewedScan, pose: Pose) -> NDArray[np.bool_] | None:
        """Which points are on the map's walls, where the robot knows its place on it."""
        located, known = self._located, self.known
        if known is None or located is None or located.lost:
            return None
        return on_walls(known, compose(self._map_odom, pose), seen.points, _ON_WALL)

    def seen(self, now: float) -> Seen:
        """What is known at `now` [s] from all that was heard."""
        if len(self._trail):
            here = pose_at(self._trail, now)
            stamp = float(self._trail[-1, 0])
        else:
            here, stamp = Pose(0.0, 0.0, 0.0), -math.inf
        located = self._located
        if located is None and self._locator is not None:
            located = self._locator.located._replace(
                lost=True, reason="no scan has been matched yet"
            )
        if located is None:
            located = Located(here, np.zeros((3, 3)), 1.0, False, "")
        discs, mobile, velocity_error = self._mobile(now)
        return Seen(
            stamp=now, pose=compose(self._map_odom, here), covariance=located.covariance,
            share=located.share, lost=located.lost, reason=located.reason, odometry=here,
            twist=self._twist, map_odom=self._map_odom, points=self._told,
            blind=self.blind, discs=discs,
            mobile=mobile,
            mobile_max_acceleration=np.full(len(mobile), self._watching.max_acceleration),
            mobile_velocity_error=velocity_error, odometry_stamp=stamp,
            scan_stamp=min(source.stamp for source in self._sources),
        )  # fmt: skip

    @property
    def blind(self) -> int:
        """How many of the points that are told are ground that may hold anything; see `Seen`."""
        return len(self._told) - len(self._points)

    def _mobile(self, now: float) -> tuple[Floats, Floats, Floats]:
        """Movers, all that may move, and by how much the velocities of these may be off, foretold
        to now."""
        told = [_movers(source, now, self._watching) for source in self._sources]
        if len(told) == 1:
            return told[0]
        discs, mobile, velocity_error = zip(*told, strict=True)
        return np.vstack(discs), np.vstack(mobile), np.concatenate(velocity_error)


def _movers(
    source: ObservationSource | RangeSource, now: float, watching: TrackerParams
) -> tuple[Floats, Floats, Floats]:
    """The same of one LiDAR."""
    if not len(source.movers.tracks) and not len(source.movers.loose):
        return _NOBODY
    discs, off = bodies(source.movers, now, watching)
    loose, fast = strays(source.movers, now, watching)
    return discs, np.vstack((discs, loose)), np.concatenate((off, fast))


def seen_from(seen: Seen, pose: Pose) -> Pose:
    """A pose of the map as it is in `odom`, by what is known now."""
    return between(seen.map_odom, pose)


def rehearse(model: RobotModel, mapped: bool) -> None:
    """Run all of it once, so that nothing is left to compile when it has to be in time.

    mapped: whether there will be a map; a small room stands for it.
    """
    corner = np.array([[-2, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], np.float64)
    here = Pose(0.0, 0.0, 0.0)
    nowhere = Perception(model, map_from_geometry(corner, here) if mapped else None)
    for k in range(14):
        t = 0.1 * k
        odometry = Odometry(t + 0.05, Pose(0.02 * k, 0.0, 0.01 * k), Twist(0.2, 0.1))
        scan = Scan(t, k, _in_a_room(nowhere.lidar, k), 0.05)
        further = tuple(
            Scan(t, k, _in_a_room(one.lidar(), k), 0.05, one.name) for one in model.further_lidars
        )
        for _ in range(20):  # a search is a slice of work at every call
            none = untouched(model, t)
            nowhere.take(t + 0.05, Readings(odometry, scan, None, None, further, none))
        if k == 9:
            nowhere.place(here)
    alone = ObservationSource(nowhere.lidar, "", ScanMemoryParams(), TrackerParams())
    alone.doubt(np.zeros((1, 2)))  # nobody has left the view above


def _in_a_room(lidar: Lidar, k: int) -> Floats:
    """Ranges of scan k in a small room in which somebody walks."""
    n = len(lidar.beams)
    bearings = np.arctan2(lidar.beams[:, 1], lidar.beams[:, 0])
    room = 2.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    return np.where(np.abs(np.arange(n) - n // 2 - 12 * k) < 8, 1.2, room)
