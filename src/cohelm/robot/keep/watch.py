"""Which monitors watch a robot: by default all of them."""

from __future__ import annotations

from cohelm.robot.gate.gate import Rules
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import Monitor


def monitors(model: RobotModel, rules: Rules) -> tuple[Monitor, ...]:
    """New ones, that have seen nothing yet."""
    return ()
