"""The twin's camera without any OpenGL: one ray for every pixel, shaded by where it lands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.sim.twin.engine import mujoco

_MOST = 320 * 240  # rays of a picture; a larger one repeats its pixels
_FAR = 60.0  # [m]
_AT_ONCE = 4096  # rays of one call: other threads get their turn in between


class RayCamera:
    """Draws what one camera of the model sees, as coarse as needed to be quick."""

    def __init__(
        self, model: Any, width: int, height: int, camera: str, groups: tuple[int, ...]
    ) -> None:
        self._model, self._camera = model, model.camera(camera).id
        self._size = (height, width)
        self._coarse = max(math.ceil(math.sqrt(width * height / _MOST)), 1)
        rows, columns = -(-height // self._coarse), -(-width // self._coarse)
        self._shape = (rows, columns)
        focal = 0.5 * rows / math.tan(0.5 * math.radians(model.cam_fovy[self._camera]))
        across = (np.arange(columns) - 0.5 * (columns - 1)) / focal
        up = -(np.arange(rows) - 0.5 * (rows - 1)) / focal
        rays = np.empty((rows, columns, 3))
        rays[..., 0], rays[..., 1], rays[..., 2] = across, up[:, None], -1.0
        self._rays = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
        self._groups = np.array([group in groups for group in range(6)], dtype=np.uint8)
        coloured = model.geom_matid >= 0
        self._colours = np.where(
            coloured[:, None], 0.62, model.geom_rgba[:, :3]
        ).astype(np.float64)  # fmt: skip
        self._floor = model.geom("floor").id
        n = len(self._rays)
        self._hit, self._far = np.empty(n, dtype=np.int32), np.empty(n)
        self._normals = np.empty((n, 3))

    @property
    def renderer(self) -> str:
        """The renderer's name."""
        rows, columns = self._shape
        return f"ray casting at {columns} x {rows}"

    def draw(self, data: Any) -> NDArray[np.uint8]:
        """(height, width, 3) RGB of a simulation whose kinematics are up to date."""
        turn = np.array(data.cam_xmat[self._camera]).reshape(3, 3)
        origin = np.array(data.cam_xpos[self._camera])
        rays = np.ascontiguousarray(self._rays @ turn.T)
        for a in range(0, len(rays), _AT_ONCE):
            b = min(a + _AT_ONCE, len(rays))
            mujoco.mj_multiRay(
                self._model, data, origin, rays[a:b].ravel(), self._groups, True, -1,
                self._hit[a:b], self._far[a:b], self._normals[a:b].reshape(-1), b - a, _FAR,
            )  # fmt: skip
        small = np.empty((len(rays), 3), dtype=np.uint8)
        _paint(origin, rays, self._hit, self._far, self._normals, self._colours, self._floor, small)
        picture = small.reshape(*self._shape, 3)
        if self._coarse > 1:
            picture = picture.repeat(self._coarse, axis=0).repeat(self._coarse, axis=1)
        return np.ascontiguousarray(picture[: self._size[0], : self._size[1]])

    def close(self) -> None:
        """Nothing to let go of."""


@jit
def _paint(
    origin: Floats, rays: Floats, hit: NDArray[np.int32], far: Floats, normals: Floats,
    colours: Floats, floor: int, pixels: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Colours of where rays land: the floor's tiles of 1 m, light from above, sky where nothing."""
    for i in range(len(rays)):
        g = hit[i]
        if g < 0 or not far[i] >= 0.0:
            up = max(rays[i, 2], 0.0)
            pixels[i, 0] = int(255 * (0.72 - 0.27 * up))
            pixels[i, 1] = int(255 * (0.82 - 0.22 * up))
            pixels[i, 2] = int(255 * (0.92 - 0.12 * up))
            continue
        light = 0.75 + 0.2 * abs(normals[i, 2]) + 0.15 * abs(normals[i, 0])
        if g == floor:
            x, y = origin[0] + far[i] * rays[i, 0], origin[1] + far[i] * rays[i, 1]
            light = 1.0 if int(math.floor(x) + math.floor(y)) % 2 else 0.88
        for k in range(3):
            pixels[i, k] = int(255 * min(colours[g, k] * light, 1.0))
