"""The peers, each in a process of its own: cbfpy (a barrier filter) and ir-sim (a simulator).

They come with the extra `peers`; without them nothing here fails, there is only nothing
to compare with. A process of their own, because both set up their surroundings on import (JAX's
precision and threads, matplotlib's backend, prints), and because the settings they recommend have
to be there before it. This module is also what that process runs.

What is equal, and what is not:

cbfpy
    Equal: the poses, the discs, the wish, float64, the guarantee (the robot's centre stays r_i
    from each disc's centre). Not equal: cbfpy solves the usual quadratic program, min |U - tau|^2
    with one constraint per disc on a point ahead of the axle; the paper's filter is one explicit
    formula over a sum. cbfpy is timed for the filter alone, its inputs already on the device; our
    time is the whole control step (tracking, human, blending, filter, report) from plain Python
    numbers. Two backends: qpax, the default, with its default tolerance, and elastiqp, an extra
    that is faster on a CPU, at the tolerance it asks for.
ir-sim
    Equal: outline, start, four discs, time step, and the commands, which are those of our run;
    nothing is drawn. Not equal: ir-sim is handed the commands, and tests for collision by
    shapely; our run computes the commands, and records 38 columns and every disc at every step.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Self

import numpy as np

from cohelm.core.extras import pip_line

from .measure import median_call_us

AHEAD_M = 0.1
"""Distance of cbfpy's guarded point ahead of the axle: there both inputs can move it."""

INSTALL = f"not installed: {pip_line('peers')}"

_NEEDS = {"qpax": ("cbfpy",), "elastiqp": ("cbfpy", "elastiqp"), "ir-sim": ("irsim",)}

_HERE = str(Path(__file__).parents[len(str(__package__).split("."))])
"""Where Python finds this package, in a checkout and in a wheel."""

# What cbfpy advises for a CPU; and no window for matplotlib.
_SETTINGS = {
    "JAX_ENABLE_X64": "1",
    "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "OPENBLAS_NUM_THREADS": "1",
    "MPLBACKEND": "Agg",
}


class PeerFailed(Exception):
    """A peer is installed, but did not do what was asked of it."""


def installed(name: str) -> bool:
    """Whether all that the peer `qpax`, `elastiqp` or `ir-sim` needs can be imported."""
    return all(importlib.util.find_spec(module) is not None for module in _NEEDS[name])


class Peer:
    """A peer's process: `send` a question, and later `receive` its answer.

    Discs are rows (x, y, r). Questions of cbfpy, r the safe distance r_i:
    {"field": n, "discs", "poses", "wishes"} compiles for n discs,
    {"time": n, "calls"} gives {"us"}, {"filter": n, "pose", "wish"} gives {"command"}.
    Questions of ir-sim, r the body's radius: {"start", "size", "discs", "commands", "dt"} makes a
    world, {"run": true} gives {"steps_per_s", "pose"}.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.peers", name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_SETTINGS, "PYTHONPATH": _HERE},
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):  # a question it never read is still in the pipe
                if pipe is not None:
                    pipe.close()
        self._process.wait()

    def send(self, question: dict[str, Any]) -> None:
        """Put a question; the answer is for `receive`."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
        except OSError as gone:
            raise PeerFailed(f"{self.name} ended unasked") from gone

    def receive(self) -> dict[str, Any]:
        """Wait for the answer. Raises PeerFailed with the peer's own words."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        answer: dict[str, Any] = json.loads(line) if line else {"error": "ended unasked"}
        if "error" in answer:
            raise PeerFailed(f"{self.name} {answer['error']}")
        return answer

    def ask(self, question: dict[str, Any]) -> dict[str, Any]:
        """`send`, then `receive`."""
        self.send(question)
        return self.receive()


Answer = Callable[[dict[str, Any]], dict[str, Any]]


def _cbfpy(backend: str) -> Answer:
    """Answer for cbfpy; a filter is compiled per number of discs."""
    jax: Any = importlib.import_module("jax")
    jnp: Any = importlib.import_module("jax.numpy")
    cbfpy: Any = importlib.import_module("cbfpy")
    base: Any = cbfpy.CBFConfig

    class Unicycle(base):
        """z = (x, y, psi), u = (v, omega); h_i = |p + AHEAD e - o_i|^2 - (r_i + AHEAD)^2.

        h_i >= 0 keeps the guarded point r_i + AHEAD from disc i, hence the centre r_i.
        """

        def f(self, z: Any, discs: Any) -> Any:
            return jnp.zeros(3)

        def g(self, z: Any, discs: Any) -> Any:
            return jnp.array([[jnp.cos(z[2]), 0.0], [jnp.sin(z[2]), 0.0], [0.0, 1.0]])

        def h_1(self, z: Any, discs: Any) -> Any:
            x, y = z[0] + AHEAD_M * jnp.cos(z[2]), z[1] + AHEAD_M * jnp.sin(z[2])
            far = (x - discs[:, 0]) ** 2 + (y - discs[:, 1]) ** 2
            return far - (discs[:, 2] + AHEAD_M) ** 2

    # qpax at its default tolerance, 1e-3; elastiqp asks for 1e-5 or less
    options = {} if backend == "qpax" else {"solver_tol": 1e-6}
    ready: dict[int, tuple[Any, list[Any], list[Any], Any]] = {}

    def answer(question: dict[str, Any]) -> dict[str, Any]:
        if "field" in question:
            discs = jnp.asarray(question["discs"])
            cbf = cbfpy.CBF.from_config(
                Unicycle(n=3, m=2, backend=backend, init_args=(discs,), **options)
            )
            poses = [jnp.asarray(pose) for pose in question["poses"]]
            wishes = [jnp.asarray(wish) for wish in question["wishes"]]
            jax.block_until_ready(cbf.safety_filter(poses[0], wishes[0], discs))
            ready[question["field"]] = (cbf.safety_filter, poses, wishes, discs)
            return {}
        if "time" in question:
            filtered, poses, wishes, discs = ready[question["time"]]
            count = len(poses)

            def call(i: int) -> None:
                filtered(poses[i % count], wishes[i % count], discs).block_until_ready()

            return {"us": median_call_us(call, question["calls"])}
        filtered, _, _, discs = ready[question["filter"]]
        command = filtered(np.array(question["pose"]), np.array(question["wish"]), discs)
        return {"command": np.asarray(command).tolist()}

    return answer


def _ir_sim() -> Answer:
    """Answer for ir-sim."""
    irsim: Any = importlib.import_module("irsim")
    made: dict[str, Any] = {}

    def answer(question: dict[str, Any]) -> dict[str, Any]:
        if "start" in question:
            made.update(question)
            made["env"] = _ir_sim_world(irsim, question)
            return {}
        env, commands = made["env"], made["commands"]
        env.reset()
        start = perf_counter()
        for command in commands:
            env.step(command)
        taken = perf_counter() - start
        pose = np.asarray(env.robot.state, dtype=np.float64).ravel()[:3].tolist()
        return {"steps_per_s": len(commands) / taken, "pose": pose}

    return answer


def _ir_sim_world(irsim: Any, question: dict[str, Any]) -> Any:
    length, width = question["size"]
    scene = {
        # unobstructed: collisions are looked for, but do not stop the robot, as in our run
        "world": {
            "width": 40.0, "height": 40.0, "offset": [-20.0, -20.0],
            "step_time": question["dt"], "collision_mode": "unobstructed",
        },
        "robot": [{
            "kinematics": {"name": "diff"},
            "shape": {"name": "rectangle", "length": length, "width": width},
            "state": question["start"],
            "vel_min": [-10.0, -20.0], "vel_max": [10.0, 20.0],
        }],
        "obstacle": [
            {"shape": {"name": "circle", "radius": radius}, "state": [x, y, 0.0]}
            for x, y, radius in question["discs"]
        ],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML
        return irsim.make(str(path), headless=True, log_level="CRITICAL")


def _serve(name: str) -> None:
    """Answer one JSON line with one JSON line until there are no more."""
    lines = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a peer prints must not mix with the answers
    answer: Answer | None = None
    for line in sys.stdin:
        try:
            answer = answer or (_ir_sim() if name == "ir-sim" else _cbfpy(name))
            given = answer(json.loads(line))
        except Exception as error:  # a peer may fail in any way; the bench goes on without it
            given = {"error": f"failed: {type(error).__name__}: {error}"}
        lines.write(json.dumps(given) + "\n")
        lines.flush()


if __name__ == "__main__":
    _serve(sys.argv[1])
