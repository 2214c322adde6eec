"""What was found of a ROS 2 robot, and what the user states instead."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.core.types import Floats
from cohelm.robot.model import RobotModel
from cohelm.ros import clock, depth
from cohelm.ros.camera import CameraTopic
from cohelm.ros.clock import Clock
from cohelm.ros.connection import Connection
from cohelm.ros.option_names import FILTER, OptionNames
from cohelm.ros.port import Endpoint
from cohelm.ros.topics import Topics
from cohelm.ros.transforms import Mount


class Allowed(NamedTuple):
    """What the user states instead of leaving it to be found out."""

    stamped: bool | None = None
    """Whether the base wants TwistStamped; None: as its subscription says."""
    bypass: bool = False
    """Whether others may drive the base past the filter."""
    mount_from_model: bool = False
    """Whether the mount is the robot description's, and not that of /tf_static."""
    clock: float = clock.MOST
    """By how much clocks may differ [s]."""
    lock_silence: float = math.inf
    """Without a message on the lock's topic for so long the base is locked [s]."""
    options: OptionNames = FILTER
    """By which the user states all this and the topics."""


class FoundLidar(NamedTuple):
    """A LiDAR, as it was found."""

    topic: str
    frame: str
    """Of its messages: what comes in another one is not its."""
    mount: Mount
    clock: Clock
    stamped_at_end: bool
    """Whether scans are stamped when their last beam was measured, not their first."""
    cloud: Floats | None = None
    """(4, 4), of one that sends point clouds, depth images or single ranges: from their frame into
    the body's."""
    camera: depth.Intrinsics | None = None
    """Of one that sends depth images."""


class Found(NamedTuple):
    """A ROS 2 robot, as it was found. Can be pickled."""

    topics: Topics
    model: RobotModel
    """As described, with the LiDARs and the rates that were found."""
    out_type: str
    body: str
    """Frame of the base, from the odometry."""
    odom: str
    """Frame of the odometry's poses."""
    odom_clock: Clock
    lidars: tuple[FoundLidar, ...]
    """The first one first."""
    command_period: float
    """From one command to the next, as the controller sends them; NaN: none came [s]."""
    notes: tuple[str, ...]
    """What was found and concluded; a sentence each."""
    connection: Connection = Connection()
    """By which it was found."""
    bypass: bool = False
    """Whether others may drive the base past the filter."""
    lock_silence: float = math.inf
    """Without a message on the lock's topic for so long the base is locked [s]."""
    simulated: bool = False
    """Whether stamps are of the simulator's time on /clock."""
    camera: CameraTopic | None = None
    """The camera shown to the operator."""
    options: OptionNames = FILTER
    """As in `Allowed`."""
    endpoints: tuple[Endpoint, ...] = ()
    """All publishers and subscribers of others that were seen."""
