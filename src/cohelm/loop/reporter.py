"""Sends each period to the recorder, the live view and the operator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Twist
from cohelm.link.messages import Discs
from cohelm.link.operator import Operator
from cohelm.link.recorded_status import StatusWords
from cohelm.loop.drive_log import DriveLog
from cohelm.loop.driver import Driver
from cohelm.loop.status import (
    PeriodReport,
    hidden_reason,
    period_fields,
    predicted,
    scan_parts,
    status,
)
from cohelm.loop.stick_arming import StickState
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.step import Decision
from cohelm.robot.model import RobotModel
from cohelm.robot.port import Readings
from cohelm.robot.sensors import Lidar

_MAX_STATUS_RATE = 50.0  # statuses a second, at most
_MAX_DISCS = 40  # shown, at most


class Reporter:
    """The reporter of one loop."""

    def __init__(
        self, log: DriveLog, operator: Operator, driver: Driver, model: RobotModel, lidar: Lidar,
        has_map: bool, period: float,
    ) -> None:  # fmt: skip
        """lidar: the first one. has_map: whether poses are those of a map. period: [s]."""
        self._log, self._operator, self.driver = log, operator, driver
        self._has_map, self._period = has_map, period
        self._lidars = {"": (0, lidar)} | {
            one.name: (k, one.lidar()) for k, one in enumerate(model.further_lidars, 1)
        }
        """Index and LiDAR by the name of its scans; the first one's is empty."""
        self._last_status = -math.inf
        self.held = ""
        """Why the guard holds the robot back for nothing visible; empty: it does not."""

    def report(
        self, now: float, readings: Readings, seen: Seen, stick_state: StickState,
        decision: Decision | None, applied: Twist,
    ) -> PeriodReport:  # fmt: skip
        """This period's report. New scans and discs are sent at once."""
        driver, new = self.driver, self._log.readings(readings)
        for scan in new:
            which, lidar = self._lidars.get("" if scan is readings.scan else scan.sensor, (0, None))
            if lidar is not None:
                self._operator.show(*scan_parts(scan, lidar, seen.pose, which))
        if new and new[0] is readings.scan:
            discs = Discs(new[0].number, self._discs(seen))
            self._operator.show(discs)
            self._log.show(discs)
        clearance = driver.clearance(seen.pose, driver.obstacles(seen), seen.unobserved)
        return PeriodReport(
            now, readings, seen, stick_state, decision, applied, self._progress(), clearance
        )

    def record(self, report: PeriodReport, loop_fields: Mapping[str, Any]) -> NDArray[np.void]:
        """Record the period; returns its row. loop_fields: what the loop adds."""
        fields = period_fields(report) | {"dropped": self._log.dropped} | dict(loop_fields)
        return self._log.period(fields)

    def send_status(
        self, report: PeriodReport, row: NDArray[np.void], words: StatusWords, late: float
    ) -> None:
        """Send a status to the operator, where one is due. words: without `held`. late: worst
        recent lateness [s]."""
        if report.now - self._last_status < 1.0 / _MAX_STATUS_RATE - 0.25 * self._period:
            return
        self._last_status = report.now
        nominal = Twist(float(row["nominal_v"]), float(row["nominal_omega"]))
        self.held = hidden_reason(report, nominal)
        words = words._replace(why=words.why or self.held)
        self._log.words(words)
        made = status(row, words, self._has_map, predicted(report.seen.pose, report.applied))
        timing = made.timing._replace(late=late)
        self._operator.send_status(made._replace(recording=self._log.open, timing=timing))

    def _discs(self, seen: Seen) -> NDArray[np.float32]:
        """The nearest round obstacles in the map, (n, 6) as in `core.types`."""
        rows = self.driver.obstacles(seen).discs
        far = np.hypot(rows[:, 0] - seen.pose.x, rows[:, 1] - seen.pose.y)
        return rows[np.argsort(far)[:_MAX_DISCS]].astype(np.float32)

    def _progress(self) -> float:
        pilot = self.driver.pilot
        if pilot is None:
            return math.nan
        return pilot.state.row / max(len(pilot.planner.route.line) - 1, 1)
