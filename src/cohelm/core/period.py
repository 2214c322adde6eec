"""The record of one period of the loop: what every room that writes or reads drives agrees on."""

from __future__ import annotations

import numpy as np

_FIELDS = (
    ("t", "f8", "[s] the robot's clock when the period began"),
    ("x", "f8", "[m] where the robot takes itself to be, in the map"),
    ("y", "f8", "[m]"),
    ("psi", "f8", "[rad] heading, counter-clockwise from x"),
    ("sigma", "f8", "[m] standard deviation of that place"),
    ("share", "f8", "of the beams, those that agree with the map, in [0, 1]"),
    ("lost", "?", "whether the robot knows that it does not know where it is"),
    ("measured_v", "f8", "[m/s] by odometry"),
    ("measured_omega", "f8", "[rad/s]"),
    ("stick_x", "f8", "deflection in use, fore-aft in [-1, 1], forward positive"),
    ("stick_psi", "f8", "deflection in use, left-right in [-1, 1], left positive"),
    ("arming", "i8", "how far the stick is believed: ABSENT 0, WAITING 1, ARMED 2"),
    ("stick_age", "f8", "[s] of the operator's newest command; NaN: none"),
    ("mode", "i8", "of the gate: IDLE 0, AUTOMATIC 1, SHARED 2, STOPPED 3, FAULTED 4"),
    ("doing", "i8", "FOLLOWING 0, LED 1, ESCAPING 2, EVADING 3; -1: nothing"),
    ("authority_x", "f8", "automatic share of surge (48)"),
    ("authority_psi", "f8", "automatic share of yaw"),
    ("x_d", "f8", "[m] desired pose (7), in the map"),
    ("y_d", "f8", "[m]"),
    ("psi_d", "f8", "[rad]"),
    ("e_p", "f8", "E_P, pose error (51)"),
    ("tau", "f8", "[s] the clock of the path, which waits for the robot"),
    ("rate", "f8", "how fast that clock goes, in [0, 1]"),
    ("nominal_v", "f8", "[m/s] the blend, before the guard (34)"),
    ("nominal_omega", "f8", "[rad/s]"),
    ("safe_v", "f8", "[m/s] what the gate was asked for, after the guard"),
    ("safe_omega", "f8", "[rad/s]"),
    ("applied_v", "f8", "[m/s] what the gate passed and the robot tries"),
    ("applied_omega", "f8", "[rad/s]"),
    ("verdict", "i8", "what the guard did"),
    ("culprit", "i8", "row of the obstacle it acted for; -1: none"),
    ("gap", "f8", "[m] of the outline to the nearest thing seen"),
    ("odometry_age", "f8", "[s]"),
    ("scan_age", "f8", "[s] since its last beam"),
    ("late", "f8", "[s] how long after its due time the period began"),
    ("took", "f8", "[s] from its beginning to the command"),
    ("overruns", "i8", "periods that were missed, so far"),
    ("refused", "i8", "commands the gate has refused, so far"),
    ("dropped", "i8", "messages the recorder had no room for, so far"),
    ("h", "f8", "[m^2] least value of the paper's barrier (19)"),
    ("culprit_x", "f8", "[m] where in the map the guard acted for something; NaN: nowhere"),
    ("culprit_y", "f8", "[m]"),
    ("progress", "f8", "share of the route done, in [0, 1]"),
)
PERIOD = np.dtype([(name, kind) for name, kind, _ in _FIELDS])
"""Lengths in m, angles in rad, speeds in m/s and rad/s."""

MEANINGS = {name: meaning for name, _, meaning in _FIELDS}
"""Unit and meaning of every field, embedded in the file."""
