"""Worlds made by others, read in their own formats into the arrays the simulator uses."""
