"""Mapping (SLAM): maps from drives, with loop closure."""
