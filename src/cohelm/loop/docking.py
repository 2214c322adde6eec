"""Docking and undocking: straight along a dock's approach, slowly, and never for long.

While one of the two goes on the robot is in automatic mode, without route, planner or evasion; the
same guard is on, with the dock's margin for the soft one. It ends by itself, and whatever ends it
leaves the robot in hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.frames import placed
from cohelm.core.types import Floats, Stick, Twist
from cohelm.law.govern import CourseClock
from cohelm.law.reference import through
from cohelm.link.latency_speed_limit import Cap
from cohelm.link.messages import DockPhase as Phase
from cohelm.loop.latency_limit import FREE
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.step import START, Settings
from cohelm.plan.docks import BEFORE, Dock, docked, far, in_corridor, may_begin, nearest, stands_in
from cohelm.robot.collision_monitor.fields import CRAWL
from cohelm.robot.sensors import Lidar

ENDS = 0.01
"""So near to the end of the way, or standing within its tolerance, the robot has arrived [m]."""
LEFT_TO_GO = 0.05
"""Undocked is who is so near to the beginning of the approach [m]."""
STANDS, STANDS_FOR = 0.01, 2.0
"""Who is told to be slower than this [m/s] for so long [s] comes no farther."""
BLOCKED_FOR = 0.15
"""Somebody is in the corridor who has been there for so long: more than one scan [s]."""
BEHIND = 0.3
"""Who stands so far behind the robot is to be in view before it backs out faster than a crawl [m].
"""
PUSHED = 0.1
"""A deflection of more than this is a hand on the stick."""
_GUIDE = 0.25
"""The robot steers at a point of the line no farther ahead than this share of the approach."""


class Ended(NamedTuple):
    """Why docking or undocking is over."""

    why: str
    arrived: bool = False


class Docking:
    """Of one loop. It has its own pilots; the loop says what it is told, and to whom."""

    def __init__(
        self, docks: Sequence[Dock], settings: Settings, delay: float,
        lidars: Sequence[Lidar] = (),
    ) -> None:  # fmt: skip
        """settings, delay: of the pilot that drives elsewhere. lidars: that look; a robot that does
        not look behind backs out at a crawl: somebody may stand there since it came."""
        self.docks, self._lidars = tuple(docks), lidars
        self._unseen = not looks_behind(lidars, settings.outline)
        self._outline = settings.outline
        self._pilots = {
            (i, backwards): _pilot(dock, settings, delay, backwards, self._speed(dock, backwards))
            for i, dock in enumerate(self.docks, 1) for backwards in (False, True)
        }  # fmt: skip
        self.unfit: dict[int, str] = {}
        """Of docks, from 1: why the robot would not fit there with the outline it has by now."""
        self.last = Ended("")
        """How the last one of the two was over."""
        self.number = 0
        """Of the dock, from 1; 0: neither docking nor undocking goes on."""
        self.backwards = False
        """Whether it is undocking."""
        self._begun = self._moved = self._alone = 0.0

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline from now on, (k, 2) [m]."""
        self._unseen, self._outline = not looks_behind(self._lidars, outline), outline
        for (_, backwards), pilot in self._pilots.items():
            pilot.reshape(-outline if backwards else outline)

    @property
    def on(self) -> bool:
        """Whether one of the two goes on."""
        return self.number > 0

    @property
    def doing(self) -> str:
        """What goes on, in words; empty: nothing."""
        if not self.on:
            return ""
        name = self.docks[self.number - 1].name
        return f"undocking from {name}" if self.backwards else f"docking at {name}"

    @property
    def cap(self) -> Cap:
        """On the speed."""
        if not self.on:
            return FREE
        unseen = ", unseen" if self.backwards and self._unseen else ""
        speed = self._speed(self.docks[self.number - 1], self.backwards)
        return Cap(speed, self.doing + unseen)

    def _speed(self, dock: Dock, backwards: bool) -> float:
        return min(dock.speed, CRAWL) if backwards and self._unseen else dock.speed

    @property
    def pilot(self) -> Pilot:
        """That drives it; one of them must go on."""
        return self._pilots[self.number, self.backwards]

    def phase(self, seen: Seen) -> tuple[Phase, int]:
        """How the robot stands to the docks, and to which, from 1."""
        if self.on:
            return (Phase.UNDOCKING if self.backwards else Phase.DOCKING), self.number
        number = 0 if seen.lost else nearest(self.docks, seen.pose)
        if number == 0:
            return Phase.AWAY, 0
        dock = self.docks[number - 1]
        if docked(dock, seen.pose):
            return Phase.DOCKED, number
        staged = dock.off(seen.pose).x < LEFT_TO_GO - dock.approach
        return (Phase.STAGED if staged else Phase.BETWEEN), number

    def refusal(self, number: int, seen: Seen, stick: Stick, backwards: bool) -> str:
        """Why it can not begin; empty: it can. number: of the dock, 0: the one it is at."""
        docks, pose = self.docks, seen.pose
        if not docks:
            return "this site has no dock"
        if number > len(docks):
            return f"there is no dock {number}, only {len(docks)}"
        if seen.lost:
            return "the robot does not know where it is on the map"
        if _pushed(stick):
            return "let go of the stick first"
        if number == 0:
            number = nearest(docks, pose)
        if number == 0 and backwards:
            return "the robot is at no dock"
        if number == 0:
            return "the robot is at no dock's approach: drive it there first"
        dock = docks[number - 1]
        if not backwards and (why := self.unfit.get(number, "")):
            return f"{dock.name}: {why}"
        if not may_begin(dock, pose):
            away = far(dock, pose)
            if away > BEFORE:
                return f"{dock.name}: its approach is {away:.1f} m away"
            return f"{dock.name}: drive onto its approach line first"
        if not backwards and docked(dock, pose):
            return f"it is docked at {dock.name} already"
        if backwards and dock.off(pose).x < LEFT_TO_GO - dock.approach:
            return f"it is at the start of {dock.name}'s approach"
        return ""

    def begin(self, now: float, number: int, seen: Seen, backwards: bool) -> None:
        """From here on. It must not be refused."""
        self.number = number or nearest(self.docks, seen.pose)
        self.backwards = backwards
        dock, pilot = self.docks[self.number - 1], self.pilot
        along = min(max(dock.off(seen.pose).x + dock.approach, 0.0), dock.approach)
        gone = dock.approach - along if backwards else along
        tau = gone / dock.approach * pilot.course.reference.duration
        pilot.state = START._replace(clock=CourseClock(tau, 0.0, 0.0))
        self._begun = self._moved = self._alone = now

    def over(self, ended: Ended) -> None:
        """Nothing goes on any more."""
        self.last, self.number = ended, 0

    def ended(
        self, now: float, seen: Seen, told: Twist, stick: Stick, paused: bool, held: str = ""
    ) -> Ended | None:
        """Why it is over now; None: it goes on. told: what the robot was told last. paused: whether
        it stands for another reason. held: what it is held back for that nothing shows."""
        dock = self.docks[self.number - 1]
        if seen.lost:
            return Ended("lost on the map")
        if _pushed(stick):
            return Ended("the stick was deflected")
        if not self.backwards and (why := self.unfit.get(self.number, "")):
            return Ended(why)
        if not in_corridor(dock, seen.pose):
            _, y, psi = dock.off(seen.pose)
            return Ended(f"off its approach by {abs(y):.2f} m, {math.degrees(abs(psi)):.0f}°")
        if self._somebody(now, dock, seen):
            return Ended("somebody is in its corridor")
        if paused or abs(told.v) > STANDS or abs(told.omega) > STANDS:
            self._moved = now
        arrived = self._arrived(now, dock, seen, held or "held back")
        if arrived is not None:
            return arrived
        within = dock.within * dock.speed / self._speed(dock, self.backwards)
        if now - self._begun > within:
            return Ended(f"not done within {within:g} s")
        return None

    def _somebody(self, now: float, dock: Dock, seen: Seen) -> bool:
        """Whether somebody who moves is in the way, by more than one scan."""
        discs = seen.discs.copy()
        discs[:, :2] = placed(discs[:, :2], seen.map_odom)
        if not stands_in(dock, seen.pose, self._outline, discs, self.backwards):
            self._alone = now
        return now - self._alone > BLOCKED_FOR

    def _arrived(self, now: float, dock: Dock, seen: Seen, held: str) -> Ended | None:
        """Whether it is there, or comes no farther."""
        x, y, psi = dock.off(seen.pose)
        stands = now - self._moved > STANDS_FOR
        if self.backwards:
            to_go = x + dock.approach
            if to_go <= LEFT_TO_GO:
                return Ended(f"{dock.name} is left", True)
            return Ended(f"{held}, {to_go:.2f} m to go") if stands else None
        if docked(dock, seen.pose) and (abs(x) <= ENDS or stands):
            off = f"{100.0 * x:+.1f}, {100.0 * y:+.1f} cm, {math.degrees(psi):+.1f}° off"
            return Ended(f"docked at {dock.name}, {off}", True)
        if stands:
            return Ended(f"{held}, at {100.0 * x:+.0f}, {100.0 * y:+.0f} cm from it")
        return None


def _pushed(stick: Stick) -> bool:
    return not max(abs(stick.x), abs(stick.psi)) <= PUSHED  # nor for NaN


def looks_behind(lidars: Sequence[Lidar], outline: Floats) -> bool:
    """Whether somebody who stands close behind the robot is in view of a LiDAR. outline: (k, 2),
    body frame [m]."""
    rear, side = float(outline[:, 0].min()) - BEHIND, float(np.abs(outline[:, 1]).max())
    return all(any(_looks_at(one, rear, y) for one in lidars) for y in (-side, 0.0, side))


def _looks_at(lidar: Lidar, x: float, y: float) -> bool:
    """Whether a beam goes towards a point of the body frame [m]."""
    dx, dy, psi = x - lidar.mount.x, y - lidar.mount.y, lidar.mount.psi
    after = math.remainder(math.atan2(dy, dx) - psi - lidar.first, 2.0 * math.pi)
    width, most = lidar.step * (len(lidar.beams) - 1), 0.5 * lidar.step
    return -most <= after <= width + most or after + 2.0 * math.pi <= width + most


def _pilot(
    dock: Dock, settings: Settings, delay: float, backwards: bool, speed: float
) -> Pilot:  # fmt: skip
    """Along the approach. For the way back the robot is taken as turned round, see
    `Driver.along`."""
    ends = np.array((dock.staging[:2], dock.pose[:2]), dtype=np.float64)
    s = settings
    rules = s.rules._replace(soft_margin=dock.margin)
    pace = s.pace._replace(guide=min(s.pace.guide, _GUIDE * dock.approach))
    own = s._replace(
        outline=-s.outline if backwards else s.outline, rules=rules, pace=pace,
        gains=s.gains._replace(u_d=speed), evasion=s.evasion._replace(horizon=0.0),
    )  # fmt: skip
    return Pilot(through(ends[::-1] if backwards else ends, speed), own, delay=delay)
