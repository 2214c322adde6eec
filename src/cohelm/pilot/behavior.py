"""The behaviors of the robot, as numbered in records."""

FOLLOWING, LED, ESCAPING, EVADING = range(4)
"""FOLLOWING its path; LED by the operator; ESCAPING: a recovery move; EVADING a mover."""
