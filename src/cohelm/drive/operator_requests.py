"""Handles an operator's requests beside driving: another path, a record, pictures.

`turn` is called between two periods of the loop and takes no time; slow work is done beside the
loop. No mode is stored here, and none is chosen but HOLD.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from cohelm.core.frames import placed
from cohelm.core.types import Floats
from cohelm.drive.checking import Checking, InlineChecking, RemoteChecking
from cohelm.drive.jobs import InlineJobs, Jobs, ThreadJobs
from cohelm.drive.over_link import OverLink
from cohelm.drive.proposed import PathChecker
from cohelm.drive.record_switch import Make, RecordSwitch
from cohelm.drive.recorder import Recording
from cohelm.drive.rerouting import PathRequests, Rerouting
from cohelm.drive.session import Session, SessionConfig, driver_of
from cohelm.drive.shown import NO_ZONES, detour, docks_message, map_message, reference_lines
from cohelm.law.reference import Reference
from cohelm.link.bulk_messages import HealthReport, Map, Polyline, ZoneMap
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.plan.course import Course
from cohelm.plan.zones import Zones

_LEAVE = 5.0
"""Wait for a driver that is being built at the end of the drive [s]."""


class SessionJobs:
    """Workers beside the loop: in real time threads and a process, else inline."""

    def __init__(self, judge: PathChecker, real_time: bool) -> None:
        self.checking: Checking = RemoteChecking(judge) if real_time else InlineChecking(judge)
        self.ways: Jobs = ThreadJobs("desk ways") if real_time else InlineJobs()
        self.records: Jobs = ThreadJobs("desk records") if real_time else InlineJobs()
        self.make: Make = Recording


class OperatorRequests:
    """The requests of one session. `close` after it."""

    def __init__(
        self, session: Session, operator: OverLink, known: LocalizationMap | None, records: Path,
        beside: Callable[[PathChecker, bool], SessionJobs] = SessionJobs,
        path_requests: Sequence[PathRequests] = (),
    ) -> None:  # fmt: skip
        """known: the map. records: the folder for records. path_requests: of others than
        the operator."""
        self._session, self._operator = session, operator
        robot = session.plan.robot
        self._jobs = beside(checker_of(session.plan, known), robot.real_time)
        self._rerouting = Rerouting(
            (operator, *path_requests),
            self._jobs.checking,
            self._jobs.ways,
            self._build,
            self._on_adopted,
        )
        self._records = RecordSwitch(
            session, operator, records, self._jobs.records, lambda: self._drawn, self._jobs.make
        )
        self._drawn: tuple[Map | ZoneMap | Polyline, ...] = ()
        self._course: Course | None = None
        self._detour = detour(None)
        self._health: HealthReport | None = None
        session.shown = operator.picture
        for none in NO_ZONES:
            operator.publish(none)
        operator.publish(docks_message(session.loop.supervisor.docking.docks))
        self._known, self._zones = known, session.zone_maps
        self._outline = session.loop.outline
        self._map = () if known is None else (map_message(known),)
        self._lines = reference_lines(robot.scenario.reference.spline())
        self._show(*self._map, *self._zones, *self._lines)

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        self._rerouting.turn(loop)
        self._records.turn(loop)
        reshaped = loop.outline is not self._outline
        if reshaped:
            self._outline = loop.outline
            self._operator.reshape(self._outline)
        if self._session.zone_maps is not self._zones or reshaped:
            self._zones = self._session.zone_maps
            self._rerouting.set_checker(checker_of(self._session.plan, self._known, self._outline))
            self._show(*self._map, *self._zones, *self._lines)
        self._publish_news(loop)

    def close(self) -> None:
        """Finish the record; what is being made besides is not waited for."""
        self._jobs.ways.close(_LEAVE)
        self._rerouting.close()
        self._records.close()

    def _publish_news(self, loop: Loop) -> None:
        """Publish changes of the detour and of the robot's health."""
        pilot = loop.driver.pilot
        course = None if pilot is None else pilot.course
        if course is not self._course:
            self._course, line = course, detour(course)
            if len(line.points) or len(self._detour.points):
                self._detour = line
                self._operator.publish(line)
                loop.log.show(line)
        reported = None if loop.readings is None else loop.readings.health
        if reported is not None:
            health = HealthReport(round(reported.battery, 2), reported.faults)
            if str(health) != str(self._health):  # a NaN is not itself
                self._health = health
                self._operator.publish(health)

    def _build(self, reference: Reference) -> Driver:
        plan = self._session.plan
        return driver_of(plan, plan.robot.real_time, reference)

    def _on_adopted(self, loop: Loop, reference: Reference) -> None:
        """The robot follows another path: publish and record it."""
        self._session.driver = loop.driver
        self._lines = reference_lines(reference)
        self._show(*self._map, *self._zones, *self._lines)
        for line in self._lines:
            loop.log.show(line)

    def _show(self, *all_: Map | ZoneMap | Polyline) -> None:
        """Publish now, and to records that begin later."""
        self._drawn = all_
        for one in all_:
            self._operator.publish(one)


def checker_of(
    plan: SessionConfig, known: LocalizationMap | None, outline: Floats | None = None
) -> PathChecker:
    """What ways of a robot at its site are held against. outline: the robot's; None: its model's
    [m]."""
    robot, zones = plan.robot, plan.zones or Zones()
    outline = robot.model.outline if outline is None else outline
    return PathChecker(
        robot.scenario.reference.speed_mps, outline, *_occupied(known), zones.keep_out
    )


def _occupied(known: LocalizationMap | None) -> tuple[Floats, Floats]:
    """Centres of occupied cells (p, 2), and the corners of the map (2, 2) [m]."""
    if known is None:
        return np.empty((0, 2)), np.empty((0, 2))
    rows, columns = np.nonzero(known.gap <= 0.0)
    own = np.asarray(np.column_stack((columns, rows)) + 0.5, dtype=np.float64) * known.resolution
    height, width = known.gap.shape
    ends = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
    corners = placed(np.array(ends, dtype=np.float64) * known.resolution, known.origin)
    return placed(own, known.origin), np.stack((corners.min(axis=0), corners.max(axis=0)))
