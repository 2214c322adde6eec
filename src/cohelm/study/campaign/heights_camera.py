"""The depth camera of a simulated robot: its `camera`, whose pictures are depths."""

from __future__ import annotations

import math

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.robot.model import RobotModel
from cohelm.ros.depth import Intrinsics, described
from cohelm.sim.heights import DepthCamera

_NOISE, _LOST, _GRAZING = 0.01, 0.01, 0.08
_SHAKE = math.radians(0.15)
"""Of its pitch from picture to picture [rad]."""
ASKEW = math.radians(0.3)
"""Constant error of its mount [rad]."""


def with_depth_camera(model: RobotModel) -> RobotModel:
    """The robot as `cohelm.ros` finds it: its depth camera sees what its pictures show."""
    seen = lens(model, 0.0)
    further = tuple(
        described(seen_by(seen), mounted(seen), one, f"/{one.name}") if one.depth_image else one
        for one in model.further_lidars
    )
    return model.model_copy(update={"further_lidars": further})


def lens(model: RobotModel, askew: float) -> DepthCamera:
    """The depth camera that a robot's `camera` is, its mount askew by some pitch [rad]."""
    configured = model.camera
    if configured is None:
        raise CohelmError(f"{model.name} has no camera to see heights with: describe one")
    focal = 0.5 * configured.height / math.tan(0.5 * math.radians(configured.field_of_view_deg))
    down = math.radians(configured.tilt_deg) + askew
    c, s = math.cos(down), math.sin(down)
    turn = np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])
    deep = next(one for one in model.lidars if one.depth_image)
    return DepthCamera(
        configured.width, configured.height, focal,
        np.array([configured.mount_x_m, 0.0, configured.mount_z_m]), turn, deep.range_max_m,
        _NOISE, _LOST, _GRAZING, _SHAKE,
    )  # fmt: skip


def seen_by(lens: DepthCamera) -> Intrinsics:
    """By its CameraInfo."""
    return Intrinsics(
        lens.width, lens.height, lens.focal, lens.focal, 0.5 * (lens.width - 1),
        0.5 * (lens.height - 1),
    )  # fmt: skip


def mounted(lens: DepthCamera) -> Floats:
    """(4, 4), by /tf_static."""
    made: Floats = np.eye(4)
    made[:3, :3], made[:3, 3] = lens.turn, lens.lens
    return made
