"""Plays a recorded run back as what the robot would have reported."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.trace import Trace
from cohelm.core.types import Floats, Pose, Stick, Twist
from cohelm.drive.drive_playback import DriveFilm
from cohelm.drive.walls import drawn
from cohelm.law import verdict as verdicts
from cohelm.link import messages as m
from cohelm.loop.status import VERDICTS
from cohelm.record.messages import messages
from cohelm.record.read import IncompleteRecord, read
from cohelm.robot.model import RobotModel
from cohelm.scenario import load
from cohelm.scenario.model import Scenario
from cohelm.station.robot_link import News

_NAN = math.nan
_AHEAD = 0.2
_WHY = {
    verdicts.SHAPED: "an obstacle", verdicts.POWERLESS: "the filter could not act",
    verdicts.INVALID: "a number that is not finite",
    verdicts.BRAKING: "braking: nothing else is certain",
    verdicts.STANDING: "standing: nothing else is certain",
}  # fmt: skip


class Film(Protocol):
    """What can be shown of a record."""

    @property
    def start(self) -> float:
        """The robot's clock at the beginning [s]."""
        ...

    @property
    def duration(self) -> float:
        """[s]"""
        ...

    def first(self) -> list[m.FromRobot]:
        """What does not change."""
        ...

    def at(self, t: float) -> list[News]:
        """What was told last at `t` seconds after the beginning; the same object where nothing is
        new of a kind."""
        ...


def film(path: Path) -> Film:
    """Of any record: of a run, or of a drive. Raises CohelmError where it is neither."""
    topic = next((topic for topic, _, _ in messages(path, ("/status", "/period"))), "/status")
    return DriveFilm(path) if topic == "/period" else RunFilm(path)


class RunFilm:
    """A run of `cohelm run`."""

    def __init__(self, path: Path) -> None:
        """Raises CohelmError where there is no such record."""
        with warnings.catch_warnings():
            # as much as there is of a record that was cut short is worth seeing
            warnings.simplefilter("ignore", IncompleteRecord)
            self.trace: Trace = read(path)
        rows = self.trace.rows
        self.start = float(rows["t"][0])
        self.duration = float(rows["t"][-1]) - self.start
        self._scenario = load.parse(self.trace.scenario, Scenario, str(path))
        robot = self._scenario.robot
        if not isinstance(robot, RobotModel):
            raise CohelmError(f"{path}: its scenario names a robot without describing it")
        self._robot = robot

    def first(self) -> list[m.FromRobot]:
        """The robot, the walls, the reference, and where the robot went."""
        limits = self._robot.limits
        rows = self.trace.rows
        way = np.column_stack((rows["x"], rows["y"])).astype(np.float32)
        path = np.column_stack((rows["x_d"], rows["y_d"])).astype(np.float32)
        points = np.array(self._scenario.reference.waypoints_m, dtype=np.float32)
        return [
            m.Hello(
                self._robot.name, "", self._robot.outline.astype(np.float32),
                limits.speed_mps or _NAN, limits.yaw_rate_radps or _NAN, _NAN, "",
                (_NAN, _NAN, _NAN, _NAN),
            ),
            drawn(self._scenario.walls(), way.astype(np.float64)),
            m.Polyline(m.Line.REFERENCE, path),
            m.Polyline(m.Line.WAYPOINTS, points),
        ]  # fmt: skip

    def at(self, t: float) -> list[News]:
        """Status and obstacles of the step that was in effect."""
        k = min(max(int(t / self.trace.dt + 1e-6), 0), len(self.trace) - 1)
        row = self.trace.rows[k]
        stamp = float(row["t"])
        discs = m.Discs(k, self.trace.discs[k][:40].astype(np.float32))
        return [News(self._status(k, row), stamp, 0.0), News(discs, stamp, 0.0)]

    def _status(self, k: int, row: Any) -> m.Status:
        pose = Pose(*(float(row[n]) for n in ("x", "y", "psi")))
        asked = Twist(float(row["nominal_v"]), float(row["nominal_omega"]))
        given = Twist(float(row["applied_v"]), float(row["applied_omega"]))
        verdict = int(row["verdict"])
        why = _WHY.get(verdict, "the wheels' limits" if row["saturated"] else "")
        return m.Status(
            m.Lease(0, 0, "", 0, "", _NAN), m.Mode.SHARED, "", m.Arming.ARMED,
            Stick(float(row["stick_x"]), float(row["stick_psi"])), float(row["authority_x"]),
            pose, pose, given, asked, given, why,
            m.Guarding(
                VERDICTS.get(verdict, m.Verdict.INVALID), float(row["clearance"]),
                self._culprit(k, row), float(row["h"]),
            ),
            float(row["e_p"]), Pose(*(float(row[n]) for n in ("x_d", "y_d", "psi_d"))),
            k / max(len(self.trace) - 1, 1), math.inf, "", m.Localised.EXACT, _NAN, False,
            m.Timing(_NAN, 0, _NAN, _NAN, _NAN, 0), (), (), self._ahead(k), _AHEAD,
        )  # fmt: skip

    def _culprit(self, k: int, row: Any) -> tuple[float, float]:
        i = int(row["culprit"])
        discs: Floats = self.trace.discs[k]
        if not 0 <= i < len(discs):
            return (_NAN, _NAN)
        return (float(discs[i, 0]), float(discs[i, 1]))

    def _ahead(self, k: int) -> tuple[tuple[float, float], ...]:
        """Where it went next: a record knows."""
        step = max(round(_AHEAD / self.trace.dt), 1)
        rows = self.trace.rows[k + step : k + 11 * step : step]
        return tuple((float(r["x"]), float(r["y"])) for r in rows)
