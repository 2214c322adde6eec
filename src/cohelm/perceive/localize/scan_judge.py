"""Judges how well a scan fits a pose on the map, by what is usual on this map."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cohelm.core.types import Floats, Pose
from cohelm.perceive.localize.caution import Caution
from cohelm.perceive.localize.localization_map import Judgement, LocalizationMap, judge
from cohelm.perceive.localize.map_errors import Charges, charged
from cohelm.perceive.match.scan_matching import MatchParams, ScanFit
from cohelm.robot.sensors import Lidar

_SCATTER = 0.06
"""Of the points of scans about the surfaces of a map of which nothing has been learnt [m],"""
_LEAST_SCATTER = 0.02
"""and of any: an accurate LiDAR's."""


@dataclass
class ScanJudge:
    """Learns, while a pose is tracked, how the map was drawn and how likely scans usually are."""

    known: LocalizationMap
    lidar: Lidar
    caution: Caution
    care: MatchParams = field(default_factory=MatchParams)

    def __post_init__(self) -> None:
        self.usual = -math.inf  # log likelihood of scans, as they were before they were odd
        self._spread = 0.0  # how far those of scans are from what is usual, in the mean
        self._blank = 0.0  # by how much what ended where the map knows nothing made it less likely
        self._scatter = _SCATTER  # of points about their surfaces, as far as learnt [m]

    def judge(self, pose: Pose, ranges: Floats, every: int = 1) -> Judgement:
        """A scan's ranges (n,) [m] against what the map lets one see from a pose of the body.
        every: only each so-manieth beam."""
        offset = self.care.offset
        return judge(self.known, self.lidar, pose, ranges, every, offset, self._scatter)

    def weighed(self, judged: Judgement) -> float:
        """How likely a place is beside others: where much of the view ended where the map knows
        nothing until now, as much of it may."""
        unknown = max(judged.log - judged.weighed - self._blank, 0.0)
        return judged.log + max(judged.closer, 0.0) - unknown

    def charge(
        self, pose: Pose, ranges: Floats, stamp: float, charges: Charges, every: int = 1
    ) -> None:
        """Take what a scan tells to a place into its charges."""
        care = self.care.offset, self._scatter, charges.cells, charges.off, stamp
        charges.take(charged(self.known, self.lidar, pose, ranges, every, *care))

    def fits(self, judged: Judgement, alarmed: bool) -> bool:
        """Whether a tracked pose may be kept; after a jolt, less is excused than before."""
        c = self.caution
        least = c.unlikely
        if alarmed and self.usual > -math.inf:
            least = max(least, self.usual - max(c.margin, 4.0 * self._spread))
        return judged.log >= least and self.fair(judged, c.fair)

    def as_usual(self, judged: Judgement) -> bool:
        """Whether a scan fits as well as scans did before they were odd."""
        return judged.log > self.usual - self.caution.alike

    def plausible(self, judged: Judgement) -> bool:
        """Whether the robot may well be there, by one scan."""
        return judged.log >= self.caution.least and self.fair(judged, self.caution.fair)

    def fair(self, judged: Judgement, least: float) -> bool:
        """Whether at least this share of what is unblocked agrees, and enough is unblocked."""
        unblocked = 1.0 - judged.short
        c = self.caution
        return judged.told >= 10 and judged.agree >= least * unblocked and judged.short < c.blocked

    def learn(self, judged: Judgement, movable: bool) -> bool:
        """Learn what is usual, from the newest scan at the tracked pose; nothing from one that is
        odd while the robot may have been moved. Whether it is odd."""
        c = self.caution
        odd = judged.log < max(c.odd, self.usual - max(c.drop, 3.0 * self._spread))
        if self.usual == -math.inf:
            self.usual, self._blank = judged.log, judged.log - judged.weighed
        if not odd or not movable:
            self._blank += 0.1 * (judged.log - judged.weighed - self._blank)
            self._spread += 0.01 * (abs(judged.log - self.usual) - self._spread)
            self.usual += 0.01 * (judged.log - self.usual)
        return odd

    def learn_surfaces(self, fit: ScanFit, way: float) -> None:
        """Learn how the map was drawn: a wall's surface is the middle of the cells that hits fell
        into, or the edge of cells that were filled. Walls on either side show it, for what moves
        the robot from one moves it to the other. way: since the scan before [m]."""
        most = self.known.resolution
        learnt = min(way / self.caution.drawn, 0.1)
        new = self.care.offset + learnt * fit.before
        self.care = self.care._replace(offset=min(max(new, -most), most))
        if math.isfinite(fit.rms):
            scatter = self._scatter + learnt * (fit.rms - self._scatter)
            self._scatter = max(scatter, _LEAST_SCATTER)
