"""What a ROS 2 robot that cohelm drives publishes and subscribes to, beside the loop.

No message on a topic chooses a mode. A goal or a path becomes the robot's path after the same
checks as one from the page, and an initial pose is accepted while the robot stands.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.drive.factory import OwnRobot, RobotFactory
from cohelm.drive.jobs import ThreadJobs
from cohelm.drive.operator_requests import SessionJobs
from cohelm.drive.rerouting import PathRequest, Rerouting, checker_of, stands
from cohelm.drive.session import Camera as Eye, Session
from cohelm.drive.shown import map_message
from cohelm.drive.zones_on_topics import ZonesOnTopics
from cohelm.link.bulk_messages import Checked
from cohelm.link.messages import Arming
from cohelm.link.rate import Coalesced
from cohelm.loop.loop import Loop
from cohelm.perceive.localize.localization_map import LocalizationMap, gap_at
from cohelm.ros.camera import Camera
from cohelm.ros.clock import SimulatedClock
from cohelm.ros.found import Found
from cohelm.ros.goals import GOAL, ONCE, Goals, Placed
from cohelm.ros.joy import JOY, JoyOperator, JoyParams
from cohelm.ros.localized import MAP, NODE, PATH, POSE, Localized
from cohelm.ros.masks import FilterMask
from cohelm.ros.names import resolved
from cohelm.ros.port import SENSOR
from cohelm.ros.reset import EMPTY, ONCE as RESET, resets
from cohelm.ros.robot import Ros2Make
from cohelm.ros.unreached import Unreached, Wanted

TOPICS = -1
"""Client number of requests from topics; clients of the link have their own numbers."""
_FIRST, _JOY = "first way", "joy"


class TopicsConfig(NamedTuple):
    """What is published and subscribed to on topics."""

    frame: str = MAP
    """Frame of the map."""
    transforms: bool = True
    """Whether map -> odom is published."""
    ways: tuple[str, ...] = ()
    """Topics of goals or paths for the robot to follow."""
    initial: str = ""
    """Topic of initial poses; empty: none."""
    joy: str = ""
    """Topic of the joystick that the operator steers with; empty: none."""
    joy_params: JoyParams = JoyParams()
    """The axes and buttons in use."""
    resets: str = ""
    """Topic of reset requests; empty: none."""
    masks: tuple[FilterMask, ...] = ()
    """The masks whose zones the robot starts with; it follows their updates."""


class OnTopics:
    """The topics of one drive; `turn` is called between two periods and takes no time."""

    def __init__(
        self, localized: Localized | None, goals: Goals | None, camera: Eye | None = None,
        joy: JoyOperator | None = None, zones: ZonesOnTopics | None = None, resets: str = "",
    ) -> None:  # fmt: skip
        """None or "": not in use."""
        self.joy, self.resets = joy, resets
        """The operator with a joystick on a topic, and the topic of reset requests."""
        self._joy_armed = False
        self._localized, self._goals = localized, goals
        self.camera = camera
        self.blind = localized is not None and camera is None
        """Whether it is a ROS 2 robot without camera pictures."""
        self._drawn: LocalizationMap | None = None
        self._jobs: SessionJobs | None = None
        self._rerouting: Rerouting | None = None
        self._zones = zones
        self._pending: dict[int, str] = {}
        """The topic of each request that is not answered yet."""
        self._count = 0
        self._placed = Coalesced()  # a flood of initial poses does not fill the log

    def begin(self, session: Session, jobs: Callable[..., SessionJobs] = SessionJobs) -> None:
        """Begin a session that no station drives: paths are planned here, and the robot stands
        until the first one comes. jobs: run beside the loop."""
        if self.joy is not None:
            session.loop.supervisor.pause(_JOY, f"waiting for {self.joy.topic} to be centred")
        if self._goals is None or not self._goals.ways:
            return
        plan, supervisor = session.plan, session.loop.supervisor
        self._jobs = jobs(checker_of(plan, session.known), plan.robot.real_time)
        self._rerouting = Rerouting(
            session, (self,), self._jobs.checking, self._jobs.paths,
            lambda _: supervisor.resume(_FIRST),
        )  # fmt: skip
        supervisor.awaits_route = True
        supervisor.pause(_FIRST, f"waiting for a goal or path on {' or '.join(self._goals.ways)}")

    def attend(self, session: Session) -> None:
        """Follow any session; called before its first turn."""
        if self._zones is not None:
            self._zones.attend(session)

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        if self._zones is not None:
            self._zones.turn(loop)
        if self.joy is not None:
            self._wait_for_joy(loop, self.joy)
        seen, readings, pilot = loop.seen, loop.readings, loop.driver.pilot
        if seen is None or readings is None:
            return
        if self._localized is not None and loop.has_map:
            known = loop.perception.known
            if known is not None and known is not self._drawn:
                self._drawn = known
                self._localized.draw(map_message(known))
            line = None if pilot is None else pilot.course.poses
            self._localized.take(seen, readings.odometry, loop.gated.now(), line)
        if self._goals is not None:
            if pilot is not None and not loop.supervisor.paused:
                self._goals.route = pilot.planner.route.line
            self._take_initial_pose(loop, self._goals)
        if self._rerouting is not None:
            self._rerouting.turn(loop)

    def path_requests(self) -> Sequence[PathRequest]:
        """See `rerouting.PathRequests`."""
        made = None if self._goals is None else self._goals.way()
        if made is None:
            return ()
        self._count += 1
        self._pending = {self._count: made[0]}
        return (PathRequest(TOPICS, self._count, made[1], False),)

    def reply(self, client: int, answer: Checked) -> None:
        """See `rerouting.PathRequests`."""
        topic = self._pending.pop(answer.answer.number, "") if client == TOPICS else ""
        if topic and self._goals is not None:
            self._goals.report(topic, answer.answer.reason or "accepted: the robot follows it")

    def close(self) -> None:
        """Plan no more paths."""
        if self._jobs is not None and self._rerouting is not None:
            self._jobs.paths.close(1.0)
            self._jobs.records.close(1.0)
            self._rerouting.close()
        if self._goals is not None:
            self._goals.close()
        if self._zones is not None:
            self._zones.close()

    def _wait_for_joy(self, loop: Loop, joy: JoyOperator) -> None:
        """Pause until the joystick was armed once; with hold-to-run, also whenever its enable
        button is released."""
        self._joy_armed = self._joy_armed or loop.supervisor.stick_state.arming == Arming.ARMED
        why = ""
        if not self._joy_armed:
            why = joy.problem() or f"waiting for {joy.topic} to be centred"
        elif joy.params.hold_to_run and not joy.held():
            why = joy.problem() or f"the enable button of {joy.topic} is not held"
        if why:
            loop.supervisor.pause(_JOY, why)
        else:
            loop.supervisor.resume(_JOY)

    def _take_initial_pose(self, loop: Loop, goals: Goals) -> None:
        placed, now = goals.initial(), loop.gated.now()
        if placed is None:
            lines = self._placed.due(now)
        else:
            result = self._place(loop, placed) or "accepted: localizing from there"
            text = f"{placed.topic}: {result}"
            lines = self._placed.add(now, text, text)
        for line in lines:
            goals.note(line)
            loop.log.event(line)

    def _place(self, loop: Loop, placed: Placed) -> str:
        """Set the robot's pose on the map; why that is refused, or ""."""
        if not loop.has_map:
            return "there is no map to localize on"
        if not stands(loop):
            return (
                "the robot is moving, and takes an initial pose only at rest: hold it, then "
                "publish it again"
            )
        pose, known = placed.pose, loop.perception.known
        gap = 1.0 if known is None else float(gap_at(known, pose.x, pose.y))
        if not gap > 0.0:  # nor for NaN
            at = f"{pose.x:.1f}, {pose.y:.1f}"
            return f"{at} is in a wall of the map" if gap == 0.0 else f"{at} is not on the map"
        loop.perception.place(pose, placed.sigma)
        return ""


def on_topics(
    robot: RobotFactory, config: TopicsConfig, say: Callable[[str], None],
    reset: Callable[[str, float], None] = lambda _name, _stamp: None,
) -> AbstractContextManager[OnTopics]:  # fmt: skip
    """The topics of a robot as long as it is driven; nothing for a robot without ROS 2.

    say: shows a sentence to a person. reset: called with the topic of a reset request, and its time
    by this machine's monotonic clock [s]. Raises CohelmError at once for options that need a ROS 2
    robot; entering it, where the network can not be joined.
    """
    make = robot.make if isinstance(robot, OwnRobot) else None
    if not isinstance(make, Ros2Make):
        if config != TopicsConfig():
            raise CohelmError(
                "--map-frame, --no-tf, --goals-from, --initial-pose-from, --reset-from and --joy "
                "are of a ROS 2 robot: add --ros2"
            )
        return nullcontext(OnTopics(None, None))
    found = make.found
    if config.frame in ("", found.odom, found.body):
        raise CohelmError(
            f"--map-frame {config.frame!r}: give a frame of its own, such as {MAP}, beside "
            f"{found.odom} and {found.body}"
        )
    return _joined(found, config, say, reset)


@contextmanager
def _joined(
    found: Found, config: TopicsConfig, say: Callable[[str], None],
    reset: Callable[[str, float], None],
) -> Generator[OnTopics]:  # fmt: skip
    """The topics of a robot that was found, on its network."""
    for note in found.notes:
        say(note)
    space = found.topics.namespace
    transport = found.connection.open(NODE, space)
    try:
        goals = None
        if config.ways or config.initial:
            goals = Goals(transport, config.frame, config.ways, config.initial, say, space)
        localized = Localized(transport, found, say, config.frame, config.transforms)
        camera = None
        if found.camera is not None:
            clock = SimulatedClock.on(transport) if found.simulated else None
            camera = Camera(transport, found.camera, found.odom_clock, clock)
        joy = None
        if config.joy:
            joy = JoyOperator(transport, resolved(config.joy, space), config.joy_params)
            if missing := joy.nothing_received():
                say(missing)
        reset_topic = resolved(config.resets, space) if config.resets else ""
        if reset_topic:
            resets(transport, reset_topic, partial(reset, reset_topic), say)
        zones = None
        if config.masks:
            jobs = ThreadJobs("zones")
            zones = ZonesOnTopics(transport, config.masks, config.frame, space, jobs, say)
        made = OnTopics(localized, goals, camera, joy, zones, reset_topic)
        report = say if goals is None else goals.note
        unreached = Unreached(transport, optional_topics(config, space), report)
        try:
            yield made
        finally:
            unreached.close()
            made.close()
            localized.close()
    finally:
        transport.close()


def optional_topics(config: TopicsConfig, space: str) -> tuple[Wanted, ...]:
    """Topics whose messages may come at any time, in a namespace."""
    wanted = (
        *(Wanted(one, (GOAL, PATH), ONCE, "--goals-from") for one in config.ways),
        Wanted(config.initial, (POSE,), ONCE, "--initial-pose-from"),
        Wanted(config.joy, (JOY,), SENSOR, "--joy", "joystick"),
        Wanted(config.resets, (EMPTY,), RESET, "--reset-from"),
    )
    return tuple(one._replace(topic=resolved(one.topic, space)) for one in wanted if one.topic)
