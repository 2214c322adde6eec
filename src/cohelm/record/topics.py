"""The run in ROS 2's standard messages, for Foxglove, Lichtblick, RViz and rosbag tools.

Frames: `world` (x, y on the ground, z up) and `base_link` (x forward, y left, on the robot).
What is drawn once and what moves have topics of their own: after a jump in time a viewer
recalls only the newest message of each topic.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Duration as Duration,
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as Pose,
    geometry_msgs__msg__PoseStamped as PoseStamped,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Twist as Twist,
    geometry_msgs__msg__TwistStamped as TwistStamped,
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as Odometry,
    nav_msgs__msg__Path as Path,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Joy as Joy,
    std_msgs__msg__ColorRGBA as ColorRGBA,
    std_msgs__msg__Header as Header,
    tf2_msgs__msg__TFMessage as TFMessage,
    visualization_msgs__msg__Marker as Marker,
    visualization_msgs__msg__MarkerArray as MarkerArray,
    visualization_msgs__msg__MeshFile as MeshFile,
)

from cohelm.core.trace import Trace
from cohelm.core.types import RADIUS, SAFE, Floats, X, Y

WORLD, ROBOT = "world", "base_link"

TOPICS = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/odom": "nav_msgs/msg/Odometry",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/cmd_vel_safe": "geometry_msgs/msg/TwistStamped",
    "/joy": "sensor_msgs/msg/Joy",
    "/obstacles": "visualization_msgs/msg/MarkerArray",
    "/scene": "visualization_msgs/msg/MarkerArray",
    "/reference": "nav_msgs/msg/Path",
}
"""Every topic but `/status`, with its type. `/cmd_vel` is the command that reached the wheels,
`/cmd_vel_safe` the one the law asked for; `/joy` has axes fore-aft and left-right; `/scene`
holds walls and the robot's outline."""

RATE = 50.0
"""Of all that goes on during a run but obstacles [Hz]; `/status` is every control step."""

OBSTACLE_RATE = 10.0
"""Of `/obstacles`, while one moves [Hz]."""

Said = tuple[str, object]
"""A topic and the message on it."""


def _nothing(columns: int) -> Floats:
    return np.empty((0, columns))


@dataclass(frozen=True)
class Scene:
    """What stays as it is during a run and is drawn once.

    outline: (k, 2) corners of the robot, body frame [m]. walls: (s, 4), segments x1, y1, x2, y2
    in the world frame [m]. reference: (p, 3), poses x, y, psi along the reference [m, m, rad].
    """

    outline: Floats = field(default_factory=lambda: _nothing(2))
    walls: Floats = field(default_factory=lambda: _nothing(4))
    reference: Floats = field(default_factory=lambda: _nothing(3))


def once(scene: Scene, stamp: int) -> Iterator[Said]:
    """What is drawn once. stamp: [ns]."""
    world = header(stamp, WORLD)
    poses = [PoseStamped(world, pose(x, y, psi)) for x, y, psi in scene.reference.tolist()]
    yield "/reference", Path(world, poses)
    outline, walls = scene.outline.tolist(), scene.walls.reshape(-1, 2).tolist()
    robot = marker(
        header(stamp, ROBOT), "robot", 0, Marker.LINE_STRIP,
        pose(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), _ROBOT_COLOUR, [*outline, *outline[:1]],
    )  # fmt: skip
    wall = marker(
        world, "walls", 0, Marker.LINE_LIST,
        pose(0.0, 0.0, 0.0), (0.05, 0.0, 0.0), _WALL_COLOUR, walls,
    )  # fmt: skip
    shown: list[Any] = [marker for marker in (robot, wall) if marker.points]
    yield "/scene", MarkerArray(shown)


def steps(piece: Trace, first: int, stamps: Sequence[int]) -> Iterator[list[Said]]:
    """The messages of every step of a piece. first: number of its first step in the run."""
    every, obstacles_every = _every(RATE, piece.dt), _every(OBSTACLE_RATE, piece.dt)
    for j, row in enumerate(piece.rows):
        said: list[Said] = []
        if (first + j) % every == 0:
            said += _motion(row, stamps[j])
        if (first + j) % obstacles_every == 0 and _moved(piece.discs, j, obstacles_every):
            said.append(("/obstacles", _obstacles(stamps[j], piece.names, piece.discs[j])))
        yield said


def _every(rate: float, dt: float) -> int:
    return max(1, round(1.0 / (rate * dt)))


def _moved(discs: Floats, j: int, since: int) -> bool:
    """Whether to draw the discs of step j: where they moved, and once at a piece's start."""
    return j < since or not np.array_equal(discs[j], discs[j - since])


def _motion(row: np.void, stamp: int) -> Iterator[Said]:
    """Where the robot is, what it was asked, what reached its wheels, and the stick."""
    world, robot = header(stamp, WORLD), header(stamp, ROBOT)
    here = pose(float(row["x"]), float(row["y"]), float(row["psi"]))
    asked = _twist(float(row["safe_v"]), float(row["safe_omega"]))
    applied = _twist(float(row["applied_v"]), float(row["applied_omega"]))
    axes = np.array([row["stick_x"], row["stick_psi"]], dtype=np.float32)
    at = Transform(Vector3(here.position.x, here.position.y, 0.0), here.orientation)
    yield "/tf", TFMessage([TransformStamped(world, ROBOT, at)])
    known, driven = PoseWithCovariance(here, _EXACT), TwistWithCovariance(applied, _EXACT)
    yield "/odom", Odometry(world, ROBOT, known, driven)
    yield "/cmd_vel", TwistStamped(robot, applied)
    yield "/cmd_vel_safe", TwistStamped(robot, asked)
    yield "/joy", Joy(robot, axes, np.empty(0, dtype=np.int32))


def _obstacles(stamp: int, names: tuple[str, ...], discs: Floats) -> MarkerArray:
    """Every disc as a low cylinder, on a translucent one as wide as its safe distance."""
    world, cylinder = header(stamp, WORLD), Marker.CYLINDER
    markers: list[Any] = []  # rosbags types it with the markers of an older ROS
    for name, disc in zip(names, discs.tolist(), strict=True):
        at, radius, safe = pose(disc[X], disc[Y], 0.0), disc[RADIUS], disc[SAFE]
        body = (2 * radius, 2 * radius, 0.2)
        ring = (2 * safe, 2 * safe, 0.01)
        markers.append(marker(world, name, 0, cylinder, at, body, OBSTACLE_COLOUR))
        markers.append(marker(world, name, 1, cylinder, at, ring, SAFE_COLOUR))
    return MarkerArray(markers)


_EXACT = np.zeros(36)  # covariance of a simulated pose
_ROBOT_COLOUR = ColorRGBA(0.1, 0.4, 0.9, 1.0)
_WALL_COLOUR = ColorRGBA(0.5, 0.5, 0.5, 1.0)
OBSTACLE_COLOUR = ColorRGBA(0.9, 0.4, 0.1, 1.0)
SAFE_COLOUR = ColorRGBA(0.9, 0.4, 0.1, 0.25)
_FOR_EVER = Duration(0, 0)
_NO_TEXTURE = CompressedImage(Header(Time(0, 0), ""), "", np.empty(0, dtype=np.uint8))
_NO_MESH = MeshFile("", np.empty(0, dtype=np.uint8))


def header(stamp: int, frame: str) -> Header:
    """stamp: [ns]."""
    return Header(Time(*divmod(stamp, 1_000_000_000)), frame)


def pose(x: float, y: float, psi: float) -> Pose:
    """On the ground [m, m, rad]."""
    half = psi / 2 if math.isfinite(psi) else math.nan  # sin and cos refuse infinity
    return Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, math.sin(half), math.cos(half)))


def _twist(v: float, omega: float) -> Twist:
    return Twist(Vector3(v, 0.0, 0.0), Vector3(0.0, 0.0, omega))


def marker(
    head: Header, name: str, number: int, shape: int,
    at: Pose, scale: tuple[float, float, float],
    colour: ColorRGBA, points: Sequence[Sequence[float]] = (),
) -> Marker:  # fmt: skip
    """One thing to draw. at: of its middle. scale, points: [m]."""
    return Marker(
        header=head,
        ns=name,
        id=number,
        type=shape,
        action=Marker.ADD,
        pose=at,
        scale=Vector3(*scale),
        color=colour,
        lifetime=_FOR_EVER,
        frame_locked=True,
        points=[Point(x, y, 0.0) for x, y in points],
        colors=[],
        texture_resource="",
        texture=_NO_TEXTURE,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_NO_MESH,
        mesh_use_embedded_materials=False,
    )
