"""How a drive is put together to a map: the numbers."""

from __future__ import annotations

from typing import NamedTuple


class MapperParams(NamedTuple):
    """How a drive is put together."""

    bend: float = 0.02
    """A straight line may be bent by this, one sigma, for robots are mapped with before anybody
    calibrates them: by wheels 1 % unequal, half a metre apart [rad/m]."""
    mount: float = 0.05
    """And the LiDAR's place on the robot be unsure by this: many logs do not say it [m]."""
    apart: float = 0.3
    """A place is this far, or has turned as much, from the last [m, rad]."""
    submap: int = 15
    """Places that the next scan is matched against."""
    again: int = 35
    """A place is met again if so many lie between."""
    search: float = 1.0
    """Old places are looked for within this and three sigma of where they are [m];"""
    lonely: float = 5.0
    """within nine, each time that no loop was closed for so much way [m]."""
    behind: float = 8.0
    """What was seen from so much farther counts as well, for the submap is as long [m]."""
    every: float = 0.9
    """After so much way a loop is looked for [m]."""
    fits: float = 0.65
    """A loop is closed if this share of the points lies on surfaces,"""
    rms: float = 0.05
    """so near [m],"""
    alone: float = 0.1
    """no other place comes as near to that share,"""
    firm: float = 5e3
    """and the weaker direction has this information [1/m^2]."""
    whole: float = 0.8
    """What disagrees with the drive must explain this share: a corridor explains 0.7 of another;"""
    holds: float = 2.0
    """and it is believed where views so far apart say the same [m]."""
    others: float = 6.0
    """At the end, places are linked if so near to each other [m]."""
    far: float = 15.0
    """Points farther from the LiDAR than this are left out [m]."""
