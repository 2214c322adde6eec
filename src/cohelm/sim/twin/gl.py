"""The twin's camera through OpenGL, without a screen (EGL)."""

from __future__ import annotations

import importlib
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cohelm.sim.twin.engine import mujoco


class GlCamera:
    """Renders what one camera of the model sees. Belongs to the thread that makes it.

    Raises whatever EGL, OpenGL or MuJoCo raise where they can not render: the caller has another
    camera to fall back on.
    """

    def __init__(
        self, model: Any, width: int, height: int, camera: str, groups: tuple[int, ...]
    ) -> None:
        # Software rendering takes all cores if it may, and the robot's loop needs one.
        os.environ.setdefault("LP_NUM_THREADS", "1")
        self._model, self._size = model, (height, width)
        self._gl: Any = importlib.import_module("mujoco.egl").GLContext(width, height)
        try:
            self._gl.make_current()
            self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 10)
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                self._scene.flags[flag] = 0
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
            if self._context.currentBuffer != mujoco.mjtFramebuffer.mjFB_OFFSCREEN:
                raise RuntimeError("OpenGL has no off-screen buffer")
        except BaseException:
            self._gl.free()
            raise
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = [group in groups for group in range(6)]
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._view.fixedcamid = model.camera(camera).id
        self._rect = mujoco.MjrRect(0, 0, width, height)

    @property
    def renderer(self) -> str:
        """The renderer's name."""
        gl: Any = importlib.import_module("OpenGL.GL")
        renderer = gl.glGetString(gl.GL_RENDERER) or b"unknown"
        return f"OpenGL through EGL on {renderer.decode(errors='replace')}"

    def draw(self, data: Any) -> NDArray[np.uint8]:
        """(height, width, 3) RGB of a simulation whose kinematics are up to date."""
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self._view, mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )  # fmt: skip
        mujoco.mjr_render(self._rect, self._scene, self._context)
        pixels = np.empty((*self._size, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return np.ascontiguousarray(pixels[::-1])

    def close(self) -> None:
        """Let go of OpenGL."""
        self._context.free()
        self._gl.free()
