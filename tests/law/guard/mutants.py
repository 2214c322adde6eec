"""Which slips in law/guard are tried, by which tests: `python -m tests.law.guard.mutants`."""

from __future__ import annotations

from tests.mutation import Target, main

_SUM = "a sum or difference is a number exactly where all its parts are"
_EDGE = "an obstacle exactly at the edge of what can matter does not matter"
_EQUAL = (
    ("approach.py", "approach_rows", "x + y", "x - y", _SUM),
    ("approach.py", "approach_rows", "x + y + vx", "x + y - vx", _SUM),
    ("approach.py", "approach_rows", "x + y + vx + vy", "x + y + vx - vy", _SUM),
    ("approach.py", "approach_rows", "x + y + vx + vy + radius", "x + y + vx + vy - radius", _SUM),
    ("approach.py", "approach_rows", "dx * dx + dy * dy < reached * reached",
     "dx * dx + dy * dy <= reached * reached", _EDGE),
    ("approach.py", "approach_rows", "dx * dx + dy * dy < far * far",
     "dx * dx + dy * dy <= far * far", _EDGE),
    ("approach.py", "_within", "x * x + y * y < far * far", "x * x + y * y <= far * far", _EDGE),
    ("approach.py", "approach_rows", "if _within(ax, ay, bx, by, far + reach):", "if True:",
     "`_wall_rows` writes none for a wall as far away as that"),
    ("certify.py", "_clears_static", "if g < floor + grain:", "if True:",
     "checks more often than it must"),
    ("certify.py", "_clears_mover", "closing * (m.stop - t) <= g - hard_margin",
     "closing * (m.stop - t) < g - hard_margin", "the next check, at the stop, finds just enough"),
    ("contact.py", "contact", "1e-12 < far < math.inf", "1e-12 <= far < math.inf",
     "a clearance of 1e-12 m is a touch or none"),
    ("contact.py", "wall_clearance", "0.0 < wx * ex + wy * ey < square",
     "0.0 < wx * ex + wy * ey <= square", "as in `_wall_rows` below"),
    ("contact.py", "overlap", "-across < left.clearance", "-across <= left.clearance",
     "of two corners as deep, either may be named"),
    ("certify.py", "_near", "gx * gx + gy * gy < far * far", "gx * gx + gy * gy <= far * far",
     _EDGE),
    ("certify.py", "blocking_obstacle", "dx * dx + dy * dy < (far + radius) * (far + radius)",
     "dx * dx + dy * dy <= (far + radius) * (far + radius)", _EDGE),
    ("contact.py", "overlap", "-1.0", "1.0",
     "the way out that is returned where there is none, or before any is found"),
    ("project.py", "_interval", "1e-12 * (abs(cx) + abs(cy))", "1e-12 / (abs(cx) + abs(cy))",
     "the normals of all bounds are about 1 long"),
    ("approach.py", "_wall_rows", "0.0 < wx * ex + wy * ey < square",
     "0.0 <= wx * ex + wy * ey < square",
     "a corner square to a wall's end is no nearer to the wall than the end is to it"),
    ("bounds.py", "braked", "steps > 1.0", "steps >= 1.0", "1 - 1 / 1 is 0, a stop"),
    ("bounds.py", "coasting", "whole > 0.0", "whole >= 0.0", "no whole step has no length"),
    ("step.py", "guard", "4", "5", "a column more, which nothing reads"),
    ("approach.py", "approach_rows", "if abs(vx) + abs(vy) + abs(velocity_error) != 0.0:",
     "if True:", "what is faster by nothing reaches no farther"),
    ("certify.py", "_clears_static", "g < floor + grain", "g <= floor + grain",
     "checks more often than it must"),
    ("contact.py", "point_clearance", "if wx * ey - wy * ex > 0.0:", "if False:",
     "`contact` finds the same, more slowly"),
    ("contact.py", "overlap", "min(a, b) > best.clearance", "min(a, b) >= best.clearance",
     "of two edges as deep, either may be named"),
    ("contact.py", "overlap", "math.inf > right.clearance > best.clearance",
     "math.inf > right.clearance >= best.clearance", "of two edges as deep, either may be named"),
    ("contact.py", "wall_clearance", "0.0 < wx * ex + wy * ey < square",
     "0.0 <= wx * ex + wy * ey < square", "as in `_wall_rows` above"),
    ("certify.py", "_travelled", "t <= m.dt", "t < m.dt", "at the first step's end both are it"),
    ("project.py", "_most_violated", "violation > largest", "violation >= largest",
     "of two bounds violated as much, either may be next"),
)  # fmt: skip
"""File, function, what was and what would be; and why no test can notice."""

GUARD = Target(
    folder="law/guard",
    tests=(
        "law/guard/test_project.py",
        "law/guard/test_parts.py",
        "law/guard/test_contact.py",
        "law/guard/test_shaping.py",
        "law/guard/test_certify.py",
        "law/guard/test_guard.py",
        "law/guard/test_checked.py",
        "law/guard/test_sequence.py",
    ),
    nearest={
        "certify.py": "law/guard/test_certify.py",
        "approach.py": "law/guard/test_shaping.py",
        "bounds.py": "law/guard/test_parts.py",
        "contact.py": "law/guard/test_contact.py",
        "rules.py": "law/guard/test_checked.py",
        "step.py": "law/guard/test_guard.py",
    },
    equal={(file, function, f"{was}  ->  {now}"): why for file, function, was, now, why in _EQUAL},
)

if __name__ == "__main__":
    main(GUARD)
