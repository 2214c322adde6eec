"""What a ROS 2 robot that cohelm drives says on topics of its own, beside the loop."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.drive.factory import OwnRobot, RobotFactory
from cohelm.loop.loop import Loop
from cohelm.ros.localized import MAP, NODE, Localized
from cohelm.ros.robot import Ros2Make


class TopicsConfig(NamedTuple):
    """What is said on topics."""

    frame: str = MAP
    """Of the map."""
    transforms: bool = True
    """Whether map -> odom is published."""


class OnTopics:
    """Of one drive; `turn` is called between two periods and takes no time."""

    def __init__(self, localized: Localized | None) -> None:
        """localized: None for a robot that is none of ROS 2."""
        self._localized = localized

    def turn(self, loop: Loop) -> None:
        """Between two periods."""
        seen, readings, pilot = loop.seen, loop.readings, loop.driver.pilot
        if self._localized is None or not loop.has_map or seen is None or readings is None:
            return
        line = None if pilot is None else pilot.course.poses
        self._localized.take(seen, readings.odometry, loop.keeper.now(), line)


@contextmanager
def on_topics(
    robot: RobotFactory, config: TopicsConfig, say: Callable[[str], None]
) -> Generator[OnTopics]:
    """Of a robot, as long as it is driven; of one that is none of ROS 2, nothing.

    say: hears a sentence for a person. CohelmError for what only a ROS 2 robot has, or where the
    network can not be joined.
    """
    make = robot.make if isinstance(robot, OwnRobot) else None
    if not isinstance(make, Ros2Make):
        if config != TopicsConfig():
            raise CohelmError("--map-frame and --no-tf are of a ROS 2 robot: add --ros2")
        yield OnTopics(None)
        return
    found = make.found
    if config.frame in ("", found.odom, found.body):
        raise CohelmError(
            f"--map-frame {config.frame!r}: give a frame of its own, such as {MAP}, beside "
            f"{found.odom} and {found.body}"
        )
    transport = found.connection.open(NODE, found.topics.namespace)
    try:
        localized = Localized(transport, found, say, config.frame, config.transforms)
        try:
            yield OnTopics(localized)
        finally:
            localized.close()
    finally:
        transport.close()
