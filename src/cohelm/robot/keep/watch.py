"""The monitors of a robot: by default all that its sensors allow."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.types import Floats
from cohelm.robot.collision_monitor.monitor import CollisionMonitor, Described
from cohelm.robot.collision_monitor.returns import Sensor
from cohelm.robot.contact_monitor import ContactMonitor
from cohelm.robot.gate.gate import GateRules
from cohelm.robot.model import RobotModel
from cohelm.robot.monitor import Monitor
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.robot.sensors import LidarModel, vouched_floor


def monitors(model: RobotModel, rules: GateRules) -> tuple[Monitor, ...]:
    """New monitors, without history."""
    found: list[Monitor] = [PlausibilityMonitor(model)]
    if model.lidar is not None:
        found.append(CollisionMonitor(described(model, rules)))
    if model.contacts:
        found.append(ContactMonitor(model))
    return tuple(found)


def described(model: RobotModel, rules: GateRules) -> Described:
    """What the collision monitor needs to know of a robot with a LiDAR."""
    if model.lidar is None:
        raise ValueError("a robot without a LiDAR has no collision monitor")
    sensors = tuple(_sensor(given, model.outline) for given in model.lidars)
    return Described(model.outline, sensors, rules.bounds, model.delay_s, rules.period, rules.age)


def _sensor(given: LidarModel, outline: Floats) -> Sensor:
    lidar = given.lidar()
    bearings = lidar.first + lidar.step * np.arange(given.beams, dtype=np.float64)
    given_height = math.nan if given.mount_z_m is None else given.mount_z_m
    planar = given.height_band_m is None and not given.range_sensor
    height = given_height if planar else math.nan
    return Sensor(
        mount=lidar.mount, bearings=bearings, step=lidar.step, range_min=given.range_min_m,
        noise=given.noise_m, rate=given.rate_hz, sweep=given.sweep_s, latency=given.latency_s,
        name=given.name, timeout=given.timeout_s or math.nan, range_max=given.range_max_m,
        height=height, forgets=given.forget_s if given.range_sensor else math.inf,
        whole_from=lidar.whole_from, floor_from=lidar.floor_from, floor_to=lidar.floor_to,
        vouched=0.0 if given.floor is None else vouched_floor(lidar, outline, 0.0),
    )  # fmt: skip
