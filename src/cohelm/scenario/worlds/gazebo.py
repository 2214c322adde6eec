"""Gazebo worlds (SDF): cylinders, spheres and boxes as a planar robot meets them, and those that a
plugin moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import scipy
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.scenario.worlds.animated import Animation, read_animation, source
from cohelm.scenario.worlds.file import contents

_DEEPEST = 16  # nested models
_GROUND = ("sun", "ground_plane")  # included by every world, and not in the way
_FARTHEST = 1e9  # of a number [m]
_LOW, _HIGH = 0.02, 2.0  # what is wholly below or above is not in the way [m]
_CORNERS = np.array(np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5))).reshape(3, 8)


@dataclass(frozen=True)
class GazeboObstacles:
    """What of a Gazebo world a planar robot can hit, world frame."""

    discs: Floats
    """(n, 6) as in `core.types`, at rest; r_i is the radius plus the reach given."""
    names: tuple[str, ...]
    """Model, link and collision each disc comes from, (n,)."""
    walls: Floats
    """(s, 4) segments: the outlines of boxes, seen from above [m]."""
    left_out: tuple[str, ...]
    """What could not be read, a sentence each: the robot would not know of it."""
    animations: tuple[Animation | None, ...] = ()
    """How each disc moves, (n,); None: it rests."""


def read_gazebo(path: Path | str, reach: float) -> GazeboObstacles:
    """The collision shapes of an SDF world or model, plain or gzip.

    reach: distance kept between the robot's centre and a surface, for the paper's r_i (19) [m].
    Shapes wholly below 2 cm or above 2 m are not in the way. Upright cylinders and spheres become
    discs, all else the outline of its shadow: exact for upright boxes, never too small for tilted
    shapes. Poses saved in `<state>` hold, as they do in Gazebo. What a plugin
    moves from key frame to key frame, as in DynaBARN, is read from the plugin's source, in the
    world's folder or near it; a box that moves becomes the disc around it.
    Planes are ignored; includes, meshes and poses in named frames are listed in `left_out`.

    Raises CohelmError where the file is missing, damaged, not SDF, or holds a bad number.
    """
    try:
        data = contents(path, "a Gazebo .world or .sdf file")
        # DynaBARN's walls are written so, and Gazebo's own reader accepts it too
        root = fromstring(data.replace(b"<pose frame=>", b"<pose>"), forbid_dtd=True)
    except (ParseError, LookupError, ValueError) as error:
        if isinstance(error, DefusedXmlException):
            raise CohelmError(
                f"{path}: declares XML entities or a DTD, which no world needs; remove them"
            ) from error
        raise CohelmError(f"{path}: is not well-formed XML ({error}); export it again") from error
    if root.tag != "sdf":
        raise CohelmError(f"{path}: is <{root.tag}>, not <sdf>; give a Gazebo .world or .sdf file")
    reader = _Reader(str(path), reach)
    worlds = root.findall("world")
    for scene in worlds or [root]:
        reader.saved = _saved(scene)
        for child in scene:
            reader.member(child, np.eye(4), "", 0)
    if not worlds and root.find("model") is None:
        raise CohelmError(f"{path}: holds neither a <world> nor a <model>; is it cut short?")
    return GazeboObstacles(
        np.array(reader.discs, dtype=np.float64).reshape(-1, 6),
        tuple(reader.names),
        np.concatenate([np.empty((0, 4)), *reader.walls]),
        tuple(reader.left_out),
        tuple(reader.animations),
    )


def _saved(world: Element) -> dict[str, Element]:
    """World poses of models and links in the saved state, as "model" and "model/link"."""
    poses: dict[str, Element] = {}
    for model in world.iterfind("state/model"):
        name = model.get("name", "")
        for path, element in [(name, model)] + [
            (f"{name}/{link.get('name', '')}", link) for link in model.iterfind("link")
        ]:
            pose = element.find("pose")
            if pose is not None:
                poses[path] = pose
    return poses


@dataclass
class _Reader:
    """Walks models, links and collisions, and gathers what it meets."""

    file: str
    reach: float
    saved: dict[str, Element] = field(default_factory=dict[str, Element])
    discs: list[tuple[float, ...]] = field(default_factory=list[tuple[float, ...]])
    names: list[str] = field(default_factory=list[str])
    walls: list[Floats] = field(default_factory=list[Floats])
    left_out: list[str] = field(default_factory=list[str])
    animations: list[Animation | None] = field(default_factory=list[Animation | None])
    animation: Animation | None = None
    """Of the model that is being read, from its origin."""

    def member(self, element: Element, parent: Floats, path: str, depth: int) -> None:
        """A child of a world or model."""
        name = element.get("name", "")
        where = f"{path}/{name}" if path else name
        if element.tag == "model":
            self.model(element, parent, where, depth)
        elif element.tag == "link":
            self.link(element, parent, where)
        elif element.tag == "include":
            uri = (element.findtext("uri") or "").strip()
            if uri.rstrip("/").rsplit("/", 1)[-1] not in _GROUND:
                self.left_out.append(f"include of {uri or 'nothing'}: only its own file knows it")
        elif element.tag in ("actor", "population", "road"):
            self.left_out.append(f"{element.tag} {name!r}: not an obstacle this reader knows")

    def model(self, element: Element, parent: Floats, path: str, depth: int) -> None:
        """A model and what is in it."""
        if depth == _DEEPEST:
            raise CohelmError(f"{self.file}: model {path} is nested deeper than {_DEEPEST} models")
        pose = self.pose(element, parent, path)
        if pose is None:
            return
        before = self.animation
        for plugin in element.iterfind("plugin"):
            self.animation = self.moved_by(plugin.get("filename", ""), pose, path) or self.animation
        for child in element:
            self.member(child, pose, path, depth + 1)
        self.animation = before

    def moved_by(self, plugin: str, pose: Floats, path: str) -> Animation | None:
        """How a plugin moves a model; None, and noted, where its source is missing."""
        found = source(Path(self.file), plugin)
        if found is None:
            self.left_out.append(
                f"{path}: what {plugin or 'its plugin'} does is not known, so it stands; "
                "put the plugin's source beside the world"
            )
            return None
        return read_animation(found).moved(-float(pose[0, 3]), -float(pose[1, 3]))

    def link(self, element: Element, parent: Floats, path: str) -> None:
        """A link and its collision shapes."""
        pose = self.pose(element, parent, path)
        if pose is None:
            return
        for collision in element.iterfind("collision"):
            where = f"{path}/{collision.get('name', '')}"
            at = self.pose(collision, pose, where)
            if at is None:
                continue
            for shape in collision.iterfind("geometry/*"):
                self.shape(shape, at, where)

    def pose(self, element: Element, parent: Floats, path: str) -> Floats | None:
        """World pose of an element, (4, 4); None, and noted, where its frame is not known."""
        saved = self.saved.get(path)
        pose_element = element.find("pose") if saved is None else saved
        if pose_element is None:
            return parent
        frame = pose_element.get("relative_to") or pose_element.get("frame") or ""
        if frame == "__model__" and element.tag == "link":
            frame = ""  # the same as none
        if frame not in ("", "world") or element.get("placement_frame"):
            self.left_out.append(f"{path}: its pose is relative to frame {frame!r}")
            return None
        matrix = np.eye(4)
        values = self.numbers(pose_element.text or "0 0 0 0 0 0", f"the pose of {path}")
        matrix[:3, 3] = values[:3]
        if (
            pose_element.get("rotation_format") == "quat_xyzw"
            and len(values) == 7
            and any(values[3:])
        ):
            matrix[:3, :3] = scipy.spatial.transform.Rotation.from_quat(values[3:]).as_matrix()
        elif len(values) == 6:
            degrees = pose_element.get("degrees", "false").lower() in ("true", "1")
            matrix[:3, :3] = scipy.spatial.transform.Rotation.from_euler(
                "xyz", values[3:], degrees=degrees
            ).as_matrix()
        else:
            raise CohelmError(
                f"{self.file}: the pose of {path} needs x y z roll pitch yaw, got "
                f"{pose_element.text!r}"
            )
        # a saved pose is in the world frame already
        return matrix if saved is not None or frame == "world" else parent @ matrix

    def shape(self, shape: Element, pose: Floats, path: str) -> None:
        """A collision shape, as a disc or as walls."""
        if shape.tag in ("plane", "empty"):
            return
        if shape.tag == "box":
            self.shadow(self.sizes(shape, "size", 3, path), pose, path)
        elif shape.tag == "sphere":
            (radius,) = self.sizes(shape, "radius", 1, path)
            self.disc(radius, radius, pose, path)
        elif shape.tag in ("cylinder", "capsule"):
            (radius,) = self.sizes(shape, "radius", 1, path)
            (length,) = self.sizes(shape, "length", 1, path)
            length += 2.0 * radius if shape.tag == "capsule" else 0.0
            if abs(pose[2, 2]) > 1.0 - 1e-9:
                self.disc(radius, 0.5 * length, pose, path)
            else:
                self.shadow([2.0 * radius, 2.0 * radius, length], pose, path)
        else:
            self.left_out.append(f"{path}: a {shape.tag} is not a shape this reader knows")

    def disc(self, radius: float, half_height: float, pose: Floats, path: str) -> None:
        """An upright round shape."""
        x, y, z = (float(value) for value in pose[:3, 3])
        if self.in_the_way(z - half_height, z + half_height):
            self.discs.append((x, y, 0.0, 0.0, radius, radius + self.reach))
            self.names.append(path)
            self.animations.append(self.animation and self.animation.moved(x, y))

    def shadow(self, size: list[float], pose: Floats, path: str) -> None:
        """The outline of a box from above: the hull of its eight corners."""
        corners = pose[:3, :3] @ (_CORNERS * np.array(size)[:, None]) + pose[:3, 3:]
        if self.in_the_way(float(corners[2].min()), float(corners[2].max())):
            flat = corners[:2].T
            try:
                outline = flat[scipy.spatial.ConvexHull(flat).vertices]
            except scipy.spatial.QhullError as error:
                raise CohelmError(f"{self.file}: {path} is too thin to have an outline") from error
            if self.animation is None:
                self.walls.append(np.hstack((outline, np.roll(outline, -1, axis=0))))
                return
            at = pose.copy()
            at[:2, 3] = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
            radius = float(np.hypot(*(outline - at[:2, 3]).T).max())
            self.disc(radius, float(np.ptp(corners[2])) / 2.0, at, path)

    def in_the_way(self, bottom: float, top: float) -> bool:
        """Whether a shape is at the height of the robot."""
        return top > _LOW and bottom < _HIGH

    def sizes(self, shape: Element, key: str, count: int, path: str) -> list[float]:
        """Lengths of a shape, all positive."""
        what = f"the {key} of the {shape.tag} {path}"
        values = self.numbers(shape.findtext(key) or "", what)
        if len(values) != count or min(values) <= 0.0:
            raise CohelmError(f"{self.file}: {what} must be {count} positive number(s) of metres")
        return values

    def numbers(self, text: str, what: str) -> list[float]:
        """Finite numbers from text."""
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = [math.nan]
        if not all(math.isfinite(value) for value in values):
            raise CohelmError(f"{self.file}: {what} must be finite numbers, got {text.strip()!r}")
        if any(abs(value) > _FARTHEST for value in values):
            raise CohelmError(f"{self.file}: {what} must be in metres, got {text.strip()!r}")
        return values
