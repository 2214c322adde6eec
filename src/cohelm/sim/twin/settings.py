"""What a user may set of the twin: the ground, the drives, and other sensors' errors."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.schema import Schema, first_fault
from cohelm.robot.model import RobotModel

_AtLeast0 = Annotated[float, Field(ge=0.0)] | None


class TwinModel(Schema):
    """The physics of the twin; sensor errors replace the robot's own where they are given."""

    friction: Annotated[float, Field(gt=0.0, le=5.0)] = 0.8
    """Coefficient of friction between the driven wheels and the floor; low makes them slip."""
    wheel_lag_s: Annotated[float, Field(ge=0.005, le=1.0)] = 0.02
    """Time constant with which a wheel follows the speed that its drive is told."""
    torque_margin: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    """Largest torque of a drive, as a multiple of what the wheels' largest acceleration takes."""
    rolling_resistance: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    """Force that rolling takes, as a share of the weight."""
    lidar_noise_m: _AtLeast0 = None
    """Standard deviation of a range, instead of the robot's own."""
    lidar_dropout: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Share of beams that return nothing, instead of the robot's own."""
    lidar_rate_hz: Annotated[float, Field(gt=0.0)] | None = None
    """Scans per second, instead of the robot's own."""
    lidar_sweep_s: _AtLeast0 = None
    """From a scan's first beam to its last, instead of the robot's own."""
    lidar_latency_s: _AtLeast0 = None
    """From a scan's last beam to the reading, instead of the robot's own."""
    odometry_distance_error: _AtLeast0 = None
    """Standard deviation of each wheel's constant scale error, instead of the robot's own."""
    odometry_slip: _AtLeast0 = None
    """Random error of each wheel's way [m per square root of m], instead of the robot's own."""
    gyro_drift_degps: _AtLeast0 = None
    """Standard deviation of the constant error of the yaw rate, instead of the robot's own."""
    gyro_noise_degps: _AtLeast0 = None
    """Standard deviation of each reading of the yaw rate, instead of the robot's own."""

    def fitted(self, robot: RobotModel) -> RobotModel:
        """The robot with the sensor errors that are given here.

        Raises CohelmError where they do not fit the robot's own.
        """
        changed: dict[str, Any] = robot.model_dump()
        lidars = [one for one in (changed["lidar"], *changed["further_lidars"]) if one]
        for key, value in self.model_dump(exclude_none=True).items():
            sensor, _, own = key.partition("_")
            if sensor == "lidar":
                for one in lidars:
                    one[own] = value
            elif sensor in ("odometry", "gyro"):  # a gyro's keys are the odometry's
                changed["odometry"][key.removeprefix("odometry_")] = value
        try:
            return RobotModel.model_validate(changed)
        except ValidationError as error:
            raise CohelmError(
                f"simulation.twin: makes an impossible robot: {first_fault(error)}"
            ) from error


def lag(model: RobotModel, physics: TwinModel, dt: float) -> float:
    """From a command to its effect, as the guard has to predict it [s].

    Delay and lag of the drives add up; and speed follows a straight line through a control step, at
    whose beginning the guard takes it to be reached: half a step more.
    """
    return model.delay_s + physics.wheel_lag_s + 0.5 * dt
