"""ir-sim's velocity obstacles as a peer: the same rooms, wheels and judge; its own controller.

`rvo` is its reciprocal velocity obstacles (van den Berg et al. 2008), which count on the others to
give way by half; `vo` its plain ones, which do not, and so suit movers that avoid nobody better. It
is given every disc with its velocity, but not the walls: in a closed room its treatment of segments
leaves no velocity admissible, and it drives worse than without; contacts with walls are judged all
the same. It computes a command every 0.1 s, its usual step, wants the reference's speed, as ours
does, and gets the wheels' limits (`acce` is its largest change of speed in a step). It takes the
robot for a circle, 0.1 m larger than the outline's farthest corner, as it always does. The robot
then moves as ours does: wheel limits, exact arcs, 50 steps a second.

It drives apart, as laws by others do.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cohelm.core.extras import missing
from cohelm.core.types import RADIUS, VX, VY, Floats, Twist, X, Y
from cohelm.sim.world import place
from cohelm.study.campaign.episode import DT, Episode
from cohelm.study.controlled import Observation

PEERS: tuple[str, ...] = ("rvo", "vo")

_HOLD = 5  # control steps for which one of its commands is held: 0.1 s


def check() -> None:
    """CohelmError where ir-sim is not installed."""
    if importlib.util.find_spec("irsim") is None:
        raise missing("what drives by the laws rvo and vo of ir-sim", "peers")


class Peer:
    """ir-sim's controller as an external law, each of its commands held for a while."""

    def __init__(self, case: Episode, mode: str) -> None:
        os.environ["MPLBACKEND"] = "Agg"
        irsim: Any = importlib.import_module("irsim")
        discs = np.empty((len(case.setup.names), 6))
        place(discs, case.setup.obstacles, 0.0)
        self._env = _world(irsim, case, discs, mode)
        self._command, self._steps = Twist(0.0, 0.0), 0

    def __call__(self, now: Observation) -> Twist:
        """Its command, a new one every so many steps."""
        if self._steps % _HOLD == 0:
            self._command = self._command_at(now)
        self._steps += 1
        return self._command

    def _command_at(self, now: Observation) -> Twist:
        """What it wants with everything where it is now."""
        for obstacle, disc in zip(self._env.obstacle_list, now.obstacles.discs, strict=True):
            if not obstacle.static:
                obstacle.set_state([disc[X], disc[Y], 0.0])
                obstacle.set_velocity([disc[VX], disc[VY]])
        robot, (x, y, psi) = self._env.robot, now.pose
        robot.set_state([x, y, psi])
        robot.set_velocity([*now.twist])
        v, omega = np.asarray(robot.gen_behavior_vel(None), dtype=np.float64).ravel()
        return Twist(float(v), float(omega))


def _world(irsim: Any, case: Episode, discs: Floats, mode: str) -> Any:
    setup, goal = case.setup, case.goal
    assert goal is not None
    size = np.ptp(setup.outline, axis=0)
    speed, window = setup.reference.speed, setup.limits.wheel_acceleration * DT * _HOLD
    scene = {
        "world": {
            "width": 40.0, "height": 40.0, "offset": [-20.0, -20.0], "step_time": DT * _HOLD,
            "collision_mode": "unobstructed",
        },
        "robot": [{
            "kinematics": {"name": "diff"},
            "shape": {"name": "rectangle", "length": float(size[0]), "width": float(size[1])},
            "state": list(setup.start), "goal": [goal.x, goal.y, 0.0],
            "goal_threshold": goal.near,
            "vel_min": [-speed, -setup.limits.yaw_rate],
            "vel_max": [speed, setup.limits.yaw_rate],
            "behavior": {"name": "rvo", "mode": mode, "vxmax": speed, "vymax": speed,
                         "acce": window},
        }],
        "obstacle": [
            {"shape": {"name": "circle", "radius": float(d[RADIUS])},
             "state": [float(d[X]), float(d[Y]), 0.0],
             **({"kinematics": {"name": "omni"}} if d[VX] or d[VY] else {})}
            for d in discs
        ],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML
        return irsim.make(str(path), headless=True, log_level="CRITICAL")
