"""One row: all that is known of one control period, of a simulated run as of a drive.

Every room that simulates, records, plays back, scores or draws agrees on it; the message
`/period`, tables and docs are made from `FIELDS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

FIELDS = (
    ("t", "f8", "[s] when the period began: since a run's start, or by the robot's clock"),
    ("x", "f8", "[m] pose in the map before the command acts; in a drive as estimated"),
    ("y", "f8", "[m]"),
    ("psi", "f8", "[rad] heading, counter-clockwise from x"),
    ("sigma", "f8", "[m] standard deviation of the position"),
    ("share", "f8", "share of the beams that agree with the map, in [0, 1]"),
    ("lost", "?", "whether localization is lost"),
    ("measured_v", "f8", "[m/s] by odometry; NaN while that is missing, old or no number"),
    ("measured_omega", "f8", "[rad/s]"),
    ("x_d", "f8", "[m] desired pose (7), in the map"),
    ("y_d", "f8", "[m]"),
    ("psi_d", "f8", "[rad]"),
    ("u_d", "f8", "[m/s] desired surge speed (10)"),
    ("r_d", "f8", "[rad/s] desired yaw rate (10)"),
    ("e_p", "f8", "E_P, pose error (51), when the command takes effect"),
    ("tau", "f8", "[s] time along the course; it waits for the robot"),
    ("rate", "f8", "rate at which that time advances, in [0, 1]"),
    ("course", "i8", "number of the course; 0: the reference itself"),
    ("to_go", "f8", "[m] straight-line distance to the end of the reference"),
    ("progress", "f8", "share of the route done, in [0, 1]"),
    ("arrived", "?", "whether the goal is reached; with the paper's law, when it should be"),
    ("stick_x", "f8", "deflection in use, fore-aft in [-1, 1], forward positive"),
    ("stick_psi", "f8", "deflection in use, left-right in [-1, 1], left positive"),
    ("stick_age", "f8", "[s] of the operator's newest command; NaN: none"),
    ("arming", "i8", "state of the stick"),
    ("mode", "i8", "of the gate"),
    ("behavior", "i8", "behavior in use"),
    ("docking", "i8", "docking phase"),
    ("dock", "i8", "number of the dock, from 1; 0: none"),
    ("authority_x", "f8", "automatic share of surge: exp(-V_h), V_h = intent_x + intent_psi (48)"),
    ("authority_psi", "f8", "automatic share of yaw; differs from authority_x only per axis (44)"),
    ("intent_x", "f8", "V_hx (41)"),
    ("intent_psi", "f8", "V_hpsi (42)"),
    ("tracking_v", "f8", "[m/s] command of the tracking law, tau_c (15)"),
    ("tracking_omega", "f8", "[rad/s]"),
    ("operator_v", "f8", "[m/s] command of the operator, tau_h (38)"),
    ("operator_omega", "f8", "[rad/s]"),
    ("nominal_v", "f8", "[m/s] the blend of both, before the filter, (34); not `tau`"),
    ("nominal_omega", "f8", "[rad/s]"),
    ("avoid_v", "f8", "[m/s] collision-avoidance input u (33)"),
    ("avoid_omega", "f8", "[rad/s]"),
    ("safe_v", "f8", "[m/s] command U (49): what the filter lets through"),
    ("safe_omega", "f8", "[rad/s]"),
    ("applied_v", "f8", "[m/s] what the wheels try: after the gate, or a run's delay and limits"),
    ("applied_omega", "f8", "[rad/s]"),
    ("saturated", "?", "whether the wheel limits changed the command"),
    ("I", "f8", "growth of the barrier under the nominal command (31)"),
    ("J", "f8", "growth that is tolerated (32)"),
    ("h", "f8", "[m^2] smallest h_i (19)"),
    ("verdict", "i8", "what the filter did; -1: none was at work, or it is inside a law by others"),
    ("limiting", "i8", "index of the limiting obstacle; -1: none, or the heading term"),
    ("limiting_x", "f8", "[m] its position in the map; NaN: none"),
    ("limiting_y", "f8", "[m]"),
    (
        "clearance_seen",
        "f8",
        "[m] to what is seen; in a run, to what the filter looked at; inf: nothing; NaN: not known",
    ),
    ("change", "f8", "[m/s] distance of the command from the blend, in the guard's metric"),
    ("clearance", "f8", "[m] of the real outline to the nearest disc or wall; NaN in a drive"),
    ("energy", "f8", "passivity integral (40) of a run; NaN in a drive, where drivers change"),
    ("odometry_age", "f8", "[s]"),
    ("scan_age", "f8", "[s] since its last beam"),
    ("late", "f8", "[s] lateness of the beginning of the period"),
    ("took", "f8", "[s] computing time, from its beginning to the command"),
    ("overruns", "i8", "missed periods, so far"),
    ("refused", "i8", "commands refused by the gate, so far"),
    ("dropped", "i8", "messages dropped by the recorder, so far"),
)
"""Name, kind and meaning. Lengths in m, angles in rad, speeds in m/s and rad/s; numbers in () are
equations of the paper. NaN, or -1 of a number that counts or names, is "not known"."""

ROW = np.dtype([(name, kind) for name, kind, _ in FIELDS])
"""One control period. The command is decided at `t` from the pose in the same row."""

MEANINGS = {name: meaning for name, _, meaning in FIELDS}
"""Unit and meaning of every field; they stand in every record."""

_NOTHING = {"f8": math.nan, "i8": -1, "?": False}
_UNKNOWN = tuple((name, _NOTHING[kind]) for name, kind, _ in FIELDS)
_EMPTY = np.array(tuple(nothing for _, nothing in _UNKNOWN), dtype=ROW)


def blank(n: int) -> NDArray[np.void]:
    """Rows of which nothing is known yet, shape (n,)."""
    return np.repeat(_EMPTY, n)  # np.full of a structured type is eight times as slow


def values(known: Mapping[str, Any]) -> tuple[Any, ...]:
    """The values of a row of which so much is known, in the order of `FIELDS`; other names are
    left out."""
    return tuple(known.get(name, nothing) for name, nothing in _UNKNOWN)
