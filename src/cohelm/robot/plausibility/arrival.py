"""Checks the stamps and numbers of scans against the times at which they arrive."""

from __future__ import annotations

import math

from cohelm.robot.plausibility.content import CAREFUL
from cohelm.robot.plausibility.finding import Finding, fault, slow
from cohelm.robot.port import Scan
from cohelm.robot.sensors import LidarModel

_SLACK = 0.1
"""Delay of a scan allowed beyond its LiDAR's latency [s]: the loop reads every 20 to 100 ms."""
_PATIENCE = 5  # scans in a row
_TOO_OFTEN = 3
"""... in a row stamped too close together: more than reading late explains."""


class Arrival:
    """Arrival checks of one LiDAR's scans, in order."""

    def __init__(self, lidar: LidarModel) -> None:
        self._usual = lidar.latency_s + _SLACK
        self._period = 1.0 / lidar.rate_hz
        self._last: Scan | None = None
        self._late = self._often = 0

    def forget(self) -> None:
        """Reset: as if no scan had arrived."""
        self._last, self._late, self._often = None, 0, 0

    def new(self, scan: Scan) -> bool:
        """Whether this scan differs from the last one."""
        last = self._last
        return last is None or scan.number != last.number or scan.stamp != last.stamp

    def take(self, now: float, scan: Scan) -> list[Finding]:
        """Check a new scan."""
        last, self._last = self._last, scan
        late = now - scan.stamp - scan.duration > self._usual
        self._late = self._late + 1 if late else 0
        if last is not None:
            if scan.number == last.number:
                return [fault(f"the scan's number stays {scan.number} while its stamps go on")]
            if scan.number < last.number:
                return [fault(f"the scans' numbers went back from {last.number} to {scan.number}")]
            if scan.stamp == last.stamp:
                return [fault("the scans' stamps stand still")]
            if scan.stamp < last.stamp:
                back = last.stamp - scan.stamp
                return [
                    fault(f"the scans' stamps went back by {back:.2f} s, as if a clock was set")
                ]
            skipped = scan.number - last.number
            often = scan.stamp - last.stamp < 0.4 * self._period * skipped
            self._often = self._often + 1 if often else 0
            if self._often >= _TOO_OFTEN:
                step = 1000.0 * (scan.stamp - last.stamp) / skipped
                return [fault(f"scans are stamped {step:.0f} ms apart, more often than they come")]
        if self._late >= _PATIENCE:
            age = 1000.0 * (now - scan.stamp - scan.duration)
            return [slow(CAREFUL, f"scans come {age:.0f} ms late")]
        return []


def usable(scan: Scan) -> bool:
    """Whether its stamp and duration are finite."""
    return math.isfinite(scan.stamp) and math.isfinite(scan.duration) and scan.duration >= 0.0
