"""Markers that viewers draw on the ground, and their colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Duration as Duration,
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as Pose,
    geometry_msgs__msg__Vector3 as Vector3,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    std_msgs__msg__ColorRGBA as ColorRGBA,
    std_msgs__msg__Header as Header,
    visualization_msgs__msg__Marker as Marker,
    visualization_msgs__msg__MarkerArray as MarkerArray,
    visualization_msgs__msg__MeshFile as MeshFile,
)

from cohelm.core.types import Floats
from cohelm.record.ros2 import header, pose

_ROBOT_COLOUR = ColorRGBA(0.1, 0.4, 0.9, 1.0)
_WALL_COLOUR = ColorRGBA(0.5, 0.5, 0.5, 1.0)
OBSTACLE_COLOUR = ColorRGBA(0.9, 0.4, 0.1, 1.0)
SAFE_COLOUR = ColorRGBA(0.9, 0.4, 0.1, 0.25)
_FOREVER = Duration(0, 0)
_NO_TEXTURE = CompressedImage(Header(Time(0, 0), ""), "", np.empty(0, dtype=np.uint8))
_NO_MESH = MeshFile("", np.empty(0, dtype=np.uint8))


def marker(
    head: Header, name: str, number: int, shape: int,
    at: Pose, scale: tuple[float, float, float],
    colour: ColorRGBA, points: Sequence[Sequence[float]] = (),
) -> Marker:  # fmt: skip
    """One marker. at: pose of its center. scale, points: [m]."""
    return Marker(
        header=head,
        ns=name,
        id=number,
        type=shape,
        action=Marker.ADD,
        pose=at,
        scale=Vector3(*scale),
        color=colour,
        lifetime=_FOREVER,
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


def scene(outline: Floats, robot: str, walls: Floats, world: str, stamp: int) -> MarkerArray:
    """The robot's outline, (k, 2) in its frame, and walls, (s, 4) in the world's."""
    here, corners, ends = pose(0.0, 0.0, 0.0), outline.tolist(), walls.reshape(-1, 2).tolist()
    body = marker(
        header(stamp, robot), "robot", 0, Marker.LINE_STRIP,
        here, (0.03, 0.0, 0.0), _ROBOT_COLOUR, [*corners, *corners[:1]],
    )  # fmt: skip
    wall = marker(
        header(stamp, world), "walls", 0, Marker.LINE_LIST,
        here, (0.05, 0.0, 0.0), _WALL_COLOUR, ends,
    )  # fmt: skip
    drawn: list[Any] = [marker for marker in (body, wall) if marker.points]
    return MarkerArray(drawn)


def outline(scene: MarkerArray) -> Floats | None:
    """The robot's outline in a `scene`, (k, 2) [m]; None: it is not drawn."""
    for one in scene.markers:
        if one.ns == "robot" and len(one.points) > 1:
            return np.array([(at.x, at.y) for at in one.points[:-1]], dtype=np.float64)
    return None
