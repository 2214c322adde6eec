"""Computes the command of one period: on the route, shared, or by the stick alone."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from cohelm.core.scalars import wrap
from cohelm.core.types import CENTRED, Desired, Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from cohelm.law.govern import Profile, reversed_twist, turned
from cohelm.law.guard.certify import CLEAR, blocking_obstacle, manoeuvre
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import Reference, through
from cohelm.loop.planning import Planning
from cohelm.loop.speed_caps import NO_CAP, Cap
from cohelm.perceive.pipeline import Seen
from cohelm.pilot.delay_compensation import periods
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.replanning import clock_on_entry
from cohelm.pilot.step import Decision, Settings
from cohelm.plan.course import row_on_route
from cohelm.plan.distance_field import swept_clearances
from cohelm.plan.zones import UNZONED, Zoned, Zones
from cohelm.robot.achievable import achievable
from cohelm.robot.clearance import circumscribed_radius
from cohelm.robot.keep.process import GatedRobot

BY_HAND_YAW_RATE = 1.0
"""At full deflection in manual mode [rad/s]."""
_COMPILING = 180.0  # the first plan may take this long [s]
_TWISTS = ("safe", "tracking", "operator", "nominal", "avoid")
_ROUNDING = 1e-6  # of times that add up, as 0.6 - 0.4 < 0.2 [s]
_MISMATCH_V, _MISMATCH_OMEGA, _MISMATCH_PERIODS = 0.2, 0.4, 8
"""Where measured and commanded twist differ by more for so many periods, the measured counts."""
_NOTHING_DESIRED = Desired(math.nan, math.nan, math.nan, math.nan, math.nan)


def by_hand(gains: Gains) -> Gains:
    """The stick's gains in manual mode."""
    return gains._replace(k_hx=1.0, k_hpsi=BY_HAND_YAW_RATE)


class Driver:
    """A pilot with what it needs. `pilot` None: there is no route to follow."""

    def __init__(
        self, pilot: Pilot | None, settings: Settings, delay: float, planning: Planning | None,
        zones: Zones = UNZONED, plan_period: float = 0.2,
    ) -> None:  # fmt: skip
        """delay: from command to wheels [s]. zones: of the map. plan_period: from one snapshot for
        the planner to the next [s]."""
        self.pilot, self.settings, self._planning = pilot, settings, planning
        self.delay = delay
        """From command to wheels [s]."""
        self.max_speed = math.inf
        """Speed limit of the nominal command [m/s]."""
        self._stick_only = _stick_only(settings, delay)
        self._by_hand = _stick_only(settings._replace(gains=by_hand(settings.gains)), delay)
        dt = settings.rules.dt
        self._delay = periods(delay, dt)[0]
        self._applied: deque[Twist] = deque([Twist(0.0, 0.0)] * (self._delay + 1), self._delay + 1)
        self._twist = self._expected = Twist(0.0, 0.0)
        self._mismatch = 0
        self._planned, self._plan_period = -math.inf, plan_period
        self.zones: Zoned | None = None
        """Keep-out points and speed limits of the zones."""
        if zones:
            self.zones = Zoned(zones, settings.outline, settings.gains.u_d, settings.limits)

    @property
    def arrived(self) -> bool:
        """Whether the route is done."""
        return self.pilot is not None and self.pilot.arrived

    @property
    def planner_gone(self) -> bool:
        """Whether the planner's process has ended."""
        return self._planning is not None and self._planning.broken

    @property
    def planner_late(self) -> bool:
        """Whether plans come too late to be used, for now."""
        return self._planning is not None and self._planning.late

    def update_twist(self, measured: Twist) -> Twist:
        """Estimate the present twist: the commanded one, as long as it agrees with the measured.

        Measurements are late, and their noise would enter every command.
        """
        before, dt = self._expected, self.settings.rules.dt
        off = (
            abs(measured.v - before.v) > _MISMATCH_V
            or abs(measured.omega - before.omega) > _MISMATCH_OMEGA
        )
        self._mismatch = self._mismatch + 1 if off else 0
        self._expected = achievable(self._applied[0], before, self.settings.limits, dt)
        self._twist = self._expected
        if self._mismatch >= _MISMATCH_PERIODS and math.isfinite(measured.v + measured.omega):
            self._twist = measured
        return self._twist

    def record_applied(self, twist: Twist) -> None:
        """Record the twist that was sent in this period."""
        self._applied.append(twist)
        if self.pilot is not None:
            self.pilot.applied(twist)

    def with_zones(self, seen: Seen) -> Seen:
        """With the points of keep-out zones behind those seen, unless the robot is lost."""
        if self.zones is None or seen.lost:
            return seen
        return seen._replace(obstacles=self.zones.beside(seen.obstacles, seen.pose))

    def set_zones(self, zones: Zoned, pose: Pose | None) -> bool:
        """Use other zones, if the robot can still stop clear of them; returns whether it does.
        pose: None for a lost robot."""
        settings = self.settings
        reach = circumscribed_radius(settings.outline)
        zones.reshape(settings.outline)
        if pose is not None:
            m = manoeuvre(pose, self._twist, settings.limits, settings.rules.dt, reach)
            m = m._replace(length=m.length + self.delay)  # the commands under way are driven first
            obstacles = surroundings(points=zones.points(pose))
            margin = settings.rules.hard_margin
            if blocking_obstacle(m, settings.outline, reach, obstacles, margin) != CLEAR:
                return False
        self.zones = zones
        return True

    def reshape(self, outline: Floats) -> None:
        """The robot has another outline from now on, (k, 2) [m]."""
        self.settings = self.settings._replace(outline=outline)
        for pilot in self._pilots():
            pilot.reshape(outline)
        if self.zones is not None:
            self.zones.reshape(outline)

    def speed_zone_cap(self, seen: Seen) -> Cap:
        """The cap of the speed zones that the robot is in; a lost one is in none."""
        return NO_CAP if self.zones is None or seen.lost else Cap(*self.zones.limit(seen.pose))

    def in_keep_out(self, seen: Seen) -> bool:
        """Whether the robot is in a keep-out zone; False for a lost one."""
        return self.zones is not None and not seen.lost and self.zones.inside

    def clearance(self, seen: Seen) -> float:
        """Smallest clearance between the outline and anything seen, without unobserved space and
        zones; infinite where nothing is [m]."""
        outline, here = self.settings.outline, np.array([seen.pose], dtype=np.float64)
        points = seen.obstacles.points[: seen.unobserved.start]
        clearance = float(swept_clearances(points, outline, here)[0])
        for row in seen.obstacles.discs:
            clearance = min(
                clearance, float(swept_clearances(row[None, :2], outline, here)[0]) - float(row[4])
            )
        return max(clearance, 0.0)

    def follow(self, now: float, seen: Seen, stick: Stick) -> Decision:
        """On the route, shared with the stick. There must be a pilot."""
        pilot = self.pilot
        if pilot is None:
            raise ValueError("there is no route to follow")
        if self._planning is not None:
            made = self._planning.plan(now)
            if made is not None:
                pilot.take(made, seen.pose, self._twist)
            if now - self._planned >= self._plan_period - _ROUNDING and self._planning.offer(
                now, pilot.task(seen.pose, self._twist, seen.obstacles, seen.unobserved)
            ):
                self._planned = now
        return self._step(pilot, now, seen, seen.pose, stick)

    def by_hand(self, now: float, seen: Seen, stick: Stick, gently: bool) -> Decision:
        """The stick alone; centred, the robot stands. gently: as strong as beside the controller,
        else so that the whole stick is the whole speed u_d."""
        pilot = self._stick_only if gently else self._by_hand
        d = self._step(pilot, now, seen, seen.pose, stick)
        return d._replace(tau=math.nan, desired=_NOTHING_DESIRED, e_p=math.nan)

    def follow_course(self, pilot: Pilot, now: float, seen: Seen, backwards: bool) -> Decision:
        """Follow another pilot's course, without the stick. backwards: that pilot takes the robot
        as turned by 180°."""
        if not backwards:
            return self._step(pilot, now, seen, seen.pose, CENTRED)
        back = self._step(pilot, now, seen, turned(seen.pose), CENTRED, -1.0)
        twists: dict[str, Any] = {name: reversed_twist(getattr(back, name)) for name in _TWISTS}
        psi, u = wrap(back.desired.psi + math.pi), -back.desired.u
        return back._replace(**twists, desired=back.desired._replace(psi=psi, u=u))

    def _step(
        self, pilot: Pilot, now: float, seen: Seen, pose: Pose, stick: Stick, way: float = 1.0
    ) -> Decision:
        """way: -1 for a pilot that takes the robot as turned by 180°."""
        d = self._delay  # the commands under way, as they were sent
        for j in range(d):
            applied = self._applied[j + 1]
            pilot.sent[(pilot.state.k + j) % d] = (way * applied.v, applied.omega)
        twist = self._twist if way > 0.0 else reversed_twist(self._twist)
        return pilot.step(now, pose, twist, stick, seen.obstacles, self.max_speed, seen.scans)

    def warm_up(self, seen: Seen) -> None:
        """Compile what a period may need; no state changes."""
        seen = self.with_zones(seen)
        pose = seen.pose
        for pilot in self._pilots():
            state, sent = pilot.state, pilot.sent.copy()
            pilot.step(math.nan, pose, Twist(0.0, 0.0), CENTRED, seen.obstacles)
            clock_on_entry(pilot.course, pilot.planner.route, 0, pose, Twist(0.0, 0.0))
            row_on_route(pilot.planner.route.line, pose, 0, pilot.course, 0.0)
            pilot.state = state
            pilot.sent[:] = sent
        self.clearance(seen)
        if self.zones is not None:
            self.set_zones(self.zones, pose)

    def warm_up_planner(self, seen: Seen, gated: GatedRobot) -> None:
        """Make one plan and discard it: before it the planner compiles, which takes long."""
        if self.pilot is None or self._planning is None:
            return
        seen = self.with_zones(seen)
        task = self.pilot.task(seen.pose, Twist(0.0, 0.0), seen.obstacles)
        end = gated.now() + _COMPILING
        self._planning.offer(gated.now(), task)
        while self._planning.busy and not self._planning.broken and gated.now() < end:
            gated.wait(gated.now() + 0.02)
            self._planning.plan(gated.now())  # a plan that compiled is too old to be used
        self._planning.late = False

    def _pilots(self) -> tuple[Pilot, ...]:
        return (self._stick_only, self._by_hand, *((self.pilot,) if self.pilot else ()))

    def drop_route(self) -> None:
        """Follow no route from now on: the one so far was only there to compile with."""
        self.close()
        self.pilot = self._planning = None

    def close(self) -> None:
        """End the planner."""
        if self._planning is not None:
            self._planning.close()


def _stick_only(settings: Settings, delay: float) -> Pilot:
    """A pilot without an automatic part: gains 0, a reference that stands still, no evasion."""
    nothing = settings.gains._replace(k_x=0.0, k_psi=0.0)
    nowhere: Reference = through(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0)
    alone = settings._replace(gains=nothing, evasion=settings.evasion._replace(horizon=0.0))
    pilot = Pilot(nowhere, alone, delay=delay)
    still = Profile(np.zeros_like(pilot.course.paced.rate), pilot.course.paced.duration)
    pilot.course = pilot.course._replace(paced=still)
    return pilot
