"""Localization on a map, and detection of and recovery from being lost."""
