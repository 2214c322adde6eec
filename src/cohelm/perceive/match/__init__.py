"""Scan matching against surfaces, and the covariance of the pose."""
