"""Slips in robot/collision_monitor, by `python -m tests.robot.collision_monitor.mutants`."""

from __future__ import annotations

from tests.mutation import Target, main

COLLISION_MONITOR = Target(
    folder="robot/collision_monitor",
    tests=tuple(
        f"robot/collision_monitor/test_{name}.py"
        for name in (
            "fields", "odometry", "returns", "surroundings", "runaway", "sweep", "monitor"
        )
    ),
    nearest={
        f"{name}.py": f"robot/collision_monitor/test_{name}.py"
        for name in (
            "fields", "odometry", "returns", "surroundings", "runaway", "sweep", "monitor"
        )
    },
)  # fmt: skip

if __name__ == "__main__":
    main(COLLISION_MONITOR)
