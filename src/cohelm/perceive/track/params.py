"""Parameters of the tracker, and of what may begin to move."""

from __future__ import annotations

from typing import NamedTuple


class PotentiallyDynamicParams(NamedTuple):
    """Assumptions on objects that may begin to move."""

    fastest: float = 1.3
    """Largest speed [m/s]."""
    creeping: float = 0.1
    """Largest speed of a point that has stood [m/s]."""
    keep: float = 10.0
    """How long free space is remembered [s]."""
    vouched: float = 2.0
    """Distance driven for which free space is remembered, by odometry drift [m]."""
    near: float = 2.0
    """Points farther from the body's origin than this are not considered [m]."""


class TrackerParams(NamedTuple):
    """Parameters of the tracker."""

    max_acceleration: float = 1.0
    """Largest acceleration of a mover [m/s^2], for the Kalman filter and for the guard."""
    scatter: float = 0.05
    """Standard deviation of a cluster's centre [m]."""
    slowest: float = 0.1
    """A slower track is at rest [m/s]."""
    proof: int = 3
    """Scans that must prove motion; up to twice as many are counted."""
    calm: float = 3.0
    """A mover at rest stays a mover for so long [s]; with known radius, for `dynamic.keep`."""
    keep: float = 1.5
    """An occluded mover is predicted for so long [s]."""
    lookback: tuple[float, ...] = (0.45, 0.95, 1.4)
    """Ages of the earlier sweeps used by the motion test [s]."""
    radius_margin: float = 0.03
    """Added to a mover's radius, beside one standard deviation of its place [m]."""
    min_body_radius: float = 0.12
    """A larger object is reported from the first scan that proves motion [m]."""
    velocity_sigmas: float = 1.0
    """Standard deviations of the reported velocity error."""
    longest: float = 1.0
    """Movers are predicted, and grow, for so long after a sweep: not shorter than a robot drives
    without the next one [s]."""
    dynamic: PotentiallyDynamicParams = PotentiallyDynamicParams()
    """Of objects that may begin to move."""
