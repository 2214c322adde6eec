"""Scans against surfaces, and how sure a pose is that came of it."""
