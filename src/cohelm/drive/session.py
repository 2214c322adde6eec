"""A drive from start to end: starts robot, loop, planner, recorder and live view, and ends them."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cohelm.drive.factory import RobotFactory
from cohelm.drive.jobs import in_thread
from cohelm.drive.outline_check import OutlineCheck
from cohelm.drive.pictures import Packed, Pictures
from cohelm.drive.recorder import EventSink, Recording
from cohelm.drive.shown import map_message, recordable, reference_lines, zone_messages
from cohelm.law.reference import Reference
from cohelm.law.verdict import Verdict
from cohelm.link.bulk_messages import ZoneMap
from cohelm.link.messages import Mode
from cohelm.link.operator import NullOperator, Operator
from cohelm.loop.docking import Ended
from cohelm.loop.driver import Driver
from cohelm.loop.loop import Loop, LoopParams
from cohelm.loop.planning import InProcessPlanner, RemotePlanner
from cohelm.loop.timing import Timing
from cohelm.perceive.localize.localization_map import LocalizationMap
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.perceive.pipeline import Perception, Seen, warm_up
from cohelm.pilot.margin_inflation import SLOP, inflated, inflated_rules, noise
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.planner_warm_up import warm_up_planner
from cohelm.pilot.step import Decision
from cohelm.plan.docks import Dock
from cohelm.plan.zones import UNZONED, Zones
from cohelm.robot.gate.modes import GateMode, driving, latched
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules, standing
from cohelm.robot.keep.priority import raise_priority, raise_thread_priorities, restore_priority
from cohelm.robot.keep.process import GatedRobot, RemoteGatedRobot
from cohelm.robot.keep.record_pipe import RecordLine
from cohelm.robot.limits import checked_braking
from cohelm.robot.model import checked_sight
from cohelm.robot.port import Encoded, Frame
from cohelm.scenario.docks import checked
from cohelm.scenario.load import dump
from cohelm.scenario.zones import check

if TYPE_CHECKING:
    from cohelm.drive.live import Live, LiveConfig

_BRAKING = 3.0  # time to come to a standstill; then it is left to the gate process [s]
SIMULATED_TIME = "simulated time"
"""The scheduling of a session in simulated time."""
_READY = 10.0  # the robot's sensors must deliver within this [s]
_CRAWL, _A_WHILE = 0.1, 2.0  # slower for longer is told, where it would drive on [m/s, s]


Camera = Callable[[float], Frame | Encoded | None]


@dataclass(frozen=True)
class SessionConfig:
    """Configuration of a session."""

    robot: RobotFactory
    """Makes the robot; its scenario is the site: map, route, law."""
    rate: float = 50.0
    """Periods a second, 10 to 500."""
    record: Path | None = None
    live: LiveConfig | None = None
    """The live view."""
    known: LocalizationMap | None = None
    """The map to localise on; by default the scenario's walls."""
    localise: bool = True
    """Otherwise, or without map and walls, the robot uses its odometry."""
    zones: Zones = UNZONED
    """Keep-out and speed zones on that map; of each kind by default the scenario's."""
    loop: LoopParams = field(default_factory=LoopParams)
    watchdog: float = 0.1
    """Maximum lateness of the loop before the robot stops [s]."""
    pictures: float = 5.0
    """Rate of recorded or shown pictures; 0: none [Hz]."""
    patience: float = 0.0
    """Extra time that loop, readings and driver may be silent [s]: for simulated robots on a busy
    machine, as in tests."""

    def __post_init__(self) -> None:
        site = self.robot.scenario.zones
        if site is not None:
            object.__setattr__(self, "zones", self.zones.over(site.read(self.robot.start)))

    @property
    def period(self) -> float:
        """[s]"""
        return 1.0 / self.rate


class Session:
    """Everything that runs. `close`, or leaving the `with`, stops the robot first."""

    def __init__(
        self, plan: SessionConfig, operator: Operator | None = None, camera: Camera | None = None
    ) -> None:
        """camera: gives the newest picture at the robot's time; by default the robot's readings do.
        Raises CohelmError if something can not be started; nothing is left running then."""
        self.plan, self._camera = plan, camera
        self.scheduling = SIMULATED_TIME
        self._priority_raised, self._niceness = False, os.getpriority(os.PRIO_PROCESS, 0)
        robot, real_time = plan.robot, plan.robot.real_time
        model = robot.model
        if robot.kind == "own":  # a simulated one brakes as it is described, at once too
            checked_braking(model.bounds())
        checked_sight(model)
        self.recording: Recording | None = None
        self.live: Live | None = None
        self.gated: GatedRobot | None = None
        self.driver: Driver | None = None
        self.known: LocalizationMap | None = None
        """The map for localisation."""
        self.zone_maps = zone_messages(plan.zones, robot.scenario.reference.speed_mps)
        """The zones as messages for stations and records."""
        self.pictures = Pictures(waits=not real_time)
        self.shown: Callable[[Packed, float], None] | None = None
        """Called with each picture and its age [s]..."""
        self.watched: Callable[[], bool] = lambda: True
        """... while this is so."""
        self._picture_rate, self._pictures_since = 0.0, math.inf
        """Of pictures that somebody uses [Hz], and since when [s]."""
        self._frame: Frame | Encoded | None = None
        """The newest picture of that camera."""
        self._outline_check: OutlineCheck | None = None
        self._to_dock = False
        """Whether `run` was to dock."""
        self._ends = False
        self._slow_since = math.inf
        """Since when it crawls [s]."""
        self.not_begun = ""
        """Why the robot never drove in the requested mode."""
        self.route_problem = ""
        """What the check of its first route found; empty: nothing."""
        self._recorded = -math.inf
        self._periods = self._lost = 0
        self._whole = True
        try:
            if plan.record is not None:
                self.recording = Recording(plan.record, model, dump(robot.scenario))
            if plan.live is not None:
                from cohelm.drive.live import Live  # most drives have none

                self.live = Live(plan.live, model)
            known, walls = plan.known, robot.scenario.walls()
            if known is None and plan.localise and len(walls) > 0:
                known = map_from_geometry(walls, robot.start)
            self.known = known
            if plan.zones:
                check(plan.zones, known)
            docks = docks_of(plan, known)
            self.driver = driver_of(plan, real_time)  # its planner compiles beside all else
            warmed_up = in_thread(lambda: warm_up(model, known is not None)) if real_time else None
            gate = rules(model, plan.period, plan.watchdog + plan.patience)
            listeners = (self.recording, self.live)
            record, live = (_line(one, real_time) for one in listeners)
            if real_time:
                ends = [None if one is None else one.gated for one in listeners]
                self.gated = RemoteGatedRobot(robot.maker(), gate, *ends)
            else:  # one process, one line: messages of loop and gate arrive in order
                self.gated = LocalGatedRobot(robot.maker()(), gate, record, viewer=live)
            epoch = time.time_ns() - round(self.gated.now() * 1e9)
            for one in listeners:
                if one is not None:
                    one.gated.close()  # the gate process has it, or nothing writes to it
                    one.begin(epoch)
            if warmed_up is not None:
                warmed_up()
            perception = Perception(model, known, robot.start)
            self.loop = Loop(
                self.gated, perception, self.driver, operator or NullOperator(), record,
                _loop_params(plan), live=live, docks=docks,
            )  # fmt: skip
            if known is not None:
                self.loop.log.show(recordable(map_message(known)))
                self._outline_check = OutlineCheck(self.loop, known)
            for line in (*self.zone_maps, *reference_lines(robot.route)):
                self.loop.log.show(line)
            self._warm_up()
            if robot.route is None:
                self.driver.drop_route()
            if real_time:
                self._priority_raised, self.scheduling = True, raise_priority()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, until: Callable[[Loop], bool], mode: Mode = Mode.HOLD, dock: int = 0) -> None:
        """Drive in a mode, as soon as the robot can, until `until` says so.

        dock: dock there instead, from 1. A stop, hold or fault meanwhile cancels it, and so does a
        mode that a person chooses.
        """
        if self.recording is not None:
            self.recording.keep()
        gated, supervisor = self.loop.gated, self.loop.supervisor
        begun, ended = gated.now(), supervisor.rights.revocations
        self._to_dock = dock > 0
        wanted, refusal = Mode.AUTOMATIC if dock else mode, ""

        def chosen(loop: Loop) -> bool:
            nonlocal wanted, refusal
            if wanted != Mode.HOLD:
                over = supervisor.rights.revocations != ended or latched(gated.gate.mode)
                over = over or supervisor.mode not in (Mode.HOLD, wanted)
                late = gated.now() - begun > _READY
                refusal = ""
                if not over:
                    refusal = supervisor.dock(dock) if dock else supervisor.choose(wanted)
                if late and refusal and dock:
                    supervisor.docking.finish(Ended(refusal))
                elif late:
                    self.not_begun = refusal
                if over or late or not refusal:
                    wanted = Mode.HOLD
            self._update_pictures()
            if self._outline_check is not None:
                self._outline_check.turn(loop)
            self._periods += 1
            self._lost += loop.seen is not None and loop.seen.lost
            return until(loop)

        if self.plan.robot.real_time:
            raise_thread_priorities()
        self.loop.run(chosen, self.plan.robot.real_time)
        if wanted != Mode.HOLD and not dock:  # it ended before that was tried for long enough
            self.not_begun = refusal

    def _update_pictures(self) -> None:
        """Have frames drawn and encoded while they are used, and pass on what is encoded. Takes no
        time."""
        loop, rate = self.loop, self.plan.pictures
        shown = self.shown if self.watched() else None
        self._draw_at(math.inf if shown is not None else rate if loop.log.wants_pictures else 0.0)
        if loop.readings is None or loop.seen is None:
            return
        frame = loop.readings.frame
        if self._camera is not None:
            self._frame = frame = self._camera(loop.gated.now()) or self._frame
        if frame is None or frame.stamp < self._pictures_since:
            return
        due = rate > 0.0 and loop.log.wants_pictures and frame.stamp - self._recorded > 0.9 / rate
        if due or shown is not None:
            self.pictures.give(frame, loop.seen.pose)
        packed = self.pictures.take()
        if packed is None:
            return
        if due:
            self._recorded = packed.stamp
            loop.log(Encoded(packed.stamp, packed.number, packed.data))
        if shown is not None:
            shown(packed, loop.gated.now() - packed.stamp)

    def _draw_at(self, rate: float) -> None:
        """So many pictures a second are used from now on [Hz]."""
        before, self._picture_rate = self._picture_rate, rate
        if rate != before:
            if before == 0.0:
                self._pictures_since = self.loop.gated.now()
            self.loop.gated.draw_at(rate)

    def set_zones(self, zones: Zones, maps: tuple[ZoneMap, ...]) -> None:
        """Use other zones from now on. maps: as messages."""
        self.plan, self.zone_maps = replace(self.plan, zones=zones), maps
        for one in maps:
            self.loop.log.show(one)

    def end(self, reason: str) -> None:
        """Stop the robot, and run the loop until it stands, so that the record has it."""
        gated, self._ends = self.loop.gated, True
        gated.stop(reason)
        until = gated.now() + _BRAKING

        def stands(loop: Loop) -> bool:
            return gated.now() > until or (loop.seen is not None and standing(loop.seen.twist))

        self.loop.run(stands, self.plan.robot.real_time)

    def state(self) -> str:
        """Mode, and why the robot stands, as text."""
        loop, gate, seen = self.loop, self.loop.gated.gate, self.loop.seen
        lost = seen is not None and seen.lost and loop.has_map and f"lost: {seen.reason}"
        why = gate.reason or loop.supervisor.problem or loop.supervisor.paused or lost
        if loop.supervisor.mode != Mode.MANUAL:
            why = why or loop.supervisor.unreachable
        crawls = self._crawls(seen)
        if not why and driving(gate.mode) and seen and (standing(seen.twist) or crawls):
            why = loop.log.why(loop.supervisor.mode) or _obstacle(loop.decision)
        mode = loop.supervisor.mode if driving(gate.mode) else gate.mode
        return mode.name.lower() + (f": {why}" if why else "")

    def _crawls(self, seen: Seen | None) -> bool:
        """Whether it has been slow for a while, and should not be; to be called repeatedly."""
        decision, now = self.loop.decision, self.loop.gated.now()
        wanted = 0.0 if decision is None else abs(decision.nominal.v)
        slow = seen is not None and abs(seen.twist.v) < _CRAWL < 0.5 * wanted
        self._slow_since = min(self._slow_since, now) if slow else math.inf
        return now - self._slow_since > _A_WHILE

    @property
    def stopped(self) -> bool:
        """Whether the gate is latched before the end of the drive."""
        return latched(self.loop.gated.gate.mode) and not self._ends

    def line(self) -> str:
        """State and timing, for a terminal."""
        loop, timing = self.loop, self.loop.timing.punctuality()
        gate, seen = loop.gated.gate, loop.seen
        where = f"at {seen.pose.x:.2f} {seen.pose.y:.2f}" if seen else "not localized yet"
        state = f"{loop.supervisor.mode.name} {gate.mode.name} {gate.reason} {where}"
        return (
            f"{state} | {timing.periods} periods, {100.0 * timing.within_2ms:.2f} % within 2 ms, "
            f"worst {1e3 * timing.late_worst:.1f} ms, work {1e3 * timing.took_median:.1f} ms, "
            f"{timing.overruns} overruns"
        )

    def summary(self) -> dict[str, Any]:
        """The summary; read before `close`."""
        loop, timing, gate = self.loop, self.loop.timing.punctuality(), self.loop.gated.gate
        truth = loop.gated.truth()
        least = truth.least_moving if truth is not None else math.nan
        return {
            "scenario": self.plan.robot.scenario.name,
            "robot": self.plan.robot.model.name,
            "kind": self.plan.robot.kind,
            "rate_hz": self.plan.rate,
            "mode": gate.mode.name,
            "reason": gate.reason,
            "faulted": gate.mode == GateMode.FAULTED,
            "not_begun": self.not_begun or None,
            "route": self.route_problem or None,
            "arrived": loop.driver.arrived,
            "docking": loop.supervisor.docking.last.why or None,
            "docked": loop.supervisor.docking.last.arrived if self._to_dock else None,
            "least_clearance_moving_m": least if math.isfinite(least) else None,
            "lost_share": None if self.known is None else self._lost / max(self._periods, 1),
            "lost": bool(loop.seen is not None and loop.seen.lost),
            **{key: value for key, value in timing._asdict().items() if value == value},
            "refused": gate.refused,
            "scheduling": self.scheduling,
            "live": None if self.plan.live is None else not loop.log.view_lost,
        }

    def record_summary(self) -> dict[str, Any]:
        """The record's part of the summary; final once the session is closed."""
        path, fault = self.plan.record, self.loop.log.fault
        if not self._whole:
            fault = fault or "the recorder did not finish the file"
        return {
            "record": str(path) if path else None,
            "record_whole": None if path is None else fault == "",
            "record_fault": fault or None,
            "record_dropped": self.loop.log.dropped,
        }

    def close(self) -> None:
        """Close the robot first, then the planner, then the record."""
        if self.gated is not None:
            self.gated.close()
        if self.driver is not None:
            self.driver.close()
        self.pictures.close()
        if self.recording is not None:
            self._whole = self.recording.close() and self._whole
        if self.live is not None:
            self.live.close()
        if self._priority_raised:
            restore_priority(self._niceness)

    def _warm_up(self) -> None:
        """Compile what a period needs before the first one is due, by a few at standstill.

        In real time that can take minutes between two scans, in which the odometry drifts: another
        perception is used, or the loop's would take the robot for carried away.
        """
        loop, robot = self.loop, self.plan.robot
        gated, perception = loop.gated, loop.perception
        if robot.real_time:
            perception = Perception(robot.model, self.known, robot.start)
        end = gated.now() + (0.5 if robot.real_time else 0.1)
        while True:
            seen = perception.take(gated.now(), gated.read())
            loop.driver.warm_up(seen)
            gated.wait(gated.now() + self.plan.period)
            if gated.now() >= end:
                break
        loop.driver.warm_up_planner(seen, gated)
        loop.period()
        loop.timing = Timing()


def _line(listener: EventSink | None, real_time: bool) -> RecordLine:
    return RecordLine(None if listener is None else listener.loop, waits=not real_time)


def _loop_params(plan: SessionConfig) -> LoopParams:
    arming = plan.loop.arming
    patient = arming._replace(stale=arming.stale + plan.patience)
    return plan.loop._replace(period=plan.period, arming=patient, patience=plan.patience)


def _obstacle(decision: Decision | None) -> str:
    """What the guard holds the robot back for, as a sentence; empty: for nothing seen."""
    if decision is None or decision.verdict == Verdict.UNTOUCHED:
        return ""
    clearance = decision.clearance_seen
    if clearance <= 0.0:
        return "by its LiDARs an obstacle touches it, or is nearer than they can measure"
    return f"an obstacle {clearance:.2f} m off" if clearance < math.inf else ""


def docks_of(plan: SessionConfig, known: LocalizationMap | None) -> tuple[Dock, ...]:
    """The docks of a plan's site. Raises CohelmError for a dock without room for the robot."""
    scenario, model = plan.robot.scenario, plan.robot.model
    rules = inflated_rules(scenario.law.guard.rules(plan.period), SLOP + noise(model))
    return checked(scenario.docks, model.outline, rules.hard_margin, known, plan.zones)


def driver_of(plan: SessionConfig, real_time: bool, reference: Reference | None = None) -> Driver:
    """A driver for a session's robot, on the scenario's reference or another one."""
    scenario, model = plan.robot.scenario, plan.robot.model
    reference = scenario.reference.spline() if reference is None else reference
    law = scenario.law
    settings = law.settings(
        model.outline, model.bounds(), scenario.reference.speed_mps, plan.period
    )._replace(guarded=True)  # a robot that lives by its sensors keeps clear by what they see
    off, delay = SLOP + noise(model), plan.robot.delay(plan.period)
    settings, path_params, replan_params = inflated(
        settings, law.path_params(), law.replan_params(), off, noise(model)
    )
    pilot = Pilot(
        reference, settings, delay=delay, path_params=path_params, replan_params=replan_params
    )
    planner = pilot.planner
    planning = (
        RemotePlanner(planner, partial(warm_up_planner, planner))
        if real_time
        else InProcessPlanner(planner)
    )
    return Driver(pilot, settings, delay, planning, plan.zones, law.plan.period_s)
