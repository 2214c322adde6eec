"""The command of one period: on the route with the operator, or by the operator alone."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cohelm.core.frames import placed
from cohelm.core.scalars import wrap
from cohelm.core.types import CENTRED, Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import Profile, reversed_twist, turned
from cohelm.law.guard.certify import CLEAR, in_the_way, manoeuvre
from cohelm.law.guard.step import farthest
from cohelm.law.guard.surroundings import Surroundings, surroundings
from cohelm.law.reference import Reference, through
from cohelm.link.latency_speed_limit import Cap
from cohelm.loop.latency_limit import FREE
from cohelm.loop.planning import Planning
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.delay_compensation import periods
from cohelm.pilot.obstacles_from_perception import obstacles_from_perception
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.replanning import apart, entered
from cohelm.pilot.step import Decision, Settings
from cohelm.plan.distance_field import swept
from cohelm.plan.zones import Zoned, Zones
from cohelm.robot.achievable import achievable
from cohelm.robot.keep.gated_robot import GatedRobot

BY_HAND_YAW_RATE = 1.0
"""Of the whole stick, where it alone drives [rad/s]."""
_NOTHING: Floats = np.empty((0, 2))
_COMPILING = 180.0  # the first plan may take this long [s]
_EVERY = 0.2  # from one snapshot for the planner to the next [s]
_SPEEDS = ("safe", "tracking", "operator", "nominal", "avoid")
_ROUNDING = 1e-6  # of times that add up, as 0.6 - 0.4 < 0.2 [s]
_OFF_V, _OFF_OMEGA, _OFF_FOR = 0.2, 0.4, 8
"""When the wheels do so much else than they were told, for so many periods, they are believed."""


def by_hand(gains: Gains) -> Gains:
    """Those of the stick where it alone drives."""
    return gains._replace(k_hx=1.0, k_hpsi=BY_HAND_YAW_RATE)


class Driver:
    """A pilot with what it needs around it. `pilot` None: there is no route to follow."""

    def __init__(
        self, pilot: Pilot | None, settings: Settings, delay: float, planning: Planning | None,
        zones: Zones | None = None,
    ) -> None:  # fmt: skip
        """delay: from command to wheels [s]. zones: of the map, beside what is seen."""
        self.pilot, self.settings, self._planning = pilot, settings, planning
        self.delay = delay
        """From command to wheels [s]."""
        self.fastest = math.inf
        """What is asked for is slowed down to this [m/s]."""
        self._alone = _alone(settings, delay)
        self._by_hand = _alone(settings._replace(gains=by_hand(settings.gains)), delay)
        dt = settings.rules.dt
        self._delay = periods(delay, dt)[0]
        self._given: deque[Twist] = deque([Twist(0.0, 0.0)] * (self._delay + 1), self._delay + 1)
        self._twist = Twist(0.0, 0.0)
        self._off = 0
        self._planned = -math.inf
        self._map: tuple[Floats, Pose | None] = (np.empty((0, 2)), None)
        self._points: Floats = np.empty((0, 2))
        self.zones = None if zones is None else Zoned(zones, settings.outline, settings.gains.u_d)
        """What those ask of the robot."""
        self._zoned = self._points
        self._joined = self._points
        self._blind = 0

    @property
    def arrived(self) -> bool:
        """Whether the route is done."""
        return self.pilot is not None and self.pilot.arrived

    @property
    def stuck(self) -> bool:
        """Whether nothing plans a way round any more."""
        return self._planning is not None and self._planning.broken

    @property
    def planless(self) -> bool:
        """Whether plans come too late to be used, for now."""
        return self._planning is not None and self._planning.late

    def moved(self, measured: Twist) -> Twist:
        """What the robot does now: what it was told, as long as that is about what is measured.

        Wheels measure with noise that would go into every command; and late.
        """
        before, dt = self._twist, self.settings.rules.dt
        off = abs(measured.v - before.v) > _OFF_V or abs(measured.omega - before.omega) > _OFF_OMEGA
        self._off = self._off + 1 if off else 0
        self._twist = achievable(self._given[0], before, self.settings.limits, dt)
        if self._off >= _OFF_FOR and math.isfinite(measured.v + measured.omega):
            self._twist = measured
        return self._twist

    def given(self, twist: Twist) -> None:
        """What the robot was told in this period."""
        self._given.append(twist)
        if self.pilot is not None:
            self.pilot.applied(twist)

    def around(self, seen: Seen) -> Surroundings:
        """What is seen, in the map's frame as the pose has it now: pose and things in it jump
        together when the robot finds itself elsewhere on the map, and nothing comes nearer. Behind
        its points stand those of the keep-out zones, unless the robot is lost."""
        self._blind = seen.blind
        key = (seen.points, seen.map_odom)
        if key[0] is not self._map[0] or key[1] != self._map[1]:
            self._map, self._points = key, placed(seen.points, seen.map_odom)
            self._joined = self._points
        if self.zones is None:
            return obstacles_from_perception(seen, seen.map_odom, self._points)
        zoned = _NOTHING if seen.lost else self.zones.points(seen.pose)
        if zoned is not self._zoned or len(self._joined) != len(self._points) + len(zoned):
            self._zoned, self._joined = zoned, np.vstack((self._points, zoned))
        return obstacles_from_perception(seen, seen.map_odom, self._joined)

    def _apart(self, around: Surroundings) -> tuple[Surroundings, Floats]:
        """The obstacles, and apart from them the ground that nothing has seen."""
        end = len(self._points)
        return apart(around, end - self._blind, end)

    def rezone(self, zones: Zoned, pose: Pose | None) -> bool:
        """Take up other zones, if the robot, as it moves now, can still stop clear of them; whether
        it has. pose: None for a robot that is lost."""
        settings = self.settings
        reach = farthest(settings.outline)
        zones.reshape(settings.outline)
        if pose is not None:
            m = manoeuvre(pose, self._twist, settings.limits, settings.rules.dt, reach)
            m = m._replace(length=m.length + self.delay)  # what is under way is driven first
            around = surroundings(points=zones.points(pose))
            margin = settings.rules.hard_margin
            if in_the_way(m, settings.outline, reach, around, margin) != CLEAR:
                return False
        self.zones = zones
        return True

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline from now on, (k, 2) [m]."""
        self.settings = self.settings._replace(outline=outline)
        for pilot in (self._alone, self._by_hand, *((self.pilot,) if self.pilot else ())):
            pilot.reshape(outline)
        if self.zones is not None:
            self.zones.reshape(outline)

    def slowed(self, seen: Seen) -> Cap:
        """How fast the speed zones that the robot is on let it go; a lost one is on none."""
        return FREE if self.zones is None or seen.lost else Cap(*self.zones.limit(seen.pose))

    def kept_in(self, seen: Seen) -> bool:
        """Whether the robot is in a keep-out zone, as far as is known."""
        return self.zones is not None and not seen.lost and self.zones.inside

    def clear(self, pose: Pose, around: Surroundings, blind: int) -> float:
        """Smallest gap between the outline and anything seen; infinite where nothing is [m].

        blind: how many of the points seen, at their end, are only ground that may hold anything.
        """
        outline, here = self.settings.outline, np.array([pose], dtype=np.float64)
        seen = around.points[: len(around.points) - len(self._zoned) - blind]
        gap = float(swept(seen, outline, here)[0])
        for row in around.discs:
            gap = min(gap, float(swept(row[None, :2], outline, here)[0]) - float(row[4]))
        return max(gap, 0.0)

    def follow(self, now: float, pose: Pose, stick: Stick, around: Surroundings) -> Decision:
        """On the route, shared with the stick. There must be a pilot."""
        pilot = self.pilot
        if pilot is None:
            raise ValueError("there is no route to follow")
        if self._planning is not None:
            made = self._planning.plan(now)
            if made is not None:
                pilot.take(made, pose, self._twist)
            if now - self._planned >= _EVERY - _ROUNDING and self._planning.offer(
                now, pilot.task(pose, self._twist, *self._apart(around))
            ):
                self._planned = now
        return self._step(pilot, now, pose, stick, around)

    def by_hand(
        self, now: float, pose: Pose, stick: Stick, around: Surroundings, gently: bool
    ) -> Decision:
        """The stick alone; centred, the robot stands. gently: as strong as beside the controller,
        else so that the whole stick is the whole speed u_d."""
        return self._step(self._alone if gently else self._by_hand, now, pose, stick, around)

    def along(
        self, pilot: Pilot, now: float, pose: Pose, around: Surroundings, backwards: bool
    ) -> Decision:
        """On the course of another pilot, alone. backwards: that one's robot is this one, taken as
        turned round."""
        if not backwards:
            return self._step(pilot, now, pose, CENTRED, around)
        back = self._step(pilot, now, turned(pose), CENTRED, around, -1.0)
        speeds = {f"{name}_v": -getattr(back, f"{name}_v") for name in _SPEEDS}
        return back._replace(**speeds, psi_d=wrap(back.psi_d + math.pi), u_d=-back.u_d)

    def _step(
        self, pilot: Pilot, now: float, pose: Pose, stick: Stick, around: Surroundings,
        way: float = 1.0,
    ) -> Decision:  # fmt: skip
        """way: -1 for a pilot that takes the robot as turned round."""
        d = self._delay  # the commands under way, as the robot got them, where this pilot has them
        for j in range(d):
            given = self._given[j + 1]
            pilot.sent[(pilot.state.k + j) % d] = (way * given.v, given.omega)
        twist = self._twist if way > 0.0 else reversed_twist(self._twist)
        return pilot.step(now, pose, twist, stick, around, self.fastest)

    def rehearse(self, pose: Pose, around: Surroundings) -> None:
        """Compile what a period may need; changes nothing."""
        pilots = (self._alone, self._by_hand, *((self.pilot,) if self.pilot else ()))
        for pilot in pilots:
            state, sent = pilot.state, pilot.sent.copy()
            pilot.step(math.nan, pose, Twist(0.0, 0.0), CENTRED, around)
            entered(pilot.course, pilot.planner.route, 0, pose, Twist(0.0, 0.0))
            pilot.state = state
            pilot.sent[:] = sent
        self.clear(pose, around, 0)
        if self.zones is not None:
            self.rezone(self.zones, pose)

    def rehearse_plan(self, seen: Seen, gated: GatedRobot) -> None:
        """Have one plan made, and thrown away: what plans compiles too, and takes long over it."""
        if self.pilot is None or self._planning is None:
            return
        task = self.pilot.task(seen.pose, Twist(0.0, 0.0), self.around(seen))
        end = gated.now() + _COMPILING
        self._planning.offer(gated.now(), task)
        while self._planning.busy and not self._planning.broken and gated.now() < end:
            gated.wait(gated.now() + 0.02)
            self._planning.plan(gated.now())  # what compiled for long is too old to be used
        self._planning.late = False

    def close(self) -> None:
        """End what plans."""
        if self._planning is not None:
            self._planning.close()


def _alone(settings: Settings, delay: float) -> Pilot:
    """A pilot whose automatic part wants nothing: gains 0, a reference that stands still, and it
    steps out of nobody's way."""
    nothing = settings.gains._replace(k_x=0.0, k_psi=0.0)
    nowhere: Reference = through(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0)
    alone = settings._replace(gains=nothing, evasion=settings.evasion._replace(horizon=0.0))
    pilot = Pilot(nowhere, alone, delay=delay)
    still = Profile(np.zeros_like(pilot.course.paced.rate), pilot.course.paced.duration)
    pilot.course = pilot.course._replace(paced=still)
    return pilot
