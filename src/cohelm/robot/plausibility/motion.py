"""Compares scan-to-scan motion with odometry: now, and over the last metres."""

from __future__ import annotations

import math
import statistics
from collections import deque

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

# Largest differences between scans and odometry.

_WAY = 0.05
"""Over `_WINDOW` [m]: a tenth of a second at half a metre a second."""
_TURN = math.radians(2.5)
"""[rad]; at two metres, a thumb's breadth more than the noise of a range."""
_SHARE = 0.1
"""... plus this share of the motion: wheels measure a few per cent wrongly, and slip."""
_SURFACE = 0.4
"""Surface, square to the beams, needed to contradict odometry [m]; straight for half a metre:
a person has none."""
_MAJORITY = 2.0
"""... and this many times the surface that supports it."""
_GONE = 0.7
"""Surface that vanishes from one scan to the next into nothing, in one piece [m]: wider than a
person; and a person running at 2.5 m/s uncovers 0.25 m in a tenth of a second."""
_REPLACED = 0.9
"""Surface that vanishes and shows what is behind [m]: a person steps aside."""
_SCENE = 2.0
"""More surface than a person or a door uncovers from one scan to the next, in one piece [m]:
the scene is another, so the robot was moved, or its LiDAR measures other ranges than before."""
_LONGER = 0.12
"""Increase of all ranges at once that can not be [m]: the least bias of `bow.py`."""
_LAG = 0.1
"""Error of the scans' stamps [s]: 2 cm when Sally brakes from 0.2 m/s."""
_SCALE = 0.1
"""Relative error of odometry's way, over metres."""
_ANGLE = math.radians(3.0)
"""Angle between the way by the scans and by the wheels [rad]: the mount."""
_WINDOW = 0.65  # time over which motion is compared [s]
_LONG_WINDOW, _APART = 4.0, 0.5  # time over which ranges are compared, and between its sights [s]
_FORGET = 0.995  # decay of the lag sums at each scan: half after 14 s
_CHANGES = 0.1  # a change of speed that shows one [m/s]
_CHANGED = 0.05  # changes of speed, squared and added up, before a lag is judged [m^2/s^2]
_PROVEN = 0.12  # way over which odometry and scans have to agree after a disagreement [m]
_AGREED = 0.04  # ... within this [m]
_NEW_SCENE = 2.0  # way without a visible bow after which a changed scene is accepted [m]
_GIVE_UP = 0.5  # way after which this check is given up: the scans do not show the motion [m]
_DISAGREED = "a disagreement of scans and odometry"
_LEG = 0.3  # length of a sample of the long run [m]
_LEGS, _KEPT = 8, 10  # legs before the way is judged, and legs kept
_OPPOSED = 0.25  # largest ratio of the sum of two turns, one the other way, to their difference
_AGREE = 0.8  # share of the legs with at least half the error
_SEEN = 10.0  # information about a direction before it is judged, in points
_OLD = 3.0  # longest time of a leg [s]


class Motion:
    """Checks the motion that sights show, in order, against odometry."""

    def __init__(self, lidar: Lidar) -> None:
        self._lidar = lidar
        self._recent: deque[Sight] = deque()
        self._spaced: deque[Sight] = deque(maxlen=round(_LONG_WINDOW / _APART))
        self._leg: Sight | None = None
        self._scales: deque[float] = deque(maxlen=_KEPT)  # scans' way ahead over odometry's
        self._angles: deque[float] = deque(maxlen=_KEPT)  # of the scans' way to odometry's [rad]
        self._lag = np.zeros((2, 2))  # speeding up, slowing down: change^2, change * error
        self.doubted = False
        """Whether scans and odometry have disagreed, and not agreed over some way since."""
        self.cause = ""
        """After what they are doubted: a noun, for a sentence."""
        self._probe: Sight | None = None
        self._other: Sight | None = None
        """The first sight of a changed scene, until its ranges are confirmed."""
        self._deeper = 0.0
        """By how much the changed scene is farther away [m]."""
        self._range = RangeBias(lidar)
        self.blinded: NDArray[np.bool_] | None = None
        """Beams of the newest sight that see nothing where a surface was a sight before, if any."""

    def forget(self) -> None:
        """Reset: as if no sight had been taken."""
        self._recent.clear()
        self._spaced.clear()
        self._leg = self._probe = self._other = None
        self._range.forget()
        self.blinded = None

    def take(self, now: Sight) -> list[Finding]:
        """Check the next sight."""
        while self._recent and not 0.0 < now.stamp - self._recent[0].stamp < _WINDOW:
            self._recent.popleft()
        found: list[Finding] = []
        self.blinded = None
        cause = ""
        if self._recent:
            found += self._look_for(self._recent[-1], now)
            found += self._grown(now)
            cause = "a sudden change of the scan" if found else ""
            found += self._compare(_oldest(self._recent, now), now)
        found += self._late()
        if found:
            self.cause = cause or _DISAGREED
            self._recent.clear()
            self._spaced.clear()
            self.doubted, self._probe = True, None
            self._range.forget()  # it may have begun now
        elif self.doubted:
            found += self._prove(now)
        found += self._long_run(now, clean=not found)
        self._range.take(now, self.doubted)
        if self._range.bias:
            text = f"straight walls look bowed: all ranges seem {self._range.bias:.2f} m too long"
            found.append(slow(CRAWL, text))
        self._recent.append(now)
        if not self._spaced or now.stamp - self._spaced[-1].stamp >= _APART:
            self._spaced.append(now)
        return found

    def _look_for(self, last: Sight, now: Sight) -> list[Finding]:
        """Surfaces of the last scan that have vanished."""
        dt = now.stamp - last.stamp
        slack = 0.05 + 0.1 * math.hypot(*motion(last, now)[:2])
        gone = vanished(last, now, self._lidar, slack)
        longer = max(dt / 0.1, 1.0)
        if gone.empty > _GONE * longer:
            self.blinded = gone.beams
            return [hold(f"{gone.empty:.1f} m of what stood there has vanished from the scan")]
        if gone.width > _SCENE * longer:
            self._other, self._deeper = now, gone.deeper
        if gone.width > _REPLACED * longer:
            return [hold(f"the scan shows something else over {gone.width:.1f} m, at once")]
        return []

    def _grown(self, now: Sight) -> list[Finding]:
        """Ranges that are all longer than some seconds ago, by a jump or a drift."""
        if not self._spaced:
            return []
        before = _oldest(self._spaced, now)
        deeper, surface = farther(before, now, self._lidar)
        if not (deeper > _LONGER and surface > _SCENE):
            return []
        self._other, self._deeper = now, deeper
        within = now.stamp - before.stamp
        return [hold(f"all walls are {deeper:.2f} m farther than {within:.1f} s ago")]

    def _compare(self, before: Sight, now: Sight) -> list[Finding]:
        """Scan-to-scan motion against odometry's."""
        odom = motion(before, now)
        changes = abs(float(now.twist[0] - before.twist[0])) >= _CHANGES
        made = match(before, now, self._lidar, 0.0 if changes else _SURFACE)
        if made is None:
            return []
        self._add_lag(before, now, made)
        if made.against < max(_SURFACE, _MAJORITY * made.for_it):
            return []
        way, turn = made.way(_SEEN), abs(float(made.correction[2]))
        much = way > _WAY + _SHARE * math.hypot(odom[0], odom[1])
        much |= turn > _TURN + _SHARE * abs(float(odom[2]))
        if not much:
            return []
        scans = _scan_motion(made.correction, odom)
        text = f"in {now.stamp - before.stamp:.1f} s {_text(scans)} against {_text(odom)}"
        if abs(scans[2] + odom[2]) < _OPPOSED * abs(scans[2] - odom[2]):
            text += ": one of them takes left for right"
        return [hold(f"scans and odometry disagree: {text}")]

    def _add_lag(self, before: Sight, now: Sight, made: Match) -> None:
        """Scans that are older than their stamps show less of the way while the robot speeds up,
        and more while it slows down: by the lag times the change of its speed."""
        self._lag *= _FORGET
        change = float(now.twist[0] - before.twist[0])
        if abs(change) < _CHANGES or made.seen(1.0, 0.0) < _SEEN or abs(float(now.twist[1])) > 0.5:
            return
        faster = 0 if change * float(now.twist[0] + before.twist[0]) > 0.0 else 1
        self._lag[faster] += (change * change, change * float(made.correction[0]))

    def _late(self) -> list[Finding]:
        """A lag while speeding up and while slowing down; a push shows only in one of them."""
        (up, up_sum), (down, down_sum) = self._lag.tolist()
        if min(up, down) < _CHANGED:
            return []
        lags = (up_sum / up, down_sum / down)
        if min(lags) > _LAG or max(lags) < -_LAG:
            mean = 500.0 * (lags[0] + lags[1])
            which = "older" if mean > 0.0 else "younger"
            return [fault(f"scans are {abs(mean):.0f} ms {which} than odometry, by their stamps")]
        return []

    def _prove(self, now: Sight) -> list[Finding]:
        """After a disagreement: whether scans and odometry agree over some way."""
        probe = self._probe
        if probe is None or abs(float(now.pose[2] - probe.pose[2])) > 0.7:
            self._probe = now
            return []
        odom = motion(probe, now)
        way = math.hypot(odom[0], odom[1])
        if way < _PROVEN:
            return []
        made = match(probe, now, self._lidar)
        shown = made is not None and made.seen(1.0, 0.0) > _SEEN
        if made is not None and shown:
            error = math.hypot(*made.correction[:2])
            if error <= _AGREED or made.for_it > made.against:
                self.doubted = self._unproven(now)
                self._probe = now
            elif made.against > made.for_it:
                self._probe, self.cause = None, _DISAGREED
                return [hold(f"scans and odometry still disagree: {error:.2f} m in {way:.2f} m")]
        if way > _GIVE_UP:  # not to be decided: try anew, unless there is nothing to decide by
            self.doubted = self.doubted and (shown or self._unproven(now))
            self._probe = None
        return []

    @property
    def to_go(self) -> float:
        """The way over which they have to agree, at most [m]."""
        return _GIVE_UP if self._other is None else _NEW_SCENE

    def _unproven(self, now: Sight) -> bool:
        """Whether the scene changed, and neither walls nor a long way have since confirmed the
        ranges: a range bias does not show in the robot's motion."""
        if self._other is None:
            return False
        beyond = math.hypot(*motion(self._other, now)[:2]) > _NEW_SCENE
        if beyond or self._range.rules_out(0.5 * self._deeper):
            self._other = None
        return self._other is not None

    def _long_run(self, now: Sight, clean: bool) -> list[Finding]:
        """Scale and direction of odometry's way, over metres."""
        leg = self._leg
        if leg is None or not clean or now.stamp - leg.stamp > _OLD:
            self._leg = now if clean else None
            return self._judged()
        odom = motion(leg, now)
        way = math.hypot(odom[0], odom[1])
        if abs(float(odom[2])) > 0.5:
            self._leg = now
        elif way > _LEG:
            self._leg = now
            made = match(leg, now, self._lidar)
            if made is not None:
                self._sample(made, _scan_motion(made.correction, odom), odom, float(odom[2]))
        return self._judged()

    def _sample(self, made: Match, scans: Floats, odom: Floats, turn: float) -> None:
        ahead = odom[:2] / math.hypot(odom[0], odom[1])
        aside = np.array([-ahead[1], ahead[0]])
        u, w = turned(np.array([ahead, aside]), -turn).tolist()  # in the later body frame
        way = float(odom[:2] @ ahead)
        if made.seen(*u) > _SEEN:
            self._scales.append(float(scans[:2] @ ahead) / way)
        if made.seen(*w) > _SEEN:
            self._angles.append(math.atan2(float(scans[:2] @ aside), way))

    def _judged(self) -> list[Finding]:
        """By the median of the last legs: one that people or corners spoil does not count."""
        found: list[Finding] = []
        scale = _excess([scale - 1.0 for scale in self._scales], _SCALE)
        if scale:
            of = f"{100.0 * (1.0 + scale):.0f} %"
            found.append(slow(CRAWL, f"the scans show {of} of the way that odometry says"))
        angle = _excess(list(self._angles), _ANGLE)
        if angle:
            error = f"{math.degrees(angle):.0f} deg"
            found.append(slow(
                CAREFUL, f"the scans show a way {error} beside that of the wheels: "
                "is the LiDAR mounted as described?"
            ))  # fmt: skip
        return found


def _oldest(sights: deque[Sight], now: Sight) -> Sight:
    """The oldest sight with about the same heading as this one."""
    for before in sights:
        if abs(float(now.pose[2] - before.pose[2])) < 0.7:
            return before
    return sights[-1]


def _excess(legs: list[float], most: float) -> float:
    """The median of the legs, where it exceeds `most`, and most of them agree; else 0."""
    if len(legs) < _LEGS:
        return 0.0
    middle = statistics.median(legs)
    agree = sum(leg * math.copysign(1.0, middle) > 0.5 * most for leg in legs)
    return middle if abs(middle) > most and agree >= _AGREE * len(legs) else 0.0


def _scan_motion(error: Floats, odom: Floats) -> Floats:
    """The motion that the scans show, in the body frame of the first: with odometry's (t, psi) a
    resting p is predicted at R(-psi) (p - t), and the correction takes it to where it is seen.
    """
    turn = float(odom[2] - error[2])
    c, s = math.cos(turn), math.sin(turn)
    return np.array([
        odom[0] - c * error[0] + s * error[1], odom[1] - s * error[0] - c * error[1], turn,
    ])  # fmt: skip


def _text(motion: Floats) -> str:
    way = math.hypot(motion[0], motion[1])
    return f"{math.copysign(way, motion[0]):.2f} m and {math.degrees(float(motion[2])):.0f} deg"
