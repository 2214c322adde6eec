"""Parameters of mapping."""

from __future__ import annotations

from typing import NamedTuple


class MapperParams(NamedTuple):
    """Parameters of mapping."""

    bend: float = 0.02
    """Prior standard deviation of the bend of straight lines, of an uncalibrated robot: wheels 1 %
    unequal, half a metre apart [rad/m]."""
    mount: float = 0.05
    """Uncertainty of the LiDAR's position on the robot, which many logs do not have [m]."""
    apart: float = 0.3
    """Distance or angle between two places [m, rad]."""
    submap: int = 15
    """Number of places that a scan is matched against."""
    again: int = 35
    """Number of places between that make it a revisit."""
    search: float = 1.0
    """Search radius for old places, beside three sigma [m];"""
    lonely: float = 5.0
    """nine sigma after this distance without a loop [m]."""
    behind: float = 8.0
    """Places so much farther are included, as the submap is as long [m]."""
    every: float = 0.9
    """Distance between two searches for loops [m]."""
    fits: float = 0.65
    """A loop needs this share of the points on surfaces,"""
    rms: float = 0.05
    """this rms distance [m],"""
    alone: float = 0.1
    """this lead of the share over any other place,"""
    firm: float = 5e3
    """and this information in the weaker direction [1/m^2]."""
    whole: float = 0.8
    """One that contradicts the drive needs this share: a corridor explains 0.7 of another;"""
    holds: float = 2.0
    """and confirmation by views so far apart [m]."""
    others: float = 6.0
    """At the end, places so near to each other are linked [m]."""
    far: float = 15.0
    """Points farther from the LiDAR than this are ignored [m]."""


PARAMS = MapperParams()
"""Those in use."""
