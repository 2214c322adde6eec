"""Shared control with obstacle avoidance for uncrewed ground vehicles."""

__version__ = "0.1.0"
