"""The one door to MuJoCo, which has no types, and to its `mj_step` for compiled code."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from numba import types

from cohelm.core.errors import CohelmError


def _found() -> Any:
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise CohelmError(
            f"the physics twin needs MuJoCo, which can not be loaded here ({error}): "
            "pip install --force-reinstall mujoco, or drive with --kinematic"
        ) from error


mujoco: Any = _found()
"""MuJoCo's Python package."""


def _step() -> Any:
    libraries = sorted(Path(mujoco.__file__).parent.glob("libmujoco*"))
    if not libraries:
        raise CohelmError("MuJoCo's library is not beside its Python package: install it again")
    loader: Any = importlib.import_module("llvmlite.binding")
    loader.load_library_permanently(str(libraries[0]))
    kinds: Any = types
    # pointers as whole numbers: the same registers, and no casts in compiled code
    return kinds.ExternalFunction("mj_step", kinds.void(kinds.intp, kinds.intp))


mj_step: Any = _step()
"""void mj_step(const mjModel*, mjData*) for compiled code, which need not know Python for it."""


def address(struct: Any) -> int:
    """The address of an MjModel or MjData in memory."""
    return int(struct._address)
