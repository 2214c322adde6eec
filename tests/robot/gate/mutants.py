"""Which slips in robot/gate are tried, by which tests: `python -m tests.robot.gate.mutants`."""

from __future__ import annotations

from tests.mutation import Target, main

GATE = Target(
    folder="robot/gate",
    tests=("robot/gate/test_gate.py", "robot/gate/test_promises.py"),
    equal={
        ("bounds.py", "_share", "abs(value) > limit  ->  abs(value) >= limit"): "most / most is 1",
    },
)

if __name__ == "__main__":
    main(GATE)
