"""Which slips in law/guard are tried, by which tests: `python -m tests.law.guard.mutants`."""

from __future__ import annotations

from tests.mutation import Target, main

GUARD = Target(
    folder="law/guard",
    tests=(
        "law/guard/test_project.py",
        "law/guard/test_parts.py",
        "law/guard/test_contact.py",
        "law/guard/test_shaping.py",
        "law/guard/test_certify.py",
        "law/guard/test_guard.py",
        "law/guard/test_sequence.py",
    ),
)

if __name__ == "__main__":
    main(GUARD)
