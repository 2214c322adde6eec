"""A robot as described in YAML: outline, wheels, limits, sensors."""

from __future__ import annotations

import math
from importlib.resources import files
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, ValidationError, field_validator, model_validator

from cohelm.core.errors import CohelmError
from cohelm.core.schema import Schema, first_fault
from cohelm.core.types import Floats
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.robot.footprint import chord, convex_outline, farthest_corner, outside
from cohelm.robot.limits import LARGEST, Limits, checked_limits, ramps, speeds, unlimited
from cohelm.robot.sensors import CameraModel, LidarModel, OdometryModel, of_sensor

Speed = Annotated[float, Field(gt=0.0, le=LARGEST["speed"])]
UpTo100 = Annotated[float, Field(gt=0.0, le=LARGEST["acceleration"])]
"""More is millimetres, or degrees a second squared: a filter would count on such brakes."""
Corner = Annotated[list[float], Field(min_length=2, max_length=2)]


LONGEST_DELAY = 1.0
"""From a command to the wheels [s]."""
BEYOND = 1.0
"""Largest distance of a LiDAR or contact sensor beyond the outline's reach, on a boom [m]."""
_SMALLEST = 0.01
"""No robot is shorter [m]."""
_WIDE, _NARROW = 3.0, 20.0
"""No wheels are farther apart than so many times the robot's width, not even those that a
controller of one that skids counts with; and no robot is wider than so many times their distance:
one of both is in centimetres."""
_HIGH = 5.0
"""Largest height of a sensor on a mast [m]."""
_GRIP = 10.0
"""No wheels brake harder on a floor [m/s^2]."""
_INWARDS = 3.0
"""What has so many times as much of the robot before it as behind it faces into it."""


class LimitsModel(Schema):
    """What drives and wheels can do; leave out what is not limited."""

    speed_mps: Speed | None = None
    """Largest forward or backward speed."""
    acceleration_mps2: UpTo100 | None = None
    """Largest change of speed."""
    yaw_rate_radps: Annotated[float, Field(gt=0.0, le=LARGEST["yaw_rate"])] | None = None
    """Largest yaw rate."""
    yaw_acceleration_radps2: UpTo100 | None = None
    """Largest change of yaw rate."""
    wheel_speed_mps: Speed | None = None
    """Largest speed of a wheel's rim."""
    wheel_acceleration_mps2: UpTo100 | None = None
    """Largest acceleration of a wheel's rim."""


class RobotModel(Schema):
    """A differential-drive robot; the origin of its body frame is the middle of the wheel axle.

    `load_robot` makes one of a YAML file and `of` one of numbers; both raise CohelmError for what
    is no robot. Made by keywords, as below, it raises pydantic's ValidationError, a ValueError.
    """

    name: str
    """What to call it."""
    note: str = ""
    """Where the numbers come from."""
    footprint_m: Annotated[list[Corner], Field(min_length=3)]
    """Corners [x, y] of the convex outline in their order, x forward and y left; kept
    counter-clockwise."""
    least_footprint_m: Annotated[list[Corner], Field(min_length=3)] | None = None
    """Corners of the bare robot: an outline that changes must contain it. Without it, footprint_m
    half as large."""
    track_m: Annotated[float, Field(gt=0.0, le=LARGEST["track"])]
    """Distance between the two driven wheels."""
    wheel_radius_m: Annotated[float, Field(gt=0.0, le=5.0)]
    """Radius of the driven wheels."""
    axle_x_m: Annotated[float, Field(ge=-2.0, le=2.0)] = 0.0
    """Where the middle of the wheel axle is in the frame that ROS calls the base."""
    height_m: Annotated[float, Field(gt=0.0, le=20.0)] = 0.5
    """Height of the body."""
    mass_kg: Annotated[float, Field(gt=0.0, le=1e6)] = 40.0
    """Mass, all in all."""
    limits: LimitsModel = LimitsModel()
    """Speed and acceleration limits."""
    delay_s: Annotated[float, Field(ge=0.0, le=LONGEST_DELAY)] = 0.0
    """From a command to the wheels."""
    odometry: OdometryModel = OdometryModel()
    """Pose and twist from the wheels."""
    lidar: LidarModel | None = None
    """The planar LiDAR, if there is one. Of several, the one that the robot finds its place by."""
    further_lidars: tuple[LidarModel, ...] = ()
    """Further planar LiDARs, each with a name of its own. What any of them sees counts; without
    the scans of any of them the robot stops."""
    bumpers: tuple[ContactModel, ...] = ()
    """Bumpers. Driven against something with one, the robot stops, and from then on only drives
    away from it while it is pressed; without the messages of any of them it stops."""
    cliff_sensors: tuple[CliffModel, ...] = ()
    """Sensors that look down, for which the same holds where there is no floor."""
    camera: CameraModel | None = None
    """The camera, if there is one."""

    @field_validator("footprint_m", "least_footprint_m")
    @classmethod
    def _convex(cls, corners: list[Corner] | None) -> list[Corner] | None:
        try:
            return None if corners is None else convex_outline(corners).tolist()
        except CohelmError as error:
            raise ValueError(str(error)) from error

    @field_validator("footprint_m")
    @classmethod
    def _large_enough(cls, corners: list[Corner]) -> list[Corner]:
        if (long := float(np.ptp(corners, axis=0).max())) < _SMALLEST:
            raise ValueError(
                f"corners are in metres, and this outline is {long:.1g} m long: was it divided by "
                "1000 twice?"
            )
        return corners

    @field_validator("name")
    @classmethod
    def _not_empty(cls, name: str) -> str:
        if not name.strip():
            raise ValueError("must not be empty: page, log and records call the robot by it")
        return name

    @model_validator(mode="after")
    def _named(self) -> Self:
        if self.further_lidars and self.lidar is None:
            raise ValueError("further_lidars need a lidar: the first one is described there")
        names = [lidar.name for lidar in self.lidars]
        if "" in names[1:] or len(set(names)) < len(names):
            raise ValueError("each of further_lidars needs a name of its own")
        if self.lidar is not None and self.lidar.range_sensor:
            raise ValueError("lidar can not be a range_sensor: put that under further_lidars")
        touching = [one.name for one in self.contacts]
        if len(set(touching)) < len(touching):
            raise ValueError("each of bumpers and cliff_sensors needs a name of its own")
        return self

    @model_validator(mode="after")
    def _contained(self) -> Self:
        if outside(self.least_outline, self.outline).any():
            raise ValueError(
                "least_footprint_m must lie within footprint_m, which counts until the outline "
                "changes"
            )
        return self

    @model_validator(mode="after")
    def _of_one_unit(self) -> Self:
        """Refuse an outline or wheels in centimetres, which bounds in metres do not tell."""
        (long, wide), track = np.ptp(self.outline, axis=0), self.track_m
        if track > _WIDE * wide:
            raise ValueError(
                f"track_m is in metres; {track:g} m is far wider than footprint_m, {wide:g} m"
            )
        if wide > _NARROW * track:
            raise ValueError(
                f"footprint_m is in metres; the robot is {wide:g} m wide, and its wheels are "
                f"{track:g} m apart: divide centimetres by 100"
            )
        if self.wheel_radius_m > max(long, wide):
            raise ValueError(
                f"wheel_radius_m is in metres; {self.wheel_radius_m:g} m is larger than the robot"
            )
        return self

    @model_validator(mode="after")
    def _mounted(self) -> Self:
        """Refuse mounts outside of the robot, as those in millimetres are."""
        heights = [(of_sensor(one.name, ""), one.mount_z_m or 0.0) for one in self.lidars]
        if self.camera is not None:
            heights.append(("camera: ", self.camera.mount_z_m))
        for whose, z in heights:
            if abs(z) > max(self.height_m + BEYOND, _HIGH):
                where = "above" if z > 0.0 else "below"
                raise ValueError(
                    f"{whose}mount_z_m is in metres; {z:g} m is far {where} the robot (height_m "
                    f"{self.height_m:g})"
                )
        for one in (*self.lidars, *self.contacts):
            away = math.hypot(one.mount_x_m, one.mount_y_m)
            if away > self.reach + BEYOND:
                problem = (
                    "mount_x_m and mount_y_m are in metres, from the middle of the axle; "
                    f"{away:g} m is outside of the robot"
                )
                if isinstance(one, LidarModel):
                    raise ValueError(of_sensor(one.name, problem))
                raise ValueError(f"{one.label}: {problem}")
        for one in self.contacts:
            yaw = math.radians(one.mount_yaw_deg)
            behind, ahead = chord(self.outline, one.mount_x_m, one.mount_y_m, yaw)
            if ahead > max(behind, -_INWARDS * behind, 0.0):
                raise ValueError(
                    f"{one.label}: it faces into the robot: mount_yaw_deg is the direction it "
                    "faces, in degrees, outwards (180 is behind, 90 on the left)"
                )
        return self

    @property
    def lidars(self) -> tuple[LidarModel, ...]:
        """All LiDARs, the first one first; empty where there is none."""
        return () if self.lidar is None else (self.lidar, *self.further_lidars)

    @property
    def contacts(self) -> tuple[ContactModel, ...]:
        """All bumpers and cliff sensors."""
        return (*self.bumpers, *self.cliff_sensors)

    @classmethod
    def of(
        cls, name: str, outline: ArrayLike, limits: Limits, *, delay: float = 0.0,
        lidar: LidarModel | None = None,
    ) -> RobotModel:  # fmt: skip
        """From numbers instead of YAML keys.

            >>> import cohelm
            >>> limits = cohelm.Limits(1.0, acceleration=2.0, yaw_rate=2.0, yaw_acceleration=6.0)
            >>> cart = cohelm.RobotModel.of("cart", [[0.3, 0.2], [-0.3, 0], [0.3, -0.2]], limits)
            >>> cart.reach < 0.37
            True

        outline: corners [x, y] in the body frame [m]. limits: inf where there is none. delay: from
        a command to its first effect [s]. Raises CohelmError for what is no robot.
        """
        numbers = checked_limits(limits)
        keys = dict(zip(LimitsModel.model_fields, numbers[:6], strict=True))
        corners = convex_outline(outline)
        wide = float(np.ptp(corners[:, 1]))
        *_, given = limits
        track = wide if math.isnan(given) else numbers.track
        try:
            return cls(
                name=name, footprint_m=corners.tolist(), track_m=track,
                wheel_radius_m=min(0.1, wide), delay_s=delay, lidar=lidar,
                limits=LimitsModel.model_validate(
                    {key: value for key, value in keys.items() if value < math.inf}
                ),
            )  # fmt: skip
        except ValidationError as error:
            fault = error.errors()[0]
            got = f", got {fault['input']!r}" if fault["loc"] else ""
            raise CohelmError(f"{first_fault(error)}{got}") from error

    @property
    def scan_age(self) -> float:
        """Age of a LiDAR's first beam when its next scan is there [s]; 0 without a LiDAR."""
        ages = (1.0 / one.rate_hz + one.sweep_s + one.latency_s for one in self.lidars)
        return max(ages, default=0.0)

    @property
    def outline(self) -> Floats:
        """The footprint as an array, (k, 2) [m]."""
        return np.array(self.footprint_m, dtype=np.float64)

    @property
    def least_outline(self) -> Floats:
        """What an outline that changes must contain, (k, 2) [m]."""
        if self.least_footprint_m is not None:
            return np.array(self.least_footprint_m, dtype=np.float64)
        outline, axle = self.outline, np.zeros((1, 2))
        middle = outline.mean(axis=0) if outside(axle, outline)[0] else axle[0]
        return middle + 0.5 * (outline - middle)

    def checked_outline(self, corners: ArrayLike) -> Floats:
        """An outline that the robot reports, as compiled code needs it, (k, 2) [m]. Raises
        CohelmError for what is none, or is too small for the robot."""
        made, least = convex_outline(corners), self.least_outline
        missing = outside(least, made)
        if missing.any():
            x, y = least[int(missing.argmax())]
            raise CohelmError(
                f"the outline leaves out [{x:.2g}, {y:.2g}], which is part of the robot: if it can "
                "be so small, give the bare robot as least_footprint_m in its file"
            )
        return made

    @property
    def reach(self) -> float:
        """Distance from the body origin to the farthest corner [m]."""
        return farthest_corner(self.outline)

    def bounds(self, *, enforced: bool = True) -> Limits:
        """The limits as numbers; without `enforced` those of an ideal unicycle."""
        if not enforced:
            return unlimited(self.track_m)
        given = self.limits
        return Limits(
            speed=given.speed_mps or math.inf,
            acceleration=given.acceleration_mps2 or math.inf,
            yaw_rate=given.yaw_rate_radps or math.inf,
            yaw_acceleration=given.yaw_acceleration_radps2 or math.inf,
            wheel_speed=given.wheel_speed_mps or math.inf,
            wheel_acceleration=given.wheel_acceleration_mps2 or math.inf,
            track=self.track_m,
        )


def checked_sight(model: RobotModel) -> RobotModel:
    """The same robot, if it stops from full speed within what its LiDARs see ahead. Raises
    CohelmError if not: what it sees too late it would drive into.

    Of a robot that has no limit of speed or brakes, or looks ahead with nothing, nothing is said.
    """
    bounds = model.bounds()
    speed, brakes = speeds(bounds)[0], ramps(bounds)[0]
    looks = [
        one.range_max_m + one.mount_x_m for one in model.lidars
        if not one.range_sensor
        and abs(math.remainder(one.mount_yaw_deg, 360.0)) <= 0.5 * one.field_of_view_deg
    ]  # fmt: skip
    if not looks or math.isinf(speed) or math.isinf(brakes):
        return model
    sees, late = max(looks) - float(model.outline[:, 0].max()), model.delay_s + model.scan_age
    needs = speed * late + 0.5 * speed**2 / brakes
    if needs > sees:
        most = brakes * (math.sqrt(late**2 + 2.0 * max(sees, 0.0) / brakes) - late)
        raise CohelmError(
            f"{model.name} sees {sees:.2g} m ahead, and from {speed:g} m/s stops after "
            f"{needs:.2g} m: set limits.speed_mps to {math.floor(100.0 * most) / 100.0:g} at most"
        )
    return model


def doubts(model: RobotModel) -> list[str]:
    """What no real robot has, and yet this one by its file: a sentence each."""
    said = list[str]()
    if model.delay_s == 0.0:
        said.append("its file has no delay_s, which every robot has: measure it (cohelm calibrate)")
    exact = [one for one in model.lidars if one.noise_m == 0.0 and not one.range_sensor]
    if exact:
        said.append(of_sensor(
            exact[0].name, "its file has no noise_m: that a scan repeats is not noticed"
        ))  # fmt: skip
    wide = float(np.ptp(model.outline[:, 1]))
    if model.track_m > 1.1 * wide:
        said.append(
            f"its wheels, track_m {model.track_m:g} m apart, stand out of its footprint_m, {wide:g}"
            " m wide: what stands out is not kept clear"
        )
    brakes = ramps(model.bounds())[0]
    if _GRIP < brakes < math.inf:
        said.append(
            f"it brakes with {brakes:g} m/s^2 by its file, and no wheels do with more than some "
            f"{_GRIP:g}: measure it (cohelm calibrate)"
        )
    return said


SHIPPED = (
    "sally", "sally-rear", "sally-depth", "jackal", "husky", "dingo_d", "rosbot",
    "turtlebot3_burger", "turtlebot3_waffle", "turtlebot4", "mir100",
)  # fmt: skip
"""Robots that come with the package, by the names a scenario may use."""


def shipped_path(name: str) -> str:
    """The YAML file of a shipped robot."""
    return str(files("cohelm.robot") / "models" / f"{name}.yaml")
