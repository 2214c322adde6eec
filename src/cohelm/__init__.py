"""Shared control with obstacle avoidance for uncrewed ground vehicles.

What stands in `__all__` is what cohelm promises to keep; docs/api.md shows it at work. Nothing
heavy is imported until a name is used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as `typing` has it, whose import would be half of that of the command
if TYPE_CHECKING:
    from typing import Any

    from cohelm.core.errors import CohelmError
    from cohelm.core.obstacles import Obstacles
    from cohelm.core.types import Pose, Twist
    from cohelm.drive.library import drive
    from cohelm.law.verdict import Verdict
    from cohelm.pilot.safety_filter import FilterResult, SafetyFilter
    from cohelm.record.read import Record, read_record
    from cohelm.robot.base import Robot
    from cohelm.robot.limits import Limits
    from cohelm.robot.model import RobotModel
    from cohelm.robot.port import Odometry, Readings, Scan
    from cohelm.scenario.load import load_robot, load_scenario
    from cohelm.scenario.model import Scenario
    from cohelm.study.controlled import Observation, RunResult, run

__version__ = "0.1.0"

__all__ = [
    "CohelmError", "FilterResult", "Limits", "Observation", "Obstacles", "Odometry", "Pose",
    "Readings", "Record", "Robot", "RobotModel", "RunResult", "SafetyFilter", "Scan", "Scenario",
    "Twist", "Verdict", "drive", "load_robot", "load_scenario", "read_record", "run",
]  # fmt: skip

_HOME = {
    "CohelmError": "core.errors",
    "FilterResult": "pilot.safety_filter",
    "Limits": "robot.limits",
    "Observation": "study.controlled",
    "Obstacles": "core.obstacles",
    "Odometry": "robot.port",
    "Pose": "core.types",
    "Readings": "robot.port",
    "Record": "record.read",
    "Robot": "robot.base",
    "RobotModel": "robot.model",
    "RunResult": "study.controlled",
    "SafetyFilter": "pilot.safety_filter",
    "Scan": "robot.port",
    "Scenario": "scenario.model",
    "Twist": "core.types",
    "Verdict": "law.verdict",
    "drive": "drive.library",
    "load_robot": "scenario.load",
    "load_scenario": "scenario.load",
    "read_record": "record.read",
    "run": "study.controlled",
}
"""Where each name lives."""


def __getattr__(name: str) -> Any:
    """Import a name's home when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'cohelm' has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"cohelm.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
