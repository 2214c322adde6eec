"""The paper's laboratory as reconstructed: waypoints, cones, mover, outline [m, m/s, s]."""

import numpy as np

WAYPOINTS = [
    (0, -1.75), (0, -0.75), (0, 0.25), (0, 1.25), (0, 2.25), (0, 3.25), (0.75, 4), (2, 4), (4, 4),
    (6, 4), (8, 4), (10, 4), (12.25, 4), (13, 3.25), (13, 2), (13, 1), (12.25, 0), (11, 0), (9, 0),
    (7, 0), (5, 0),
]  # fmt: skip
SPEED = 0.5
START = (0.0, -1.75, np.pi / 2)

NAMES = ("cone_1", "cone_2", "cone_3", "mover")
CONES = [(0, 1), (0, 0), (10, 4)]
CONE_RADIUS = 0.1
SAFE = 0.2

MOVER = [(9, -1.5), (10.5, -1.5), (12, -1.5), (13, -1), (13, 0), (13, 1), (13, 2)]
MOVER_SPEED = 0.2
MOVER_START = 15.0

SALLY = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
TRACK = 0.5
