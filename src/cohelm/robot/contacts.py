"""Bumpers and cliff sensors, as described in YAML: each is on or off."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from cohelm.core.schema import Schema
from cohelm.robot.sensors import TimeOut

Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]


class ContactModel(Schema):
    """A bumper, or any other sensor that says whether it touches something."""

    name: Name
    """What to call it, as no other bumper or cliff sensor: its topic and reasons are named so."""
    mount_x_m: float
    """Its middle: forward of the body's origin."""
    mount_y_m: float = 0.0
    """Its middle: left of the body's origin."""
    mount_yaw_deg: float = 0.0
    """Which way it faces, outwards: counter-clockwise from the body's forward axis."""
    width_m: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    """How wide it is, crosswise to that."""
    timeout_s: TimeOut = 0.5
    """Without a message for so long the robot stops."""
    hazard: str | None = None
    """Over ROS 2: it is on while this frame is in an irobot_create_msgs/msg/HazardDetectionVector;
    without it, its messages are std_msgs/msg/Bool."""

    @property
    def label(self) -> str:
        """Its name in messages."""
        return f"{self.name} bumper"

    @property
    def on(self) -> str:
        """Text of a message while it is on."""
        return f"the {self.label} is pressed"

    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The ends of the line that it covers, in the body frame [m]."""
        yaw, half = math.radians(self.mount_yaw_deg), 0.5 * self.width_m
        x, y = -half * math.sin(yaw), half * math.cos(yaw)
        return (self.mount_x_m + x, self.mount_y_m + y), (self.mount_x_m - x, self.mount_y_m - y)


class CliffModel(ContactModel):
    """A sensor that looks down: it is on where there is no floor."""

    floor_m: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    """Over ROS 2: it measures a range (sensor_msgs/msg/Range), and from it to the floor it is so
    far; without it, its messages are std_msgs/msg/Bool, true where there is no floor."""
    drop_m: Annotated[float, Field(gt=0.0, le=1.0)] = 0.03
    """What is so much farther away is not the floor."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.hazard is not None and self.floor_m is not None:
            raise ValueError("give hazard or floor_m, not both: its messages are of one type")
        return self

    @property
    def label(self) -> str:
        """Its name in messages."""
        return f"{self.name} cliff sensor"

    @property
    def on(self) -> str:
        """Text of a message while it is on."""
        return f"the {self.label} sees no floor"
