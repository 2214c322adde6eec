"""The twin's camera: which one can draw here, and drawing without holding up the loop."""

from __future__ import annotations

import importlib
import math
import os
import threading
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit
from cohelm.core.types import Floats
from cohelm.robot.port import Frame
from cohelm.sim.twin import mjcf
from cohelm.sim.twin.engine import mujoco

Kind = Literal["auto", "gl", "rays", "none"]
"""The renderer: OpenGL if it can and else rays; one of them; or none."""

INSIDE = (mjcf.FLOOR, mjcf.WALL, mjcf.THING)
OUTSIDE = (*INSIDE, mjcf.ROBOT)
"""What is drawn as seen by the robot, and from outside."""


TwinCamera: TypeAlias = "GlCamera | RayCamera"


class Shot(NamedTuple):
    """All that a picture of one instant needs."""

    stamp: float
    number: int
    qpos: Floats
    mocap: Floats


def camera(
    model: Any, width: int, height: int, kind: Kind = "auto", name: str = "camera",
    groups: tuple[int, ...] = INSIDE,
) -> TwinCamera:  # fmt: skip
    """A camera that can render here.

    Raises CohelmError where OpenGL is requested by name and can not render.
    """
    if kind != "rays":
        try:
            return GlCamera(model, width, height, name, groups)
        except Exception as error:  # a missing library shows in many ways
            if kind == "gl":
                raise CohelmError(
                    f"OpenGL can not draw here ({error}): install libegl1 and libgl1, or let the "
                    "camera be chosen by itself"
                ) from error
    return RayCamera(model, width, height, name, groups)


class Eye:
    """Renders shots as a camera of its own, from a copy: the simulation goes on meanwhile.

    With `aside` in a thread of its own, and only the newest shot; else on request. That thread's
    camera is there when the eye is: making it holds Python's lock, on a busy machine for seconds,
    in which nobody else in this process would answer.
    """

    def __init__(self, model: Any, width: int, height: int, kind: Kind, aside: bool) -> None:
        self._model, self._size = model, (width, height)
        self._kind: Kind = kind
        self._data: Any = None
        self._camera: TwinCamera | None = None
        self._shot: Shot | None = None
        self._frame: Frame | None = None
        self._trouble: Exception | None = None
        self._bell = threading.Condition()
        self._done = False
        self._thread: threading.Thread | None = None
        if aside:
            made = threading.Event()
            self._thread = threading.Thread(
                target=self._work, args=(made,), name="twin's camera", daemon=True
            )
            self._thread.start()
            made.wait()

    def offer(self, shot: Shot) -> None:
        """Something new to draw; what was offered before and is not begun is forgotten."""
        with self._bell:
            self._shot = shot
            self._bell.notify()

    def forget(self) -> None:
        """What was offered and is not begun is not drawn."""
        with self._bell:
            self._shot = None

    def newest(self) -> Frame | None:
        """The last picture. Raises what drawing raised."""
        if self._thread is None and self._shot is not None:
            self._frame, self._shot = self._drawn(self._shot), None
        if self._trouble is not None:
            raise self._trouble
        return self._frame

    def close(self) -> None:
        """Finish, and let go of everything."""
        with self._bell:
            self._done = True
            self._bell.notify()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        elif self._camera is not None:
            self._camera.close()

    def _work(self, made: threading.Event) -> None:
        try:
            self._make()
        except Exception as error:  # raised at the next read
            self._trouble = error
        made.set()
        while self._trouble is None:
            with self._bell:
                self._bell.wait_for(lambda: self._done or self._shot is not None)
                shot, self._shot = self._shot, None
            if self._done or shot is None:
                break
            try:
                self._frame = self._drawn(shot)
            except Exception as error:
                self._trouble = error
        if self._camera is not None:
            self._camera.close()

    def _make(self) -> TwinCamera:
        self._data = mujoco.MjData(self._model)
        self._camera = camera(self._model, *self._size, self._kind)
        return self._camera

    def _drawn(self, shot: Shot) -> Frame:
        made = self._camera or self._make()
        posed(self._model, self._data, shot)
        pixels = made.draw(self._data)
        pixels.flags.writeable = False
        return Frame(shot.stamp, shot.number, pixels)


def posed(model: Any, data: Any, shot: Shot) -> None:
    """Bring a simulation's bodies and cameras to where they were in a shot."""
    data.qpos[:] = shot.qpos
    data.mocap_pos[:] = shot.mocap
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)


class GlCamera:
    """Renders what one camera of the model sees, through OpenGL without a screen (EGL). Belongs to
    the thread that makes it.

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


_MOST = 320 * 240  # rays of a picture; a larger one repeats its pixels
_FAR = 60.0  # [m]
_AT_ONCE = 4096  # rays of one call: other threads get their turn in between


class RayCamera:
    """Draws what one camera of the model sees without OpenGL, as coarse as needed to be quick: one
    ray for every pixel, shaded by where it lands."""

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
        self._colours = np.where(coloured[:, None], 0.62, model.geom_rgba[:, :3]).astype(np.float64)
        self._floor = model.geom("floor").id
        n = len(self._rays)
        self._hit, self._far = np.empty(n, dtype=np.int32), np.empty(n)
        self._normals = np.empty((n, 3))

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
