"""The twin's camera: which one can draw here, and drawing without holding up the loop."""

from __future__ import annotations

import threading
from typing import Any, Literal, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats
from cohelm.robot.port import Frame
from cohelm.sim.twin import mjcf
from cohelm.sim.twin.engine import mujoco
from cohelm.sim.twin.gl import GlCamera
from cohelm.sim.twin.rays import RayCamera

Kind = Literal["auto", "gl", "rays", "none"]
"""The renderer: OpenGL if it can and else rays; one of them; or none."""

INSIDE = (mjcf.FLOOR, mjcf.WALL, mjcf.THING)
OUTSIDE = (*INSIDE, mjcf.ROBOT)
"""What is drawn as seen by the robot, and from outside."""


TwinCamera = GlCamera | RayCamera


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
    if kind == "rays":
        return RayCamera(model, width, height, name, groups)
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

    With `aside` in a thread of its own, and only the newest shot; else on request.
    """

    def __init__(self, model: Any, width: int, height: int, kind: Kind, aside: bool) -> None:
        self._model, self._size, self._aside = model, (width, height), aside
        self._kind: Kind = kind
        self._data: Any = None
        self._camera: TwinCamera | None = None
        self._shot: Shot | None = None
        self._frame: Frame | None = None
        self._trouble: Exception | None = None
        self._bell = threading.Condition()
        self._done = False
        self._thread = threading.Thread(target=self._work, name="twin's camera", daemon=True)
        if aside:
            self._thread.start()

    @property
    def renderer(self) -> str:
        """The renderer's name; known from the first picture on."""
        return "none yet" if self._camera is None else self._camera.renderer

    def offer(self, shot: Shot) -> None:
        """Something new to draw; what was offered before and is not begun is forgotten."""
        with self._bell:
            self._shot = shot
            self._bell.notify()

    def newest(self) -> Frame | None:
        """The last picture. Raises what drawing raised."""
        if not self._aside and self._shot is not None:
            self._frame, self._shot = self._drawn(self._shot), None
        if self._trouble is not None:
            raise self._trouble
        return self._frame

    def close(self) -> None:
        """Finish, and let go of everything."""
        with self._bell:
            self._done = True
            self._bell.notify()
        if self._aside:
            self._thread.join(timeout=5.0)
        elif self._camera is not None:
            self._camera.close()

    def _work(self) -> None:
        while True:
            with self._bell:
                self._bell.wait_for(lambda: self._done or self._shot is not None)
                shot, self._shot = self._shot, None
            if self._done or shot is None:
                break
            try:
                self._frame = self._drawn(shot)
            except Exception as error:  # raised at the next read
                self._trouble = error
                break
        if self._camera is not None:
            self._camera.close()

    def _drawn(self, shot: Shot) -> Frame:
        if self._camera is None:
            self._data = mujoco.MjData(self._model)
            self._camera = camera(self._model, *self._size, self._kind)
        posed(self._model, self._data, shot)
        pixels = self._camera.draw(self._data)
        pixels.flags.writeable = False
        return Frame(shot.stamp, shot.number, pixels)


def posed(model: Any, data: Any, shot: Shot) -> None:
    """Bring a simulation's bodies and cameras to where they were in a shot."""
    data.qpos[:] = shot.qpos
    data.mocap_pos[:] = shot.mocap
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
