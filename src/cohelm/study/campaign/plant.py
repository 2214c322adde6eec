"""Episodes of a suite on the physics twin, closed on its sensors alone.

The robot localizes on a map of all standing obstacles, as if measured by tape (the walkers are on
no map), in the adversary's field by its odometry alone. It knows obstacles from its LiDAR by
`perceive`; truth is for the judge. Its sensors: LiDAR as in the robot's file but with 2 cm of
noise, a sweep that takes three quarters of the scan period, and 50 ms more until it is read; wheels
that measure some 1.5 % wrongly, and a gyro that drifts 0.02 deg/s. While the robot is lost, or has
seen nothing yet, the reference waits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cohelm.core.types import RADIUS, VX, VY, X, Y, disc
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.robot.model import RobotModel
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.twin.settings import TwinModel, Twinned
from cohelm.sim.world import Body, World, world
from cohelm.study.campaign.episode import PAPER, Episode, Plant, lively

POST = 0.015
"""Radius of what is a point without size in the kinematic adversary [m]."""

_NOISE, _LATENCY, _SWEEPS = 0.02, 0.05, 0.75  # [m], [s], share of the time between two scans
_WHEELS, _DRIFT = 0.015, 0.02  # share, [deg/s]


def sensing(model: RobotModel) -> TwinModel:
    """The errors of a robot's sensors here."""
    rate = 10.0 if model.lidar is None else model.lidar.rate_hz
    return TwinModel(
        lidar_noise_m=_NOISE,
        lidar_sweep_s=_SWEEPS / rate,
        lidar_latency_s=_LATENCY,
        odometry_distance_error=_WHEELS,
        gyro_drift_degps=_DRIFT,
    )


def equipped(model: RobotModel, plant: Plant) -> RobotModel:
    """The robot, with the LiDARs that this plant gives it."""
    if plant == "twin-rear":
        return with_rear_lidar(model)
    return with_all_round_lidar(model) if plant == "twin-all-round" else model


def with_rear_lidar(model: RobotModel) -> RobotModel:
    """A robot with a second LiDAR like its first one, as far behind as that one is in front."""
    first = model.lidar
    if first is None:
        return model
    turned = {
        "name": "rear", "mount_x_m": -first.mount_x_m, "mount_y_m": -first.mount_y_m,
        "mount_yaw_deg": first.mount_yaw_deg + 180.0,
    }  # fmt: skip
    both = first.model_copy(update={"name": "front"}), first.model_copy(update=turned)
    return model.model_copy(update={"lidar": both[0], "further_lidars": (both[1],)})


def with_all_round_lidar(model: RobotModel) -> RobotModel:
    """A robot whose LiDAR looks all round from its middle, with the same angle between beams."""
    if model.lidar is None:
        return model
    clearances = (model.lidar.beams - 1) / model.lidar.field_of_view_deg
    round_ = {"field_of_view_deg": 360.0, "beams": round(360.0 * clearances), "mount_x_m": 0.0}
    return model.model_copy(update={"lidar": model.lidar.model_copy(update=round_)})


def on_twin(case: Episode, plant: Plant) -> Episode:
    """The same episode on the twin."""
    model = equipped(case.robot, plant)
    assert model.lidar is not None
    physics, setup, further = sensing(model), case.setup, model.further_lidars
    if case.rollout is not None:
        field = _field(case)
        names = tuple(f"thing_{i}" for i in range(len(field.discs)))
        full = PAPER._replace(u_d=setup.limits.speed)
        setup = replace(setup, obstacles=field, names=names)
        setup = with_pilot(setup, lidar=model.lidar, gains=full, further=further)
        # There is no reference and so no end of it: a full deflection requests full speed.
        setup = replace(setup, near=0.0, twin=Twinned(model, physics))
        return replace(case, plant=plant, setup=setup)
    if setup.pilot is None:
        setup = with_pilot(setup, lidar=model.lidar, gains=lively(setup.gains), further=further)
    assert setup.pilot is not None
    seeing = replace(
        setup.pilot, lidar=model.lidar.lidar(), rate=model.lidar.rate_hz, further=further
    )
    known = map_from_geometry(setup.obstacles.walls, setup.start, _resting(setup))
    setup = replace(setup, pilot=seeing, twin=Twinned(model, physics, known))
    return replace(case, plant=plant, setup=setup)


def _resting(setup: Setup) -> np.ndarray:
    """x, y and radius of what never moves."""
    discs = setup.obstacles.discs
    resting = (np.diff(setup.obstacles.path_first) == 0) & (discs[:, VX] == 0) & (discs[:, VY] == 0)
    return discs[resting][:, [X, Y, RADIUS]]


def _field(case: Episode) -> World:
    """What there is to hit; points are thin posts, which a LiDAR can see."""
    assert case.rollout is not None
    scene = case.rollout.scene
    reach = float(np.hypot(*case.setup.outline.T).max())
    bodies = [Body(tuple(row)) for row in scene.discs.tolist()]
    bodies += [Body(disc(x, y, POST, POST + reach)) for x, y in scene.points.tolist()]
    return world((bodies, scene.walls))
