"""Tracking of moving obstacles, and points that may begin to move."""
