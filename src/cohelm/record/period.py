"""The message `/period`: one whole control period, so that a record is read back exactly.

Its definition follows `core.row.FIELDS` field by field and travels in every file. ROS allows no
capitals in field names: the paper's I and J become i and j.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cohelm.core.row import MEANINGS, ROW
from cohelm.core.types import RADIUS, SAFE, VX, VY, Floats, X, Y
from cohelm.law.verdict import BRAKING, INVALID, POWERLESS, SHAPED, STANDING, UNTOUCHED
from cohelm.link.messages import Arming, DockPhase
from cohelm.pilot.behavior import ESCAPING, EVADING, FOLLOWING, LED
from cohelm.robot.gate.modes import GateMode

TOPIC = "/period"
TYPE = "cohelm_msgs/msg/Period"
VERSION = 3
"""Version of the definition: raised whenever a field is removed or changes its meaning. New fields
do not raise it, readers go by name."""

_CONSTANTS: dict[str, dict[str, int]] = {
    "verdict": {
        "UNTOUCHED": UNTOUCHED, "SHAPED": SHAPED, "POWERLESS": POWERLESS, "INVALID": INVALID,
        "BRAKING": BRAKING, "STANDING": STANDING,
    },
    "behavior": {"FOLLOWING": FOLLOWING, "LED": LED, "ESCAPING": ESCAPING, "EVADING": EVADING},
    "arming": {arming.name: arming.value for arming in Arming},
    "mode": {mode.name: mode.value for mode in GateMode},
    "docking": {phase.name: phase.value for phase in DockPhase},
}  # fmt: skip
_COLUMNS = {
    "obstacle_x": (X, "[m] centres, in the map, in the order of the names in the metadata"),
    "obstacle_y": (Y, "[m]"),
    "obstacle_vx": (VX, "[m/s] velocities"),
    "obstacle_vy": (VY, "[m/s]"),
    "obstacle_radius": (RADIUS, "[m]"),
    "obstacle_safe": (SAFE, "[m] r_i, safe distance between centres (19)"),
}
ARRAYS = {"obstacle_h": "[m^2] h_i of every obstacle of a run; no numbers in a drive"} | {
    name: meaning for name, (_, meaning) in _COLUMNS.items()
}
"""Unit and meaning of every array; an array has one number for each obstacle."""


def _definition() -> str:
    """The message definition, with a comment on every field."""
    lines = [f"# One control period of cohelm, definition {VERSION}. Numbers in () are equations."]
    for name in ROW.names or ():
        kind = ROW[name].name  # float64, int64 and bool have the same names in ROS
        # Foxglove shows constants right before a field as names of its values
        lines += [f"{kind} {word}={value}" for word, value in _CONSTANTS.get(name, {}).items()]
        lines.append(f"{kind} {name.lower()}  # {MEANINGS[name]}")
    lines += [f"float64[] {name}  # {meaning}" for name, meaning in ARRAYS.items()]
    return "\n".join(lines) + "\n"


DEFINITION = _definition()
STORE = get_typestore(Stores.ROS2_JAZZY)
"""ROS 2's own message types, and ours."""
STORE.register(get_types_from_msg(DEFINITION, TYPE))

NO_H, NO_DISCS = np.empty(0), np.empty((0, 6))


def message(row: Any, h: Floats = NO_H, discs: Floats = NO_DISCS) -> object:
    """The message of a row, `row.tolist()` of one of dtype ROW; h: (m,); discs: (m, 6)."""
    arrays = (np.ascontiguousarray(discs[:, column]) for column, _ in _COLUMNS.values())
    return STORE.types[TYPE](*row, h, *arrays)


def rows(messages: Sequence[object]) -> NDArray[np.void]:
    """Messages as rows of ROW. Raises AttributeError for a missing field."""
    row: Callable[[object], Any] = attrgetter(*(name.lower() for name in ROW.names or ()))
    return np.array([row(message) for message in messages], dtype=ROW)


def obstacles(messages: Sequence[object], many: int) -> tuple[Floats, Floats]:
    """h_i and discs of every message, shapes (n, many) and (n, many, 6)."""
    discs = np.empty((len(messages), many, 6))
    for name, (column, _) in _COLUMNS.items():
        discs[:, :, column] = _stacked(messages, name, many)
    return _stacked(messages, "obstacle_h", many), discs


def _stacked(messages: Sequence[object], name: str, many: int) -> Floats:
    values: list[Floats] = [getattr(message, name) for message in messages]
    return np.array(values, dtype=np.float64).reshape(len(messages), many)
