"""Runs for the record's tests: one in the lab, and ones of arbitrary bits."""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cohelm.core.row import ROW
from cohelm.core.trace import Trace
from cohelm.core.types import Pose, disc
from cohelm.drive.shown import reference_lines
from cohelm.law.reference import through
from cohelm.record.write import Recorder, RunScene
from cohelm.robot.limits import unlimited
from cohelm.sim.operator_model import OperatorModel
from cohelm.sim.run import pieces
from cohelm.sim.setup import Setup
from cohelm.sim.world import Body, world

LAB = [
    (0, -1.75), (0, -0.75), (0, 0.25), (0, 1.25), (0, 2.25), (0, 3.25), (0.75, 4), (2, 4), (4, 4),
    (6, 4), (8, 4), (10, 4), (12.25, 4), (13, 3.25), (13, 2), (13, 1), (12.25, 0), (11, 0), (9, 0),
    (7, 0), (5, 0),
]  # fmt: skip
MOVER = [(9, -1.5), (10.5, -1.5), (12, -1.5), (13, -1), (13, 0), (13, 1), (13, 2)]
OUTLINE = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
WALLS = np.array([[-1.0, -2.5, -1.0, 5.0], [-1.0, 5.0, 14.0, 5.0]])


def lab(duration: float | None = None) -> Setup:
    """The paper's lab: three cones, a mover, a person who dodges what they notice."""
    bodies = [
        Body(disc(0, 1, 0.1)),
        Body(disc(0, 0, 0.1)),
        Body(disc(10, 4, 0.1), noticed=False),
        Body(disc(9, -1.5, 0.1), through(MOVER, 0.2), 15.0),
    ]
    return Setup(
        start=Pose(0.0, -1.75, math.pi / 2),
        reference=through(LAB, 0.5),
        outline=OUTLINE,
        limits=unlimited(0.5),
        obstacles=world((bodies, WALLS)),
        names=("cone_1", "cone_2", "cone_3", "mover"),
        operator=OperatorModel(active=True),
        duration=duration,
        scenario="# the lab, größer\nrobot: sally\n",
    )


def scene(setup: Setup) -> RunScene:
    return RunScene(setup.outline, setup.obstacles.walls, reference_lines(setup.reference))


def recorded(path: Path, setup: Setup) -> Trace:
    """Run, write piece by piece, and give back what was written."""
    whole: Trace | None = None
    with Recorder(path, scene(setup)) as recorder:
        for piece in pieces(setup):
            recorder.write(piece)
            whole = piece if whole is None else whole.joined(piece)
    assert whole is not None
    return whole


def parts(trace: Trace, cuts: list[int]) -> Iterator[Trace]:
    """A trace cut at these steps; equal cuts give empty pieces."""
    ends = [0, *sorted(cuts), len(trace)]
    for a, b in pairwise(ends):
        yield Trace(
            trace.rows[a:b], trace.h[a:b], trace.discs[a:b], trace.names, trace.dt, trace.scenario
        )


@st.composite
def traces(draw: st.DrawFn) -> Trace:
    """Any bits in any number: signed zeros, subnormals, infinities, every NaN."""
    n, m = draw(st.integers(1, 20)), draw(st.integers(0, 3))
    dt = draw(st.floats(1e-4, 1.0))
    rows = np.zeros(n, dtype=ROW)
    for name in ROW.names or ():
        if ROW[name] == np.bool_:
            rows[name] = draw(arrays(np.bool_, n))
        else:
            rows[name] = draw(arrays(np.uint64, n)).view(ROW[name])
    rows["t"] = np.arange(n) * dt
    for axis in ("stick_x", "stick_psi"):
        rows[axis] = draw(arrays(np.float64, n, elements=st.floats(-1.0, 1.0)))
    return Trace(
        rows,
        draw(arrays(np.uint64, (n, m))).view(np.float64),
        draw(arrays(np.uint64, (n, m, 6))).view(np.float64),
        tuple(draw(st.lists(st.text(st.characters(codec="utf-8")), min_size=m, max_size=m))),
        dt,
        draw(st.text(st.characters(codec="utf-8"))),
    )


def bits(trace: Trace) -> tuple[object, ...]:
    """All of a trace, so that equal means equal to the last bit."""
    return (
        trace.rows.dtype, trace.rows.tobytes(),
        trace.h.dtype, trace.h.shape, trace.h.tobytes(),
        trace.discs.dtype, trace.discs.shape, trace.discs.tobytes(),
        trace.names, trace.dt, trace.scenario,
    )  # fmt: skip
