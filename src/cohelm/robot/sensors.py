"""A robot's sensors, as described in YAML, and as numbers for compiled code."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Annotated, Any, NamedTuple, Self, cast

import numpy as np
from pydantic import Field, model_validator

from cohelm.core.schema import Schema
from cohelm.core.types import Floats, Pose

AtLeast0 = Annotated[float, Field(ge=0.0)]
TimeOut = Annotated[float, Field(gt=0.0, le=5.0)]
"""More is milliseconds: a robot would drive by what it saw minutes ago."""


class FloorModel(Schema):
    """Floor that a depth camera or 3D LiDAR sees all the time, unless there is none: a stair, the
    end of a ramp. Where it is not seen counts as standing."""

    from_m: Annotated[float, Field(gt=0.0)]
    """From so far from the sensor..."""
    to_m: Annotated[float, Field(gt=0.0)]
    """... to so far, in all of its field of view, it sees the floor."""
    drop_m: Annotated[float, Field(gt=0.0)] = 0.05
    """What is so far below is not the floor; what is higher is, up to the height band."""
    cell_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.05
    """It is looked at in cells so long: longer than from one of the sensor's points on the floor
    to the next."""
    height_m: float = 0.0
    """Of the floor above the body's origin."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.from_m + 2.0 * self.cell_m <= self.to_m:
            raise ValueError("floor: from from_m to to_m there must be two cells at least")
        return self


_IN_RADIANS = frozenset(
    form(turn * 10**digits) / 10**digits
    for turn in (0.5 * math.pi, math.pi)
    for digits in range(2, 18)
    for form in (round, math.floor)
)
"""A quarter and half of a turn, rounded or cut off as one writes them: no such yaw in degrees."""
_FINE_DEG = 2.0
"""Angle between the beams of a range sensor's cone, where their number is not given."""


class LidarModel(Schema):
    """A planar LiDAR."""

    name: Annotated[str, Field(pattern="^([a-z][a-z0-9_]*)?$")] = ""
    """What to call it where there are several: its scans, topics and faults are named so."""
    beams: Annotated[int, Field(ge=1, le=100_000)] = 720
    """Beams per scan."""
    field_of_view_deg: Annotated[float, Field(ge=0.001, le=360.0)] = 270.0
    """Angle from the first beam to the last, the middle straight ahead of the sensor; 360: evenly
    all round, the last beam one step short of the first."""
    range_min_m: Annotated[float, Field(ge=0.0)] = 0.06
    """Nearer surfaces are seen, but not measured."""
    range_max_m: Annotated[float, Field(gt=0.0)] = 10.0
    """Farther surfaces are not seen."""
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0
    """Scans per second."""
    noise_m: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of a range."""
    dropout: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Share of beams that return nothing although they hit something."""
    sweep_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """From a scan's first beam to its last; 0 for all at one instant."""
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """From a scan's last beam to its reading."""
    mount_x_m: float = 0.0
    """Where it is mounted: forward of the body's origin."""
    mount_y_m: float = 0.0
    """Where it is mounted: left of the body's origin."""
    mount_yaw_deg: float = 0.0
    """Where it looks: counter-clockwise from the body's forward axis."""
    mount_z_m: float | None = None
    """Where it is mounted: above the body's origin. What a LiDAR remembers of what it does not see
    any more goes when another sees past it, if both heights are given and the same."""
    timeout_s: TimeOut | None = None
    """Without a scan for so long, counted from the last beam, the robot stops; without it, after
    three scans that are missing."""

    height_band_m: tuple[float, float] | None = None
    """Over ROS 2: its scans are made of point clouds, of what they show from the first to the
    second height above the body's origin; without it, it is planar. Simulated, it is planar."""
    depth_image: bool = False
    """Over ROS 2: they are made of depth images instead, and the field of view and mount are those
    of the camera. Needs a height_band_m."""
    whole_from_m: AtLeast0 = 0.0
    """Nearer than this it does not see all of its height band: what stood there stays, though its
    beams go past it. Of depth images worked out from the camera, if that is more."""
    floor: FloorModel | None = None
    """Over ROS 2: which floor it sees, if it shall notice where there is none. Needs a
    height_band_m."""
    range_sensor: bool = False
    """It is a sonar or an infrared one and measures one range for all of its field of view: all
    across that something counts as standing. Only under further_lidars."""
    forget_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 10.0
    """What a range sensor does not see any more counts for so long: nobody knows where in its
    field of view it was."""

    @model_validator(mode="before")
    @classmethod
    def _as_fine(cls, given: Any) -> Any:
        """A range sensor has as many beams as its field of view needs."""
        if not isinstance(given, dict):
            return given
        keys = cast("dict[str, Any]", given)
        band = keys.get("height_band_m")
        if isinstance(band, list):  # what JSON has for a tuple, which a strict check takes from it
            keys = keys | {"height_band_m": tuple(cast("list[Any]", band))}
        view = keys.get("field_of_view_deg")
        if keys.get("range_sensor") is not True or "beams" in keys:
            return keys
        if not isinstance(view, int | float) or not 0.0 < view <= 180.0:
            raise ValueError("range_sensor needs a field_of_view_deg of up to 180: of its cone")
        return keys | {"beams": max(math.ceil(view / _FINE_DEG), 2) + 1}

    @model_validator(mode="after")
    def _in_its_units(self) -> Self:
        """Refuse values that only a wrong unit explains."""
        view, farthest = self.field_of_view_deg, self.range_max_m
        if self.beams > 1 and view < 6.4 and not self.range_sensor:
            looks = f"{view:g} looks like radians ({math.degrees(view):.0f} deg)"
            raise ValueError(f"field_of_view_deg is in degrees; {looks}")
        yaw = self.mount_yaw_deg
        if abs(yaw) in _IN_RADIANS:
            looks = f"{yaw:g} looks like radians ({math.degrees(yaw):.0f} deg)"
            raise ValueError(f"mount_yaw_deg is in degrees; {looks}")
        top = 0.0 if self.height_band_m is None else self.height_band_m[1]
        for key, value, most in (
            ("range_max_m", farthest, 600.0), ("range_min_m", self.range_min_m, 10.0),
            ("noise_m", self.noise_m, 1.0), ("height_band_m", top, 20.0),
        ):  # fmt: skip
            if value > most:
                looks = f"{value:g} looks like millimetres ({value / 1000.0:g} m)"
                raise ValueError(f"{key} is in metres; {looks}")
        if self.rate_hz < 1.0:
            seldom = f"every {1.0 / self.rate_hz:g} s is too seldom to drive by"
            raise ValueError(f"rate_hz is in scans per second; one {seldom}")
        return self

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.height_band_m is not None and self.height_band_m[0] >= self.height_band_m[1]:
            raise ValueError("height_band_m must be the lower height, then the upper one")
        if self.depth_image and self.height_band_m is None:
            raise ValueError("depth_image needs a height_band_m: which heights count")
        if self.floor is not None:
            if self.height_band_m is None:
                raise ValueError("floor needs a height_band_m: a planar LiDAR sees no floor")
            if self.floor.height_m >= self.height_band_m[0]:
                raise ValueError("floor.height_m must be below the height_band_m")
            if self.floor.to_m > self.range_max_m:
                raise ValueError("floor.to_m must not be farther than range_max_m")
        if self.whole_from_m > 0.0 and self.height_band_m is None:
            raise ValueError("whole_from_m needs a height_band_m: a planar LiDAR has none to miss")
        if self.range_sensor and self.height_band_m is not None:
            raise ValueError("range_sensor has no height_band_m: it measures one range")
        fixed = self.range_sensor and self.range_min_m == self.range_max_m
        if self.range_min_m >= self.range_max_m and not fixed:
            raise ValueError("range_min_m must be smaller than range_max_m")
        if self.sweep_s * self.rate_hz > 1.0:
            raise ValueError("sweep_s must not be longer than the time between two scans")
        return self

    @property
    def timeout(self) -> float:
        """Age of its newest scan's first beam beyond which the robot stops [s]."""
        return self.timeout_s or 3.5 / self.rate_hz + self.sweep_s + self.latency_s

    @property
    def mount(self) -> Pose:
        """In the body's frame."""
        return Pose(self.mount_x_m, self.mount_y_m, math.radians(self.mount_yaw_deg))

    def lidar(self) -> Lidar:
        """The same as numbers for compiled code."""
        view = math.radians(self.field_of_view_deg)
        # the last beam of a full circle would be the first one again
        gaps = self.beams if self.field_of_view_deg == 360.0 else self.beams - 1
        step = view / max(gaps, 1)
        first = -0.5 * step * (self.beams - 1)
        bearings = first + step * np.arange(self.beams)
        if self.dropout in (0.0, 1.0):
            lost = math.inf if self.dropout else -math.inf
        else:
            lost = NormalDist().inv_cdf(self.dropout)
        ground = (
            (math.nan, math.nan) if self.floor is None else (self.floor.from_m, self.floor.to_m)
        )
        return Lidar(
            self.mount,
            first, step, self.range_min_m, self.range_max_m, self.noise_m, lost,
            np.column_stack((np.cos(bearings), np.sin(bearings))),
            max(self.whole_from_m, 0.0 if self.floor is None else self.floor.from_m), *ground,
        )  # fmt: skip


def of_sensor(name: str, text: str) -> str:
    """A sentence about a LiDAR, with its name if it has one."""
    return f"{name} LiDAR: {text}" if name else text


class Lidar(NamedTuple):
    """A planar LiDAR as numbers; beams run counter-clockwise."""

    mount: Pose
    """Pose of the sensor in the body frame."""
    first: float
    """Bearing of beam 0 in the sensor frame [rad]."""
    step: float
    """Angle from one beam to the next, > 0 [rad]."""
    range_min: float
    """[m]"""
    range_max: float
    """[m]"""
    noise: float
    """Standard deviation of a range [m]."""
    lost: float
    """A beam is lost where its standard normal number is below this."""
    beams: Floats
    """Direction of each beam in the sensor frame, unit vectors, (n, 2)."""
    whole_from: float = 0.0
    """Obstacles nearer than this may be below the beams [m]."""
    floor_from: float = math.nan
    """Least distance at which it sees the floor [m]; NaN: it does not look for that."""
    floor_to: float = math.nan
    """Largest distance at which it sees the floor [m]."""


_ROOM = 0.25
"""Margin beside a driving robot within which floor is seen before the robot gets there [m]."""


def vouched_floor(lidar: Lidar, outline: Floats, least: float) -> float:
    """Distance around a robot within which there has to be floor where it is switched on, as its
    sensor can not see it there [m]: to where the view of that sensor is as wide as the robot, with
    a margin.

    outline: (k, 2) of the robot [m]. least: lower bound of the result [m].
    """
    half = min(0.5 * lidar.step * (len(lidar.beams) - 1), 0.5 * math.pi)
    wide = float(np.abs(outline[:, 1]).max()) + _ROOM
    r = max(lidar.floor_from, wide / math.sin(half))
    ends = [lidar.mount.psi + side * half for side in (-1.0, 1.0)]
    x, y = lidar.mount.x, lidar.mount.y
    return max(least, *(math.hypot(x + r * math.cos(a), y + r * math.sin(a)) for a in ends))


class OdometryModel(Schema):
    """Pose and twist from wheel encoders and a gyro, and how wrong they are."""

    rate_hz: Annotated[float, Field(ge=1.0, le=10_000.0)] = 50.0
    """Readings per second."""
    distance_error: AtLeast0 = 0.0
    """Standard deviation of a constant scale error of each wheel, as a share."""
    slip: AtLeast0 = 0.0
    """Standard deviation of a random error of each wheel's way, in metres per square root metre."""
    gyro_drift_degps: AtLeast0 = 0.0
    """Standard deviation of a constant error of the yaw rate."""
    gyro_noise_degps: AtLeast0 = 0.0
    """Standard deviation of each reading of the yaw rate."""


class CameraModel(Schema):
    """A forward-looking camera."""

    width: Annotated[int, Field(ge=16, le=4096)] = 640
    """Pixels."""
    height: Annotated[int, Field(ge=16, le=4096)] = 480
    """Pixels."""
    field_of_view_deg: Annotated[float, Field(gt=1.0, lt=170.0)] = 60.0
    """Vertical angle of view."""
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 15.0
    """Frames per second."""
    mount_x_m: float = 0.0
    """Forward of the body's origin."""
    mount_z_m: Annotated[float, Field(gt=0.0)] = 0.5
    """Above the floor."""
    tilt_deg: float = 0.0
    """Downwards from level."""
