"""Things to see, as points, and robots of two shapes."""

import numpy as np

JACKAL = np.array([[0.21, 0.165], [-0.21, 0.165], [-0.21, -0.165], [0.21, -0.165]])
LONG = np.array([[0.6, 0.15], [-0.6, 0.15], [-0.6, -0.15], [0.6, -0.15]])
NOTHING = np.empty((0, 2))


def wall(ax, ay, bx, by, spacing=0.01):
    n = max(int(np.hypot(bx - ax, by - ay) / spacing), 1) + 1
    return np.column_stack((np.linspace(ax, bx, n), np.linspace(ay, by, n)))


def room(x1, y1, x2, y2):
    return np.vstack((
        wall(x1, y1, x2, y1), wall(x2, y1, x2, y2), wall(x2, y2, x1, y2), wall(x1, y2, x1, y1),
    ))  # fmt: skip


def circle(x, y, radius, n=60):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))


def line(ax, ay, bx, by):
    return wall(ax, ay, bx, by, 0.1)
