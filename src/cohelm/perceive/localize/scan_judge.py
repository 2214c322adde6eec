"""Judges how well a scan fits a pose on the map, relative to what is usual on this map."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, judge
from cohelm.perceive.localize.map_errors import MapErrorCosts, new_errors
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.sensors import Lidar

_SCATTER = 0.06
"""Prior scatter of scan points about the surfaces of a map [m],"""
_LEAST_SCATTER = 0.02
"""and its minimum, of an accurate LiDAR."""


@dataclass
class ScanJudge:
    """Estimates, while a pose is tracked, the surface offset and the usual scan likelihood."""

    known: LocalizationMap
    lidar: Lidar
    match_params: MatchParams = field(default_factory=MatchParams)

    def __post_init__(self) -> None:
        self.usual = -math.inf  # log likelihood of scans, as they were before they were odd
        self._spread = 0.0  # how far those of scans are from what is usual, in the mean
        self._blank = 0.0  # by how much what ended where the map knows nothing made it less likely
        self._scatter = _SCATTER  # of points about their surfaces, as far as learnt [m]

    def judge(self, pose: Pose, ranges: Floats, every: int = 1) -> Judgement:
        """Compare a scan's ranges (n,) [m] with the map, from a pose of the body. every: stride of
        the beams."""
        offset = self.match_params.offset
        return judge(self.known, self.lidar, pose, ranges, every, offset, self._scatter)

    def weighed(self, judged: Judgement) -> float:
        """Log likelihood for comparison between places: as many beams may end in unknown space as
        did before."""
        unknown = max(judged.log - judged.weighed - self._blank, 0.0)
        return judged.log + max(judged.closer, 0.0) - unknown

    def charge(
        self, pose: Pose, sweep: DeskewedScan, charges: MapErrorCosts, every: int = 1
    ) -> None:
        """Add the map errors that a scan implies at a place to its costs."""
        charges.take(new_errors(
            self.known, self.lidar, pose, sweep.ranges, every, self.match_params.offset,
            self._scatter, charges.cells, charges.off, sweep.stamp,
        ))  # fmt: skip

    def fits(self, judged: Judgement, alarmed: bool) -> bool:
        """Whether a tracked pose may be kept; after an alarm the threshold is stricter."""
        least = PARAMS.unlikely
        if alarmed and self.usual > -math.inf:
            least = max(least, self.usual - max(PARAMS.margin, 4.0 * self._spread))
        return judged.log >= least and self.fair(judged, PARAMS.fair)

    def as_usual(self, judged: Judgement) -> bool:
        """Whether a scan fits as well as scans did before they became odd."""
        return judged.log > self.usual - PARAMS.alike

    def plausible(self, judged: Judgement) -> bool:
        """Whether a pose is plausible by one scan."""
        return judged.log >= PARAMS.least and self.fair(judged, PARAMS.fair)

    def fair(self, judged: Judgement, least: float) -> bool:
        """Whether at least this share of the unblocked beams agrees, and enough are unblocked."""
        unblocked = 1.0 - judged.short
        return (
            judged.beam_count >= 10
            and judged.agree >= least * unblocked
            and judged.short < PARAMS.blocked
        )

    def learn(self, judged: Judgement, may_have_moved: bool) -> bool:
        """Update the usual likelihood by the newest scan at the tracked pose, unless it is odd
        while the robot may have been moved. Returns whether it is odd."""
        odd = judged.log < max(PARAMS.odd, self.usual - max(PARAMS.drop, 3.0 * self._spread))
        if self.usual == -math.inf:
            self.usual, self._blank = judged.log, judged.log - judged.weighed
        if not odd or not may_have_moved:
            self._blank += 0.1 * (judged.log - judged.weighed - self._blank)
            self._spread += 0.01 * (abs(judged.log - self.usual) - self._spread)
            self.usual += 0.01 * (judged.log - self.usual)
        return odd

    def learn_surfaces(self, fit: ScanFit, distance: float) -> None:
        """Estimate the surface offset: a wall's surface is in the middle of its cells on a map made
        from hits, at their edge on one of filled cells. It is observable with walls on both sides.
        distance: since the scan before [m]."""
        most = self.known.resolution
        gain = min(distance / PARAMS.drawn, 0.1)
        new = self.match_params.offset + gain * fit.before
        self.match_params = self.match_params._replace(offset=min(max(new, -most), most))
        if math.isfinite(fit.rms):
            scatter = self._scatter + gain * (fit.rms - self._scatter)
            self._scatter = max(scatter, _LEAST_SCATTER)
