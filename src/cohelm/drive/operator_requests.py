"""Handles an operator's requests beside driving: another path, a record, pictures.

`turn` is called between two periods of the loop and takes no time; slow work is done beside the
loop. No mode is stored here, and none is chosen but HOLD.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from cohelm.drive.jobs import InlineJobs, Jobs, ThreadJobs
from cohelm.drive.path_check import PathChecker
from cohelm.drive.path_check_process import Checking, InlineChecking, RemoteChecking
from cohelm.drive.progress_watch import ProgressWatch
from cohelm.drive.record_switch import Make, RecordSwitch
from cohelm.drive.recorder import Recording
from cohelm.drive.rerouting import PathRequests, Rerouting, checker_of
from cohelm.drive.route_check import RouteCheck
from cohelm.drive.session import Session
from cohelm.drive.shown import NO_ZONES, detour, docks_message, map_message, reference_lines
from cohelm.drive.station_publisher import StationPublisher
from cohelm.link.bulk_messages import Alarms, HealthReport, Map, Polyline, WholeAlarm, ZoneMap
from cohelm.link.messages import Alarm
from cohelm.link.rasters import drawable
from cohelm.loop.loop import Loop
from cohelm.plan.course import Course

_LEAVE = 5.0
"""Wait for a driver that is being built at the end of the drive [s]."""


class SessionJobs:
    """Workers beside the loop: in real time threads and a process, else inline."""

    def __init__(self, judge: PathChecker, real_time: bool) -> None:
        self.checking: Checking = RemoteChecking(judge) if real_time else InlineChecking(judge)
        self.paths: Jobs = ThreadJobs("paths") if real_time else InlineJobs()
        self.records: Jobs = ThreadJobs("records") if real_time else InlineJobs()
        self.make: Make = Recording


class OperatorRequests:
    """The requests of one session. `close` after it."""

    def __init__(
        self, session: Session, publisher: StationPublisher, records: Path,
        beside: Callable[[PathChecker, bool], SessionJobs] = SessionJobs,
        path_requests: Sequence[PathRequests] = (),
    ) -> None:  # fmt: skip
        """records: the folder for records. path_requests: of others than the stations."""
        self._session, self._publisher = session, publisher
        robot = session.plan.robot
        self._jobs = beside(checker_of(session.plan, session.known), robot.real_time)
        sources = (publisher, *path_requests)
        self._rerouting = Rerouting(
            session, sources, self._jobs.checking, self._jobs.paths, self._on_adopted
        )
        self._route_check = RouteCheck(session, self._jobs.checking)
        self._records = RecordSwitch(
            session, publisher, records, self._jobs.records, lambda: self._drawn, self._jobs.make
        )
        self._progress = ProgressWatch()
        self._drawn: tuple[Map | ZoneMap | Polyline, ...] = ()
        self._course: Course | None = None
        self._detour = detour(None)
        self._health: HealthReport | None = None
        self._alarms: tuple[Alarm, ...] | None = None
        session.shown, session.watched = publisher.picture, lambda: publisher.watched
        for none in NO_ZONES:
            publisher.publish(none)
        publisher.publish(docks_message(session.loop.supervisor.docking.docks))
        self._zones, self._outline = session.zone_maps, session.loop.outline
        self._map = () if session.known is None else (map_message(session.known),)
        self._lines = reference_lines(robot.route)
        self._show()

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        self._route_check.turn(loop)
        self._rerouting.turn(loop)
        self._records.turn(loop)
        self._progress.turn(loop)
        reshaped = loop.outline is not self._outline
        if reshaped:
            self._outline = loop.outline
            self._publisher.reshape(self._outline)
        if self._session.zone_maps is not self._zones or reshaped:
            self._zones = self._session.zone_maps
            self._show()
        self._publish_news(loop)

    def close(self) -> None:
        """Finish the record; what is being made besides is not waited for."""
        self._jobs.paths.close(_LEAVE)
        self._rerouting.close()
        self._records.close()

    def _publish_news(self, loop: Loop) -> None:
        """Publish changes of the alarms, of the detour and of the robot's health."""
        alarms = loop.alarms.worst()
        if alarms != self._alarms:
            self._alarms = alarms
            self._publisher.publish(Alarms(tuple(WholeAlarm(one, one.text) for one in alarms)))
        pilot = loop.driver.pilot
        course = None if pilot is None else pilot.course
        if course is not self._course:
            self._course, line = course, detour(course)
            if len(line.points) or len(self._detour.points):
                self._detour = line
                self._publisher.publish(line)
                loop.log.show(line)
        reported = None if loop.readings is None else loop.readings.health
        if reported is not None:
            health = HealthReport(round(reported.battery, 2), reported.faults)
            if str(health) != str(self._health):  # a NaN is not itself
                self._health = health
                self._publisher.publish(health)

    def _on_adopted(self, lines: tuple[Polyline, ...]) -> None:
        """The robot follows another path: publish it."""
        self._lines = lines
        self._show()

    def _show(self) -> None:
        """Publish map, zones and path now, and to records that begin later."""
        self._drawn = (*self._map, *self._zones, *self._lines)
        for one in self._drawn:
            self._publisher.publish(drawable(one))
