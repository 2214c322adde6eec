"""The suites by name: what each needs, how many episodes it has by default, and its cases."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.types import RADIUS, X, Y, disc
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.robot.limits import checked_braking, speeds
from cohelm.robot.model import RobotModel, checked_sight
from cohelm.sim.setup import Setup, Twinned, with_pilot
from cohelm.sim.twin.settings import TwinModel
from cohelm.sim.world import Body, World, ever_moving, world
from cohelm.study.campaign import adversary, barn, crowd, hands, heights, lab, movers, rooms
from cohelm.study.campaign.data import csv_files
from cohelm.study.campaign.episode import LAWS, PAPER, PLANTS, Episode, lively

NAMES = ("lab", "random", "movers", "barn", "crowd", "adversary", "hands", "heights")

_NEEDS_DATA = ("barn", "crowd", "hands")
_DRIVEN_ON: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("lab", "random", "movers", "adversary"), PLANTS), "heights": ("twin",),
}  # fmt: skip
"""The first one is the default; suites not listed are driven on exact arcs alone."""
_DRIVEN_BY_ANY = ("random", "movers", "adversary")
_LARGEST, _SLOWEST = 1.0, 0.05  # reach of a robot [m], its top speed [m/s]
_CHUNKS = {"adversary": 10, "random": 5, "movers": 5}


@dataclass(frozen=True)
class Suite:
    """A suite with what it has read, ready to make any of its cases; it can be pickled."""

    name: str
    seed: int
    prepared: Any
    """What the suite's module has read or prepared."""
    episodes: int
    """How many there are by default."""
    notes: tuple[str, ...] = ()
    """What was left out, a sentence each."""
    plant: str = "kinematic"
    robot: RobotModel | None = None
    """Drives instead of the suite's own."""
    data: str = ""
    """A digest of the files of --data that it has read; empty where it reads none."""

    @property
    def goals(self) -> bool:
        """Whether its episodes want to get anywhere."""
        return self.name != "adversary"

    @property
    def laws(self) -> tuple[str, ...]:
        """Under which it can be driven."""
        if self.name == "heights":
            return ("guard",)
        if self.plant != "kinematic":
            return ("guard",) if self.name == "adversary" else ("guard", "paper", "none")
        return LAWS if self.name in ("random", "movers") else ("guard", "paper", "none")

    @property
    def chunk(self) -> int:
        """Episodes that are handed out at a time."""
        return _CHUNKS.get(self.name, 1) if self.plant == "kinematic" else 1

    def case(self, number: int) -> Episode:
        """Episode `number`: the same whenever and wherever it is made."""
        if self.name == "heights":
            return heights.case(self.seed, number)
        made = self._case(number)
        return made if self.plant == "kinematic" else on_twin(made, self.plant)

    def _case(self, number: int) -> Episode:
        if self.name == "lab":
            return lab.case(self.prepared, self.seed, number)
        if self.name == "random":
            return rooms.case(self.seed, number, self.robot)
        if self.name == "movers":
            return movers.case(self.seed, number, self.robot)
        if self.name == "barn":
            return barn.case(self.prepared, self.seed, number)
        if self.name == "crowd":
            return crowd.case(self.prepared, self.seed, number)
        if self.name == "hands":
            return hands.case(self.prepared[0], self.prepared[1], self.seed, number)
        return adversary.case(self.seed, number, self.prepared, model=self.robot)


def suite(
    name: str, seed: int, data: Path | None, plant: str | None = None,
    robot: RobotModel | None = None,
) -> Suite:  # fmt: skip
    """A suite by its name. data: the folder of recordings and worlds made by others. plant, robot:
    by default the suite's own.

    Raises CohelmError for a name that there is not, or data that is missing or not usable, or a
    plant or robot that the suite is not driven on or by.
    """
    if name not in NAMES:
        hint = did_you_mean(name, NAMES)
        raise CohelmError(f"there is no suite {name!r}: choose {', '.join(NAMES)}{hint}")
    driven_on = _DRIVEN_ON.get(name, ("kinematic",))
    plant = plant or driven_on[0]
    if plant not in PLANTS:
        raise CohelmError(f"there is no plant {plant!r}: choose {', '.join(PLANTS)}")
    if plant not in driven_on:
        raise CohelmError(
            f"the suite {name} is not driven with --plant {plant}: choose {', '.join(driven_on)}"
        )
    if robot is not None:
        _check(robot, name, plant)
    made = _suite(name, seed, data)
    notes = made.notes
    if data is not None and name not in _FILES:
        notes = (*notes, f"the recordings of --data: {name} drives on none")
    read = "" if data is None or name not in _FILES else _digest(*_FILES[name](data))
    return replace(made, plant=plant, notes=notes, robot=robot, data=read)


_FILES = {
    "barn": barn.files, "crowd": partial(csv_files, name=crowd.FOLDER),
    **dict.fromkeys(("hands", "adversary"), partial(csv_files, name=hands.FOLDER)),
}  # fmt: skip


def _digest(folder: Path, files: list[Path]) -> str:
    """Of files in a folder, by their names in it and what they hold."""
    digest = hashlib.sha256()
    for file in filter(Path.is_file, files):
        digest.update(file.relative_to(folder).as_posix().encode() + b"\0")
        with suppress(PermissionError), file.open("rb") as held:  # those a suite leaves out
            digest.update(hashlib.file_digest(held, "sha256").digest())
    return digest.hexdigest()[:16]


def _check(robot: RobotModel, name: str, plant: str) -> None:
    if name not in _DRIVEN_BY_ANY:
        raise CohelmError(
            f"the suite {name} is driven by its own robot: --robot goes with "
            f"{', '.join(_DRIVEN_BY_ANY)}"
        )
    if robot.reach > _LARGEST:
        raise CohelmError(
            f"{robot.name} is too large for these rooms: a corner is {robot.reach:.2g} m from the "
            f"middle of its axle, {_LARGEST:g} m at most"
        )
    if speeds(checked_braking(robot.bounds()))[0] < _SLOWEST:
        raise CohelmError(f"{robot.name} is too slow for these rooms: {_SLOWEST:g} m/s at least")
    if plant == "kinematic":
        return
    if robot.lidar is None:
        raise CohelmError(f"{robot.name} has no lidar, which --plant {plant} needs; give it one")
    checked_sight(sensed(equipped(robot, plant)))


def _suite(name: str, seed: int, data: Path | None) -> Suite:
    if data is not None and not data.is_dir():
        raise CohelmError(f"--data {data}: there is no such folder")
    if data is None and name in _NEEDS_DATA:
        raise CohelmError(
            f"the suite {name} drives on data made by others, which does not come with cohelm; "
            "give its folder with --data (docs/campaigns.md says what it is)"
        )
    if name == "lab":
        return Suite(name, seed, lab.scenario(), 20)
    if name == "random":
        return Suite(name, seed, None, 1000)
    if name == "movers":
        return Suite(name, seed, None, 200 * len(movers.DENSITIES))
    if name == "heights":
        return Suite(name, seed, None, 1000)
    if name == "adversary":
        if data is None:
            notes = ("no recorded hands among the attackers: --data was not given",)
            return Suite(name, seed, (), 1000, notes)
        found = hands.read(data)
        return Suite(name, seed, found.recordings, 1000, found.left_out)
    assert data is not None
    if name == "barn":
        worlds = barn.read(data)
        notes = tuple(f"world {w.number}: {note}" for w in worlds for note in w.left_out)
        return Suite(name, seed, worlds, 3 * len(worlds), notes)
    if name == "crowd":
        scenes = crowd.read(data)
        notes = tuple(note for scene in scenes for note in scene.left_out)
        return Suite(name, seed, scenes, crowd.STARTS * len(scenes), notes)
    found = hands.read(data)
    return Suite(name, seed, (found, hands.course()), 2 * len(found.recordings), found.left_out)


# Episodes of a suite on the physics twin, closed on its sensors alone.
#
# The robot localizes on a map of all standing obstacles, as if measured by tape (the walkers are on
# no map), in the adversary's field by its odometry alone. It knows obstacles from its LiDAR by
# `perceive`; truth is for the judge. Its sensors: LiDARs as in the robot's file but with 2 cm of
# noise, a sweep that takes three quarters of the scan period, and 50 ms more until it is read;
# wheels that measure some 1.5 % wrongly, and a gyro that drifts 0.02 deg/s; or as badly as the
# file says, where that is worse. While the robot is lost, or has seen nothing yet, the reference
# waits.


POST = 0.015
"""Radius of what is a point without size in the kinematic adversary [m]."""

_NOISE, _LATENCY, _SWEEPS = 0.02, 0.05, 0.75  # [m], [s], share of the time between two scans
_WHEELS, _DRIFT = 0.015, 0.02  # share, [deg/s]


def sensed(model: RobotModel) -> RobotModel:
    """The robot with the errors of its sensors here; those that its file says are worse stay."""
    lidars = [
        one.model_copy(update={
            "noise_m": max(one.noise_m, _NOISE),
            "sweep_s": max(one.sweep_s, _SWEEPS / one.rate_hz),
            "latency_s": max(one.latency_s, _LATENCY),
        })
        for one in model.lidars
    ]  # fmt: skip
    wheels = model.odometry
    odometry = wheels.model_copy(update={
        "distance_error": max(wheels.distance_error, _WHEELS),
        "gyro_drift_degps": max(wheels.gyro_drift_degps, _DRIFT),
    })  # fmt: skip
    first, further = (lidars[0], tuple(lidars[1:])) if lidars else (None, ())
    update = {"lidar": first, "further_lidars": further, "odometry": odometry}
    return model.model_copy(update=update)


def equipped(model: RobotModel, plant: str) -> RobotModel:
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


def on_twin(case: Episode, plant: str) -> Episode:
    """The same episode on the twin."""
    model = sensed(equipped(case.robot, plant))
    assert model.lidar is not None
    physics, setup = TwinModel(), case.setup
    if case.rollout is not None:
        field = _field(case)
        names = tuple(f"thing_{i}" for i in range(len(field.discs)))
        full = PAPER._replace(u_d=setup.limits.speed)
        setup = replace(setup, obstacles=field, names=names)
        setup = with_pilot(setup, lidars=model.lidars, gains=full)
        # There is no reference and so no end of it: a full deflection requests full speed.
        setup = replace(setup, near=0.0, twin=Twinned(model, physics))
        return replace(case, plant=plant, setup=setup)
    if setup.pilot is None:
        setup = with_pilot(setup, lidars=model.lidars, gains=lively(setup.gains))
    assert setup.pilot is not None
    seeing = replace(setup.pilot, lidars=model.lidars)
    known = map_from_geometry(setup.obstacles.walls, setup.start, _resting(setup))
    setup = replace(setup, pilot=seeing, twin=Twinned(model, physics, known))
    return replace(case, plant=plant, setup=setup)


def _resting(setup: Setup) -> np.ndarray:
    """x, y and radius of what never moves."""
    return setup.obstacles.discs[~ever_moving(setup.obstacles)][:, [X, Y, RADIUS]]


def _field(case: Episode) -> World:
    """What there is to hit; points are thin posts, which a LiDAR can see."""
    assert case.rollout is not None
    scene = case.rollout.scene
    reach = case.setup.reach
    bodies = [Body(tuple(row)) for row in scene.discs.tolist()]
    bodies += [Body(disc(x, y, POST, POST + reach)) for x, y in scene.points.tolist()]
    return world((bodies, scene.walls))
