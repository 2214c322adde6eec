"""The motion that scans show against odometry's: now, and over the last metres."""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.types import Floats
from cohelm.robot.plausibility.bow import RangeBias
from cohelm.robot.plausibility.content import CAREFUL, CRAWL
from cohelm.robot.plausibility.finding import Finding, fault, hold, slow
from cohelm.robot.plausibility.match import Match, match
from cohelm.robot.plausibility.sight import Sight, motion, turned
from cohelm.robot.plausibility.view import farther, vanished
from cohelm.robot.sensors import Lidar


class MotionTolerance(NamedTuple):
    """How far scans and odometry may be apart."""

    way: float = 0.05
    """Over `_WINDOW` [m]: a tenth of a second at half a metre a second."""
    turn: float = math.radians(2.5)
    """[rad]; at two metres, a thumb's breadth more than the noise of a range."""
    share: float = 0.1
    """... and this of the motion more: wheels measure a few per cent wrongly, and slip."""
    surface: float = 0.4
    """So much surface, square to the beams, must speak against odometry [m]; and of one that is
    straight for half a metre: a person has none."""
    majority: float = 2.0
    """... and so many times as much as speaks for it."""
    gone: float = 0.7
    """What vanishes from one scan to the next into nothing, of one surface [m]: more than a person
    is wide; and one who runs, 2.5 m/s, uncovers 0.25 m in a tenth of a second."""
    replaced: float = 0.9
    """What vanishes and shows what is behind [m]: a person who steps aside."""
    scene: float = 2.0
    """What neither a person nor a door uncovers from one scan to the next, of one surface [m]: all
    that is seen is another, so the robot was moved, or its LiDAR says other ranges than before."""
    longer: float = 0.12
    """So much farther all around can not be at once [m]: walls tell no less, `bow.py`."""
    lag: float = 0.1
    """Scans may be stamped so wrongly [s]: 2 cm when Sally brakes from 0.2 m/s."""
    scale: float = 0.1
    """Odometry's way may be longer or shorter by this share, over metres."""
    angle: float = math.radians(3.0)
    """The way by the scans may lead so far beside that of the wheels [rad]: the mount."""


TOLERANCE = MotionTolerance()
_WINDOW = 0.65  # motion is compared over so long [s]
_LATELY, _APART = 4.0, 0.5  # ranges are compared over so long, with sights so far apart [s]
_FORGET = 0.995  # of what showed a lag, at each scan: half of it after 14 s
_CHANGES = 0.1  # a change of speed that shows one [m/s]
_CHANGED = 0.05  # changes of speed, squared and added up, before a lag is judged [m^2/s^2]
_PROVEN = 0.12  # a way over which odometry and scans have to agree after they did not [m]
_AGREED = 0.04  # ... within this [m]
_AFRESH = 2.0  # a way with no bow to be seen, after which another scene is taken as it is [m]
_ENDS = 0.5  # a way after which that is given up: the scans do not show the motion [m]
_LEG = 0.3  # a sample of the long run is so long [m]
_LEGS, _KEPT = 8, 10  # legs before the way is judged, and that are kept
_AGREE = 0.8  # of the legs are off by half as much at least
_TOLD = 10.0  # points that show a direction before it is judged
_OLD = 3.0  # a leg may take so long [s]


class Motion:
    """Takes sights in order, and says what can not be."""

    def __init__(self, lidar: Lidar, tolerance: MotionTolerance = TOLERANCE) -> None:
        self._lidar, self._t = lidar, tolerance
        self._recent: deque[Sight] = deque()
        self._lately: deque[Sight] = deque(maxlen=round(_LATELY / _APART))
        self._leg: Sight | None = None
        self._scales: deque[float] = deque(maxlen=_KEPT)  # scans' way ahead over odometry's
        self._angles: deque[float] = deque(maxlen=_KEPT)  # of the scans' way to odometry's [rad]
        self._lag = np.zeros((2, 2))  # speeding up, slowing down: change^2, change * off
        self.doubted = False
        """Whether scans and odometry have disagreed, and not agreed again over some way since."""
        self._probe: Sight | None = None
        self._other: Sight | None = None
        """Since when all that is seen is another, unless it has been shown to be true."""
        self._deeper = 0.0
        """So much farther it is then [m]."""
        self._range = RangeBias(lidar)
        self.blinded: NDArray[np.bool_] | None = None
        """Beams of the newest sight that see nothing where much stood a sight before, if any."""

    def forget(self) -> None:
        """As if none had come: what the robot knew of its place is void."""
        self._recent.clear()
        self._lately.clear()
        self._leg = self._probe = self._other = None
        self._range.forget()
        self.blinded = None

    def take(self, now: Sight) -> list[Finding]:
        """A sight more."""
        while self._recent and not 0.0 < now.stamp - self._recent[0].stamp < _WINDOW:
            self._recent.popleft()
        found: list[Finding] = []
        self.blinded = None
        if self._recent:
            found += self._look_for(self._recent[-1], now)
            found += self._grown(now)
            found += self._compare(_oldest(self._recent, now), now)
        found += self._late()
        if found:
            self._recent.clear()
            self._lately.clear()
            self.doubted, self._probe = True, None
            self._range.forget()  # it may have begun now
        elif self.doubted:
            found += self._prove(now)
        found += self._long_run(now, clean=not found)
        self._range.take(now, self.doubted)
        if self._range.bias:
            said = f"straight walls look bowed: all ranges seem {self._range.bias:.2f} m too long"
            found.append(slow(CRAWL, said))
        self._recent.append(now)
        if not self._lately or now.stamp - self._lately[-1].stamp >= _APART:
            self._lately.append(now)
        return found

    def _look_for(self, last: Sight, now: Sight) -> list[Finding]:
        """What stood there a scan ago."""
        t, dt = self._t, now.stamp - last.stamp
        slack = 0.05 + 0.1 * math.hypot(*motion(last, now)[:2])
        gone = vanished(last, now, self._lidar, slack)
        longer = max(dt / 0.1, 1.0)
        if gone.empty > t.gone * longer:
            self.blinded = gone.beams
            return [hold(f"{gone.empty:.1f} m of what stood there has vanished from the scan")]
        if gone.width > t.scene * longer:
            self._other, self._deeper = now, gone.deeper
        if gone.width > t.replaced * longer:
            return [hold(f"the scan shows something else over {gone.width:.1f} m, at once")]
        return []

    def _grown(self, now: Sight) -> list[Finding]:
        """Ranges that are all longer than some seconds ago, at once or little by little."""
        if not self._lately:
            return []
        t, before = self._t, _oldest(self._lately, now)
        deeper, surface = farther(before, now, self._lidar)
        if not (deeper > t.longer and surface > t.scene):
            return []
        self._other, self._deeper = now, deeper
        within = now.stamp - before.stamp
        return [hold(f"all walls are {deeper:.2f} m farther than {within:.1f} s ago")]

    def _compare(self, before: Sight, now: Sight) -> list[Finding]:
        """Scan-to-scan motion against odometry's."""
        t, told = self._t, motion(before, now)
        changes = abs(float(now.twist[0] - before.twist[0])) >= _CHANGES
        made = match(before, now, self._lidar, 0.0 if changes else t.surface)
        if made is None:
            return []
        self._add_lag(before, now, made)
        if made.against < max(t.surface, t.majority * made.for_it):
            return []
        way, turn = made.way(_TOLD), abs(float(made.off[2]))
        much = way > t.way + t.share * math.hypot(told[0], told[1])
        much |= turn > t.turn + t.share * abs(float(told[2]))
        if not much:
            return []
        seen = _scans(made.off, told)
        dt = now.stamp - before.stamp
        return [hold(
            f"scans and odometry disagree: in {dt:.1f} s {_said(seen)} against {_said(told)}"
        )]  # fmt: skip

    def _add_lag(self, before: Sight, now: Sight, made: Match) -> None:
        """Scans that are older than their stamps show less of the way while the robot speeds up,
        and more while it slows down: by the lag times the change of its speed."""
        self._lag *= _FORGET
        change = float(now.twist[0] - before.twist[0])
        if abs(change) < _CHANGES or made.told(1.0, 0.0) < _TOLD or abs(float(now.twist[1])) > 0.5:
            return
        faster = 0 if change * float(now.twist[0] + before.twist[0]) > 0.0 else 1
        self._lag[faster] += (change * change, change * float(made.off[0]))

    def _late(self) -> list[Finding]:
        """A lag that shows when the robot speeds up and when it slows down is no push."""
        (up, up_off), (down, down_off) = self._lag.tolist()
        if min(up, down) < _CHANGED:
            return []
        lags = (up_off / up, down_off / down)
        if min(lags) > self._t.lag or max(lags) < -self._t.lag:
            mean = 500.0 * (lags[0] + lags[1])
            which = "older" if mean > 0.0 else "younger"
            return [fault(f"scans are {abs(mean):.0f} ms {which} than odometry, by their stamps")]
        return []

    def _prove(self, now: Sight) -> list[Finding]:
        """After they disagreed: do they agree over some way?"""
        probe = self._probe
        if probe is None or abs(float(now.pose[2] - probe.pose[2])) > 0.7:
            self._probe = now
            return []
        told = motion(probe, now)
        way = math.hypot(told[0], told[1])
        if way < _PROVEN:
            return []
        made = match(probe, now, self._lidar)
        shown = made is not None and made.told(1.0, 0.0) > _TOLD
        if made is not None and shown:
            off = math.hypot(*made.off[:2])
            if off <= _AGREED or made.for_it > made.against:
                self.doubted = self._untried(now)
                self._probe = now
            elif made.against > made.for_it:
                self._probe = None
                return [hold(f"scans and odometry still disagree: {off:.2f} m in {way:.2f} m")]
        if way > _ENDS:  # not to be decided: try anew, unless there is nothing to decide by
            self.doubted = self.doubted and (shown or self._untried(now))
            self._probe = None
        return []

    def _untried(self, now: Sight) -> bool:
        """Whether all that is seen became another, and no wall nor a long way has said since that
        ranges are what they seem: how far things are does not show in how the robot moves."""
        if self._other is None:
            return False
        far = math.hypot(*motion(self._other, now)[:2]) > _AFRESH
        if far or self._range.rules_out(0.5 * self._deeper):
            self._other = None
        return self._other is not None

    def _long_run(self, now: Sight, clean: bool) -> list[Finding]:
        """Scale and direction of the way, over metres."""
        leg = self._leg
        if leg is None or not clean or now.stamp - leg.stamp > _OLD:
            self._leg = now if clean else None
            return self._judged()
        told = motion(leg, now)
        way = math.hypot(told[0], told[1])
        if abs(float(told[2])) > 0.5:
            self._leg = now
        elif way > _LEG:
            self._leg = now
            made = match(leg, now, self._lidar)
            if made is not None:
                self._sample(made, _scans(made.off, told), told, float(told[2]))
        return self._judged()

    def _sample(self, made: Match, seen: Floats, told: Floats, turn: float) -> None:
        ahead = told[:2] / math.hypot(told[0], told[1])
        aside = np.array([-ahead[1], ahead[0]])
        u, w = turned(np.array([ahead, aside]), -turn).tolist()  # in the later body frame
        way = float(told[:2] @ ahead)
        if made.told(*u) > _TOLD:
            self._scales.append(float(seen[:2] @ ahead) / way)
        if made.told(*w) > _TOLD:
            self._angles.append(math.atan2(float(seen[:2] @ aside), way))

    def _judged(self) -> list[Finding]:
        """By the last legs: one that people or corners spoil does not count."""
        t = self._t
        found: list[Finding] = []
        scale = _off([scale - 1.0 for scale in self._scales], t.scale)
        if scale:
            of = f"{100.0 * (1.0 + scale):.0f} %"
            found.append(slow(CRAWL, f"the scans show {of} of the way that odometry says"))
        angle = _off(list(self._angles), t.angle)
        if angle:
            off = f"{math.degrees(angle):.0f} deg"
            found.append(slow(
                CAREFUL, f"the scans show a way {off} beside that of the wheels: "
                "is the LiDAR mounted as described?"
            ))  # fmt: skip
        return found


def _oldest(sights: deque[Sight], now: Sight) -> Sight:
    """That still looks about where this one does."""
    for before in sights:
        if abs(float(now.pose[2] - before.pose[2])) < 0.7:
            return before
    return sights[-1]


def _off(legs: list[float], most: float) -> float:
    """The middle one of the legs, where it is too much, and most of them agree; else 0."""
    if len(legs) < _LEGS:
        return 0.0
    middle = statistics.median(legs)
    agree = sum(leg * math.copysign(1.0, middle) > 0.5 * most for leg in legs)
    return middle if abs(middle) > most and agree >= _AGREE * len(legs) else 0.0


def _scans(off: Floats, told: Floats) -> Floats:
    """The motion that the scans show, in the body frame of the first: with odometry's (t, psi) a
    standing p is foretold at R(-psi) (p - t), and with R(off) and off added it is where it is seen.
    """
    turn = float(told[2] - off[2])
    c, s = math.cos(turn), math.sin(turn)
    return np.array([
        told[0] - c * off[0] + s * off[1], told[1] - s * off[0] - c * off[1], turn,
    ])  # fmt: skip


def _said(motion: Floats) -> str:
    way = math.hypot(motion[0], motion[1])
    return f"{math.copysign(way, motion[0]):.2f} m and {math.degrees(float(motion[2])):.0f} deg"
