"""What was found of each LiDAR: planar, of point clouds, of depth images or of single ranges."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.schema import first_fault
from cohelm.core.types import Floats, Pose
from cohelm.robot.sensors import FloorModel, LidarModel
from cohelm.ros import clock, cloud, cone, depth, laser, mismatch
from cohelm.ros.clock import Clock, estimated
from cohelm.ros.found import Allowed, FoundLidar
from cohelm.ros.inspection import Inspection
from cohelm.ros.transforms import Mount

_LATE = 0.005
"""Last beams that seem so far in the future belong to scans that are stamped at their end [s]."""


class DescribedLidar(NamedTuple):
    """A LiDAR as it was found."""

    found: FoundLidar
    model: LidarModel
    """As the robot's description will have it."""
    note: str
    """What it is, in a sentence."""


def describe(
    inspection: Inspection, topic: str, configured: LidarModel | None, allowed: Allowed
) -> DescribedLidar:
    """The LiDAR behind a topic. configured: as the robot's file has it. CohelmError for what does
    not fit."""
    if configured is not None and configured.height_band_m is not None:
        return _cloud(inspection, topic, configured, allowed)
    if configured is not None and configured.range_sensor:
        return _cone(inspection, topic, configured, allowed)
    return _planar(inspection, topic, configured, allowed)


def _planar(
    inspection: Inspection, topic: str, configured: LidarModel | None, allowed: Allowed
) -> DescribedLidar:
    rows = inspection.scans[topic]
    mount = _placed(inspection, topic, configured, allowed)
    scan, rate = rows[-1].message, inspection.rate(rows)
    late, duration = laser.taken(scan, mount)
    ages = [age - duration - late for age in inspection.ages(rows)]
    at_end = -(duration + clock.AHEAD) <= min(ages) < -_LATE
    if at_end:
        ages = [age + duration for age in ages]
    ticks = estimated(ages, topic, allowed.clock, allowed.options.clock)
    try:
        lidar = laser.lidar_model(scan, topic, mount, rate, min(ages) + ticks.ahead, configured)
    except ValidationError as error:
        raise CohelmError(f"{topic}: {first_fault(error)}") from error
    note = (
        f"LiDAR: {topic}, {rate:.1f} Hz, {lidar.beams} beams over "
        f"{lidar.field_of_view_deg:.0f} deg, at x {lidar.mount_x_m:.3f} y "
        f"{lidar.mount_y_m:.3f} m, middle beam at {lidar.mount_yaw_deg:.1f} deg"
        + (", upside down" if mount.upside_down else "")
    )
    return DescribedLidar(
        FoundLidar(topic, inspection.frame(topic), mount, ticks, at_end), lidar, note
    )


def _cloud(
    inspection: Inspection, topic: str, configured: LidarModel, allowed: Allowed
) -> DescribedLidar:
    """One that sends point clouds: field of view and resolution are as described; or depth images,
    whose CameraInfo counts too."""
    rows, body = inspection.scans[topic], inspection.body()
    matrix = _into_body(inspection, topic, allowed)
    ages, rate = inspection.ages(rows), inspection.rate(rows)
    ticks = estimated(ages, topic, allowed.clock, allowed.options.clock)
    x, y, _ = matrix[:3, 3].tolist()
    lidar = configured.model_copy(
        update={
            "rate_hz": rate, "sweep_s": 0.0, "mount_x_m": x, "mount_y_m": y,
            "latency_s": min(max(min(ages) + ticks.ahead, 0.0), 1.0),
        }
    )  # fmt: skip
    camera, what, grain = None, "point cloud", ""
    if infos := inspection.infos.get(topic):
        camera = depth.camera(infos[-1].message, depth.info_topic(topic))
        lidar = depth.described(camera, matrix, lidar, topic)
        ranges = depth.DepthRanges(lidar, camera, matrix, topic)
        what = f"depth image: {camera.width} x {camera.height}"
        grain = (
            f", over {lidar.field_of_view_deg:.0f} deg, middle beam at "
            f"{lidar.mount_yaw_deg:.1f} deg, {1e3 * camera.gap * lidar.range_max_m:.0f} mm "
            f"between rays at {lidar.range_max_m:g} m"
        )
    else:
        ranges = cloud.CloudRanges(lidar, matrix, topic)
    ranges.of(rows[-1].message)
    if lidar.floor is not None and ranges.floor is not None:
        if ranges.floor.begins > lidar.floor.from_m + 1e-6:
            raise _blind(topic, lidar.floor, ranges.floor.begins)
        grain += (
            f"; floor from {lidar.floor.from_m:g} to {lidar.floor.to_m:g} m, of which "
            f"{100.0 * ranges.floor.seen:.0f} % is seen now"
        )
    low, high = configured.height_band_m or (0.0, 0.0)
    note = (
        f"{what}: {topic}, {rate:.1f} Hz, from {low:g} to {high:g} m above {body}, as "
        f"{lidar.beams} beams, at x {x:.3f} y {y:.3f} m{grain}"
    )
    return DescribedLidar(
        _found(topic, inspection.frame(topic), lidar, ticks, matrix, camera), lidar, note
    )


def _blind(topic: str, floor: FloorModel, begins: float) -> CohelmError:
    """A picture that does not show the floor from where it is to be watched."""
    what, cure = "in part of its picture at no distance", "narrow field_of_view_deg, "
    if begins < floor.to_m:
        what = f"in all of its picture from {begins:.2f} m on"
        cure = f"give from_m: {math.ceil(100.0 * begins) / 100.0:g}, "
    return CohelmError(
        f"{topic} shows floor {what}, and floor.from_m is {floor.from_m:g}, so the robot would "
        f"find none before it and stand: tilt the camera down, {cure}or give larger cells"
    )


def _cone(
    inspection: Inspection, topic: str, configured: LidarModel, allowed: Allowed
) -> DescribedLidar:
    """One that sends single ranges."""
    rows = inspection.scans[topic]
    matrix = (
        _level(configured) if allowed.mount_from_model else _into_body(inspection, topic, allowed)
    )
    ages, rate = inspection.ages(rows), inspection.rate(rows)
    ticks = estimated(ages, topic, allowed.clock, allowed.options.clock)
    latency = min(ages) + ticks.ahead
    lidar = cone.described(rows[-1].message, topic, matrix, rate, latency, configured)
    near = lidar.range_min_m == lidar.range_max_m
    note = (
        f"range sensor: {topic}, {rate:.1f} Hz, "
        + (f"whether something is within {lidar.range_max_m:g} m" if near else
           f"from {lidar.range_min_m:g} to {lidar.range_max_m:g} m")
        + f" in {lidar.field_of_view_deg:.0f} deg, at x {lidar.mount_x_m:.3f} y "
        f"{lidar.mount_y_m:.3f} m, looks at {lidar.mount_yaw_deg:.1f} deg"
    )  # fmt: skip
    return DescribedLidar(
        _found(topic, inspection.frame(topic), lidar, ticks, matrix, None), lidar, note
    )


def _found(
    topic: str, frame: str, lidar: LidarModel, ticks: Clock, matrix: Floats,
    camera: depth.Intrinsics | None,
) -> FoundLidar:  # fmt: skip
    x, y, z = matrix[:3, 3].tolist()
    mount = Mount(Pose(x, y, lidar.mount.psi), False, z)
    return FoundLidar(topic, frame, mount, ticks, False, matrix, camera)


def _placed(
    inspection: Inspection, topic: str, configured: LidarModel | None, allowed: Allowed
) -> Mount:
    """Where a planar LiDAR is."""
    if allowed.mount_from_model and configured is not None:
        high = configured.mount_z_m
        return Mount(configured.mount, False, math.nan if high is None else high)
    _certain(inspection, topic)
    mount = inspection.mount(topic, allowed.options.scan)
    if mount is None or allowed.mount_from_model:
        raise _unplaced(inspection, topic, allowed)
    return mount


def _into_body(inspection: Inspection, topic: str, allowed: Allowed) -> Floats:
    """From the frame of its messages into the body's, (4, 4)."""
    _certain(inspection, topic)
    matrix = inspection.into_body(topic)
    if matrix is None:
        raise _unplaced(inspection, topic, allowed)
    return matrix


def _certain(inspection: Inspection, topic: str) -> None:
    """CohelmError where transforms contradict each other."""
    places = inspection.transforms.ambiguous(inspection.frame(topic), inspection.body())
    if places:
        raise CohelmError(mismatch.two_places(topic, places))


def _unplaced(inspection: Inspection, topic: str, allowed: Allowed) -> CohelmError:
    known = inspection.transforms.frames()
    frame, body = inspection.frame(topic), inspection.body()
    return CohelmError(mismatch.no_frame(topic, frame, body, known, allowed.options))


def _level(lidar: LidarModel) -> Floats:
    """Where it is by its description, level, (4, 4)."""
    x, y, yaw = lidar.mount
    c, s = math.cos(yaw), math.sin(yaw)
    made: Floats = np.eye(4)
    made[:2, :2] = [[c, -s], [s, c]]
    made[:3, 3] = x, y, lidar.mount_z_m or 0.0
    return made
