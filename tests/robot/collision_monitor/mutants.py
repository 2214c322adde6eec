"""Slips in robot/collision_monitor, by `python -m tests.robot.collision_monitor.mutants`."""

from __future__ import annotations

from tests.mutation import Target, main

NAMES = (
    "fields", "odometry", "returns", "surroundings", "free_space", "runaway", "sweep", "monitor"
)  # fmt: skip

COLLISION_MONITOR = Target(
    folder="robot/collision_monitor",
    tests=tuple(f"robot/collision_monitor/test_{name}.py" for name in NAMES),
    nearest={f"{name}.py": f"robot/collision_monitor/test_{name}.py" for name in NAMES},
)

if __name__ == "__main__":
    main(COLLISION_MONITOR)
