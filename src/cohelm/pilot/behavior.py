"""What the robot is doing, in one list, so that records read alike."""

FOLLOWING, LED, ESCAPING, EVADING = range(4)
"""FOLLOWING its course; LED by the person; ESCAPING from a tight spot; EVADING somebody."""
