"""The message `/status`: one control step, whole, so that a record is read back exactly.

Its definition follows `core.trace.ROW` field by field and travels in every file. ROS allows
no capitals in field names: the paper's I and J become i and j.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cohelm.core.trace import ROW, Trace
from cohelm.core.types import RADIUS, SAFE, VX, VY, Floats, X, Y
from cohelm.law.verdict import BRAKING, INVALID, POWERLESS, SHAPED, STANDING, UNTOUCHED
from cohelm.pilot.step import ESCAPING, EVADING, FOLLOWING, LED

TOPIC = "/status"
TYPE = "cohelm_msgs/msg/Status"
VERSION = 2
"""Of the definition: one more whenever a field changes its meaning or goes. New fields may
come without it, readers go by name."""

MEANINGS = {
    "t": "[s] from the start of the run",
    "x": "[m] pose in the world frame, before the command acts",
    "y": "[m]",
    "psi": "[rad] heading, counter-clockwise from x",
    "x_d": "[m] desired pose (7)",
    "y_d": "[m]",
    "psi_d": "[rad]",
    "u_d": "[m/s] desired surge speed (10)",
    "r_d": "[rad/s] desired yaw rate (10)",
    "e_p": "E_P, pose error (51)",
    "stick_x": "deflection fore-aft in [-1, 1], forward positive",
    "stick_psi": "deflection left-right in [-1, 1], left positive",
    "safe_v": "[m/s] command U (49): what the filter lets through",
    "safe_omega": "[rad/s]",
    "tracking_v": "[m/s] the tracking law's wish tau_c (15)",
    "tracking_omega": "[rad/s]",
    "operator_v": "[m/s] the person's wish tau_h (38)",
    "operator_omega": "[rad/s]",
    "nominal_v": "[m/s] the blend tau of both wishes (34)",
    "nominal_omega": "[rad/s]",
    "avoid_v": "[m/s] collision-avoidance input u (33)",
    "avoid_omega": "[rad/s]",
    "authority_x": "automatic share of surge: exp(-V_h), V_h = intent_x + intent_psi (48)",
    "authority_psi": "automatic share of yaw; differs from authority_x only per axis (44)",
    "intent_x": "V_hx (41)",
    "intent_psi": "V_hpsi (42)",
    "I": "growth of the barrier under the wish (31)",
    "J": "growth that is tolerated (32)",
    "h": "[m^2] smallest h_i",
    "verdict": "what the filter did",
    "culprit": "index of the obstacle it acted for; -1 for none, or the heading term",
    "applied_v": "[m/s] command after delay and wheel limits",
    "applied_omega": "[rad/s]",
    "saturated": "whether the wheel limits changed the command",
    "clearance": "[m] real outline to the nearest disc or wall",
    "energy": "passivity integral (40)",
    "gap": "[m] smallest gap of the outline among what the guard saw near; inf for nothing",
    "change": "[m/s] distance of the command from the blend, in the guard's metric",
    "doing": "what the robot is doing",
    "course": "how many courses it has followed before this one; 0 is the reference as given",
    "tau": "[s] the clock of the course, which waits for the robot",
    "rate": "how fast that clock goes, in [0, 1]",
    "to_go": "[m] straight to the end of the reference as given",
    "arrived": "whether that is near enough; with the paper's law, to the desired position",
}
"""Unit and meaning of every field of a step, embedded in the file."""

_VERDICTS = {
    "UNTOUCHED": UNTOUCHED,
    "SHAPED": SHAPED,
    "POWERLESS": POWERLESS,
    "INVALID": INVALID,
    "BRAKING": BRAKING,
    "STANDING": STANDING,
}
_DOING = {"FOLLOWING": FOLLOWING, "LED": LED, "ESCAPING": ESCAPING, "EVADING": EVADING}
_CONSTANTS = {"verdict": _VERDICTS, "doing": _DOING}
_COLUMNS = {
    "obstacle_x": (X, "[m] centres, world frame, in the order of the names in the metadata"),
    "obstacle_y": (Y, "[m]"),
    "obstacle_vx": (VX, "[m/s] velocities, world frame"),
    "obstacle_vy": (VY, "[m/s]"),
    "obstacle_radius": (RADIUS, "[m]"),
    "obstacle_safe": (SAFE, "[m] r_i, safe distance between centres (19)"),
}
ARRAYS = {"obstacle_h": "[m^2] h_i of every obstacle"} | {
    name: meaning for name, (_, meaning) in _COLUMNS.items()
}
"""... and of every array, with one number for each obstacle."""


def _definition() -> str:
    """The message definition, with a comment on every field."""
    lines = [f"# One control step of cohelm, definition {VERSION}. Numbers in () are equations."]
    for name in ROW.names or ():
        kind = ROW[name].name  # float64, int64 and bool are called the same in ROS
        # constants right before a field show as its names in Foxglove
        lines += [f"{kind} {word}={value}" for word, value in _CONSTANTS.get(name, {}).items()]
        lines.append(f"{kind} {name.lower()}  # {MEANINGS[name]}")
    lines += [f"float64[] {name}  # {meaning}" for name, meaning in ARRAYS.items()]
    return "\n".join(lines) + "\n"


DEFINITION = _definition()
STORE = get_typestore(Stores.ROS2_JAZZY)
"""ROS 2's own message types, and ours."""
STORE.register(get_types_from_msg(DEFINITION, TYPE))


def encoded(piece: Trace) -> Iterator[bytes]:
    """Every step of a trace as one serialised message."""
    status = STORE.types[TYPE]
    arrays = [piece.h, *(piece.discs[:, :, column] for column, _ in _COLUMNS.values())]
    arrays = [np.ascontiguousarray(array) for array in arrays]
    for k, row in enumerate(piece.rows.tolist()):
        yield bytes(STORE.serialize_cdr(status(*row, *(array[k] for array in arrays)), TYPE))


def decoder(definition: str) -> Callable[[bytes], object]:
    """From a serialised message to the message, by the definition embedded in its file.

    Raises rosbags' `TypesysError` if this is no message definition.
    """
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, TYPE))
    return lambda data: store.deserialize_cdr(data, TYPE)


def decoded(messages: Sequence[object], names: tuple[str, ...], dt: float, scenario: str) -> Trace:
    """The trace whose steps these messages are.

    Raises AttributeError, naming the field, if the messages lack one.
    """
    row: Callable[[object], Any] = attrgetter(*(name.lower() for name in ROW.names or ()))
    rows = np.array([row(message) for message in messages], dtype=ROW)
    shape = (len(messages), len(names))
    discs = np.empty((*shape, 6))
    for name, (column, _) in _COLUMNS.items():
        discs[:, :, column] = _stacked(messages, name, shape)
    return Trace(rows, _stacked(messages, "obstacle_h", shape), discs, names, dt, scenario)


def _stacked(messages: Sequence[object], name: str, shape: tuple[int, int]) -> Floats:
    """One array field of all messages, shape (steps, obstacles)."""
    values: list[Floats] = [getattr(message, name) for message in messages]
    return np.array(values, dtype=np.float64).reshape(shape)
