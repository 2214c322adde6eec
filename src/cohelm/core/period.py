"""The record of one period of the loop: what every room that writes or reads drives agrees on."""

from __future__ import annotations

import numpy as np

PERIOD = np.dtype(
    [
        ("t", "f8"),  # the robot's clock when the period began [s]
        ("x", "f8"), ("y", "f8"), ("psi", "f8"),  # where it takes itself to be, in the map
        ("sigma", "f8"),  # standard deviation of that place [m]
        ("share", "f8"),  # of the beams that agree with the map
        ("lost", "?"),
        ("v_measured", "f8"), ("omega_measured", "f8"),
        ("stick_x", "f8"), ("stick_psi", "f8"),  # the deflection in use
        ("arming", "i8"),  # link.messages.Arming
        ("stick_age", "f8"),  # of the newest command of the operator [s]; NaN: none
        ("mode", "i8"),  # robot.gate.modes.Mode
        ("doing", "i8"),  # pilot.step: FOLLOWING, LED, ESCAPING, EVADING; -1: nothing
        ("authority_x", "f8"), ("authority_psi", "f8"),
        ("x_d", "f8"), ("y_d", "f8"), ("psi_d", "f8"),  # what is followed
        ("e_p", "f8"),  # E_P (51)
        ("tau", "f8"), ("rate", "f8"),  # the course's clock [s], and how fast it goes
        ("v_wished", "f8"), ("omega_wished", "f8"),  # the blend, before the guard
        ("v_asked", "f8"), ("omega_asked", "f8"),  # of the gate
        ("v_given", "f8"), ("omega_given", "f8"),  # what the robot tries
        ("verdict", "i8"),  # law.verdict
        ("culprit", "i8"),
        ("gap", "f8"),  # of the outline to the nearest thing seen [m]
        ("odometry_age", "f8"), ("scan_age", "f8"),  # [s]
        ("late", "f8"),  # how long after its due time the period began [s]
        ("took", "f8"),  # from its beginning to the command [s]
        ("overruns", "i8"),  # so far
        ("refused", "i8"),  # proposals the gate has refused so far
        ("dropped", "i8"),  # messages the recorder had no room for, so far
        ("h", "f8"),  # least value of the paper's barrier (22) [m^2]
        ("culprit_x", "f8"), ("culprit_y", "f8"),  # where in the map that is
        ("progress", "f8"),  # share of the route done
    ]
)  # fmt: skip
"""Lengths in m, angles in rad, speeds in m/s and rad/s."""
