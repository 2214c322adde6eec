"""An episode of `heights`: the twin with a depth camera, behind the loop, its gate and monitors.

A picture of the camera's view is packed into the bytes of a `sensor_msgs/msg/Image`, and read from
them as a robot's own images are. The episode ends with the first fall or contact.
"""

from __future__ import annotations

import math
from collections import deque
from functools import partial
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Image as Image

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Floats, Pose, Stick
from cohelm.link.messages import Arming, Mode
from cohelm.record.ros2 import header
from cohelm.robot.clearance import segment_clearance
from cohelm.robot.model import RobotModel
from cohelm.ros.depth import DepthRanges, Intrinsics, described
from cohelm.ros.mismatch import IMAGE
from cohelm.ros.types import packed, unpacked
from cohelm.sim.adversarial import BANG, SPIN, Attack, deflection
from cohelm.sim.heights import DepthCamera, Heights, fallen, picture
from cohelm.sim.simulated import SimulatedLidar
from cohelm.sim.twin.robot import Twin
from cohelm.study.campaign.episode import Episode, Interventions, Load
from cohelm.study.campaign.loop_run import Looped

_NO_DISCS: Floats = np.empty((0, 6))
_FIT, _REST = 3.0, 2.0
"""A sharing operator pushes for so long, and lets go for so long [s]."""


class UnevenTwin(Twin):
    """A twin whose depth cameras see heights, with changing loads."""

    def __init__(
        self, heights: Heights, loads: tuple[Load, ...], model: RobotModel, start: Pose,
        *rest: Any, seed: int = 0, **named: Any,
    ) -> None:  # fmt: skip
        """The rest as for a twin."""
        self._heights, self._loads = heights, deque(loads)
        self._random = np.random.default_rng([seed, 0xDE9])
        self._lens = lens(model, ASKEW * float(self._random.standard_normal()))
        nominal = lens(model, 0.0)
        self._ranges = {
            one.name: DepthRanges(one, seen_by(nominal), mounted(nominal), f"/{one.name}")
            for one in model.lidars
            if one.depth_image
        }
        super().__init__(model, start, *rest, seed=seed, **named)

    def send(self, twist: Any) -> Any:
        """As any twin, with the load of this moment."""
        now = self.now()
        while self._loads and self._loads[0].since <= now:
            load = self._loads.popleft()
            self._limits = self._limits._replace(wheel_acceleration=load.brakes)
            self._delay = self._steps(load.delay)
        return super().send(twist)

    def _scan(self, step: int, scanner: SimulatedLidar) -> None:
        made = self._ranges.get(scanner.model.name)
        if made is None:
            super()._scan(step, scanner)
            return
        s = self._state[0]
        pose = Pose(float(s["x"]), float(s["y"]), float(s["psi"]))
        message, damage = unpacked(self._image(pose, step * self._step), IMAGE)
        if damage:
            raise CohelmError(damage)
        readable = step + self._steps(scanner.model.latency_s)
        ranges, floor = made.of(message), made.floor
        scanner.measured(ranges, step, readable, self._step, floor and floor.edges)

    def _image(self, pose: Pose, stamp: float) -> bytes:
        seen = picture(self._lens, self._heights, pose, self._random)
        rows, columns = seen.shape
        message = Image(
            header(round(stamp * 1e9), "deep"), rows, columns, "16UC1", 0, 2 * columns,
            np.frombuffer(np.rint(1000.0 * seen).astype("<u2").tobytes(), np.uint8),
        )  # fmt: skip
        return packed(message, IMAGE)


class UnevenRun(Looped):
    """The loop drives the robot, or an operator that pushes it at edges, or both. It ends on
    arrival, with a fall or with a contact."""

    def __init__(self, case: Episode, acted: Interventions) -> None:
        assert case.uneven is not None
        self.uneven = uneven = case.uneven
        self.made = partial(UnevenTwin, uneven.heights, uneven.loads)
        super().__init__(case.setup, acted)
        manual = uneven.operator != "" and case.goal is None
        self.mode = Mode.MANUAL if manual else Mode.SHARED if uneven.operator else Mode.AUTOMATIC
        kind = {"bang": BANG, "spin": SPIN}.get(uneven.operator, BANG)
        self.attack = Attack(kind, case.setup.seed, np.zeros((1, 2)), 1.0)
        self.held = CENTRED

    def operator_stick(self, k: int, discs: Floats) -> Stick:
        """What the person does in step k; centred whenever the stick has to be armed."""
        uneven, t = self.uneven, k * self.setup.dt
        if not uneven.operator:
            return CENTRED
        resting = self.mode == Mode.SHARED and t % (_FIT + _REST) < _REST
        pose, bang = self.truth.pose, t % 3.0 >= 2.0 and self.mode == Mode.MANUAL
        if resting:
            self.held = CENTRED
        elif uneven.operator in ("ram", "back") and not bang:
            self.held = towards(pose, uneven.edges, uneven.operator == "back")
        else:
            self.held = deflection(
                self.attack, self.held, k, self.setup.dt, pose, _NO_DISCS, uneven.edges
            )
        return self.held if self.loop.supervisor.stick_state.arming == Arming.ARMED else CENTRED

    def step(self, k: int, row: Any) -> None:
        """As any; it ends with the first row in which it has fallen, or touches something."""
        pose, uneven = self.truth.pose, self.uneven
        super().step(k, row)
        over = fallen(uneven.heights, np.array([pose]), uneven.wheels) >= 0
        self.arrived = self.arrived or over or self._touches(pose)

    def _touches(self, pose: Pose) -> bool:
        walls = self.setup.obstacles.walls
        return any(segment_clearance(pose, self.setup.outline, *w) <= 0.0 for w in walls.tolist())


def towards(pose: Pose, edges: Floats, tail_first: bool) -> Stick:
    """At the nearest point of the edges, ahead or tail first."""
    if not len(edges):
        return CENTRED
    here = np.array(pose[:2])
    a, along = edges[:, :2], edges[:, 2:] - edges[:, :2]
    square = np.maximum((along * along).sum(axis=1), 1e-12)
    share = np.clip(((here - a) * along).sum(axis=1) / square, 0.0, 1.0)
    off = a + share[:, None] * along - here
    dx, dy = off[int(np.argmin((off * off).sum(axis=1)))].tolist()
    turn = math.remainder(
        math.atan2(dy, dx) - pose.psi - (math.pi if tail_first else 0.0), 2.0 * math.pi
    )
    if abs(turn) > 0.5 * math.pi:
        return Stick(0.0, math.copysign(1.0, turn))
    ahead = -1.0 if tail_first else 1.0
    return Stick(ahead * math.cos(turn), math.sin(turn))


# The depth camera of a simulated robot: its `camera`, whose pictures are depths.


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
