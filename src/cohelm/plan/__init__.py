"""Where to go: path planner, elastic band, recovery moves, prediction and evasion."""
