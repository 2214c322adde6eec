"""Docking and undocking: straight and slowly along a dock's approach, with a time limit.

Meanwhile the robot is in automatic mode, without route, planner or evasion; the same guard is on,
with the dock's margin as soft margin. It ends by itself, always in hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Floats, Stick, Twist
from cohelm.law.govern import CourseClock
from cohelm.law.reference import through
from cohelm.link.messages import DockPhase as Phase, is_centred
from cohelm.loop.speed_caps import NO_CAP, Cap
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.step import START, Settings
from cohelm.plan.docks import BEFORE, Dock, docked, far, in_corridor, may_begin, nearest, stands_in
from cohelm.robot.collision_monitor.fields import CRAWL
from cohelm.robot.sensors import Lidar

ARRIVED_WITHIN = 0.01
"""So near to the end, or standing within the dock's tolerance, the robot has arrived [m]."""
LEFT_TO_GO = 0.05
"""Undocking ends this near to the beginning of the approach [m]."""
STANDS, STANDS_FOR = 0.01, 2.0
"""A robot commanded slower than this [m/s] for so long [s] is blocked."""
BLOCKED_FOR = 0.15
"""A mover in the corridor for this long ends docking [s]: more than one scan."""
BEHIND = 0.3
"""This far behind the robot must be in view, or it backs out at a crawl [m]."""
_GUIDE = 0.25
"""The look-ahead point is no farther than this share of the approach."""


class Ended(NamedTuple):
    """How docking or undocking ended."""

    why: str
    arrived: bool = False


class Docking:
    """Docking of one loop, with pilots of its own."""

    def __init__(
        self, docks: Sequence[Dock], settings: Settings, delay: float,
        lidars: Sequence[Lidar] = (),
    ) -> None:  # fmt: skip
        """settings, delay: of the route's pilot. lidars: without one that looks behind, the robot
        backs out at a crawl."""
        self.docks, self._lidars = tuple(docks), lidars
        self._unseen = not looks_behind(lidars, settings.outline)
        self._outline = settings.outline
        self._pilots = {
            (i, backwards): _pilot(dock, settings, delay, backwards, self._speed(dock, backwards))
            for i, dock in enumerate(self.docks, 1) for backwards in (False, True)
        }  # fmt: skip
        self.unfit: dict[int, str] = {}
        """By dock, from 1: why the robot does not fit there with its present outline."""
        self.last = Ended("")
        """How the last docking or undocking ended."""
        self.number = 0
        """Of the dock, from 1; 0: neither docking nor undocking is active."""
        self.backwards = False
        """Whether it is undocking."""
        self._began_at = self._moved_at = self._free_at = 0.0

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline from now on, (k, 2) [m]."""
        self._unseen, self._outline = not looks_behind(self._lidars, outline), outline
        for (_, backwards), pilot in self._pilots.items():
            pilot.reshape(-outline if backwards else outline)

    @property
    def on(self) -> bool:
        """Whether docking or undocking is active."""
        return self.number > 0

    @property
    def activity(self) -> str:
        """The activity as text; empty: none."""
        if not self.on:
            return ""
        name = self.docks[self.number - 1].name
        return f"undocking from {name}" if self.backwards else f"docking at {name}"

    @property
    def cap(self) -> Cap:
        """The speed cap."""
        if not self.on:
            return NO_CAP
        unseen = ", unseen" if self.backwards and self._unseen else ""
        speed = self._speed(self.docks[self.number - 1], self.backwards)
        return Cap(speed, self.activity + unseen)

    def _speed(self, dock: Dock, backwards: bool) -> float:
        return min(dock.speed, CRAWL) if backwards and self._unseen else dock.speed

    @property
    def pilot(self) -> Pilot:
        """The pilot of the active docking or undocking."""
        return self._pilots[self.number, self.backwards]

    def phase(self, seen: Seen) -> tuple[Phase, int]:
        """The robot's phase, and at which dock, from 1."""
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
        """Why it can not begin; empty: it can. number: of the dock; 0: the one it is at."""
        docks, pose = self.docks, seen.pose
        if not docks:
            return "this site has no dock"
        if number > len(docks):
            return f"there is no dock {number}, only {len(docks)}"
        if seen.lost:
            return "the robot is not localized on the map"
        if not is_centred(stick):
            return "release the stick first"
        if number == 0:
            number = nearest(docks, pose)
        if number == 0 and backwards:
            return "the robot is not at a dock"
        if number == 0:
            return "the robot is not at a dock's approach: drive it there first"
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
        """Begin; it must not be refused."""
        self.number = number or nearest(self.docks, seen.pose)
        self.backwards = backwards
        dock, pilot = self.docks[self.number - 1], self.pilot
        along = min(max(dock.off(seen.pose).x + dock.approach, 0.0), dock.approach)
        gone = dock.approach - along if backwards else along
        tau = gone / dock.approach * pilot.course.reference.duration
        pilot.state = START._replace(clock=CourseClock(tau, 0.0, 0.0))
        self._began_at = self._moved_at = self._free_at = now

    def finish(self, ended: Ended) -> None:
        """End it."""
        self.last, self.number = ended, 0

    def ended(
        self, now: float, seen: Seen, applied: Twist, stick: Stick, paused: bool, held: str = ""
    ) -> Ended | None:
        """How it ends now; None: it continues. applied: the last command. paused: the robot stands
        for another reason. held: why the guard holds it back for nothing visible."""
        dock = self.docks[self.number - 1]
        if seen.lost:
            return Ended("lost on the map")
        if not is_centred(stick):
            return Ended("the stick was deflected")
        if not self.backwards and (why := self.unfit.get(self.number, "")):
            return Ended(why)
        if not in_corridor(dock, seen.pose):
            _, y, psi = dock.off(seen.pose)
            return Ended(f"off its approach by {abs(y):.2f} m, {math.degrees(abs(psi)):.0f}°")
        if self._blocked(now, dock, seen):
            return Ended("its corridor is occupied")
        if paused or abs(applied.v) > STANDS or abs(applied.omega) > STANDS:
            self._moved_at = now
        arrived = self._arrived(now, dock, seen, held or "blocked")
        if arrived is not None:
            return arrived
        within = dock.within * dock.speed / self._speed(dock, self.backwards)
        if now - self._began_at > within:
            return Ended(f"not done within {within:g} s")
        return None

    def _blocked(self, now: float, dock: Dock, seen: Seen) -> bool:
        """Whether a mover is in the corridor, by more than one scan."""
        if not stands_in(dock, seen.pose, self._outline, seen.movers, self.backwards):
            self._free_at = now
        return now - self._free_at > BLOCKED_FOR

    def _arrived(self, now: float, dock: Dock, seen: Seen, held: str) -> Ended | None:
        x, y, psi = dock.off(seen.pose)
        stands = now - self._moved_at > STANDS_FOR
        if self.backwards:
            to_go = x + dock.approach
            if to_go <= LEFT_TO_GO:
                return Ended(f"{dock.name} is left", True)
            return Ended(f"{held}, {to_go:.2f} m to go") if stands else None
        if docked(dock, seen.pose) and (abs(x) <= ARRIVED_WITHIN or stands):
            off = f"{100.0 * x:+.1f}, {100.0 * y:+.1f} cm, {math.degrees(psi):+.1f}° off"
            return Ended(f"docked at {dock.name}, {off}", True)
        if stands:
            return Ended(f"{held}, at {100.0 * x:+.0f}, {100.0 * y:+.0f} cm from it")
        return None


def looks_behind(lidars: Sequence[Lidar], outline: Floats) -> bool:
    """Whether the LiDARs see close behind the robot. outline: (k, 2), body frame [m]."""
    rear, side = float(outline[:, 0].min()) - BEHIND, float(np.abs(outline[:, 1]).max())
    return all(any(_looks_at(one, rear, y) for one in lidars) for y in (-side, 0.0, side))


def _looks_at(lidar: Lidar, x: float, y: float) -> bool:
    """Whether a beam goes towards a point of the body frame [m]."""
    dx, dy, psi = x - lidar.mount.x, y - lidar.mount.y, lidar.mount.psi
    after = math.remainder(math.atan2(dy, dx) - psi - lidar.first, 2.0 * math.pi)
    width, most = lidar.step * (len(lidar.beams) - 1), 0.5 * lidar.step
    return -most <= after <= width + most or after + 2.0 * math.pi <= width + most


def _pilot(dock: Dock, settings: Settings, delay: float, backwards: bool, speed: float) -> Pilot:
    """A pilot along the approach. For undocking the robot is taken as turned by 180°, see
    `Driver.follow_course`."""
    ends = np.array((dock.staging[:2], dock.pose[:2]), dtype=np.float64)
    s = settings
    rules = s.rules._replace(soft_margin=dock.margin)
    pace = s.pace._replace(guide=min(s.pace.guide, _GUIDE * dock.approach))
    own = s._replace(
        outline=-s.outline if backwards else s.outline, rules=rules, pace=pace,
        gains=s.gains._replace(u_d=speed), evasion=s.evasion._replace(horizon=0.0),
    )  # fmt: skip
    return Pilot(through(ends[::-1] if backwards else ends, speed), own, delay=delay)
