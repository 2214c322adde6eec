"""States that the law's tests draw: poses, sticks around the dead band's edge, discs, gains."""

import math

import numpy as np
from hypothesis import strategies as st

from cohelm.core.types import Desired, Floats, Pose, Stick, Twist
from cohelm.law.gains import Gains
from tests.oracle.paper import Goal, Parameters

angles = st.one_of(
    st.floats(-20.0, 20.0),
    st.sampled_from([k * math.pi / 2 for k in range(-4, 5)]),
)
lengths = st.floats(-10.0, 10.0)
poses = st.builds(Pose, lengths, lengths, angles)
desireds = st.builds(Desired, lengths, lengths, angles, st.floats(0.0, 2.0), st.floats(-3.0, 3.0))
twists = st.builds(Twist, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))


def deflections(band: float) -> st.SearchStrategy[float]:
    """One axis of the stick, often at the dead band's edge or the last float either side of it."""
    edges = [band, math.nextafter(band, 2.0), math.nextafter(band, -2.0), 1.0, 0.0]
    return st.one_of(st.floats(-1.0, 1.0), st.sampled_from([s * e for e in edges for s in (1, -1)]))


@st.composite
def sticks(draw: st.DrawFn, band: float = 0.05) -> Stick:
    return Stick(draw(deflections(band)), draw(deflections(band)))


@st.composite
def gains(draw: st.DrawFn, barrier: bool | None = None, true_sign: bool | None = None) -> Gains:
    positive = st.floats(0.05, 5.0)
    return Gains(
        k_x=draw(positive), k_psi=draw(positive), K=draw(positive), C=draw(positive),
        k_cbf=draw(positive), k_hx=draw(positive), k_hpsi=draw(positive),
        k_s=draw(st.floats(0.1, 20.0)), dead_band=draw(st.sampled_from([0.0, 0.05, 0.2])),
        u_d=draw(st.floats(0.05, 2.0)),
        barrier=draw(st.booleans()) if barrier is None else barrier, joint=draw(st.booleans()),
        true_sign=draw(st.booleans()) if true_sign is None else true_sign,
    )  # fmt: skip


@st.composite
def scenes(
    draw: st.DrawFn, pose: Pose, least: int = 0, most: int = 8, nearest: float = 1e-3
) -> Floats:
    """Discs, resting or moving, around a robot outside each safe circle by `nearest` to 5 m."""
    rows = []
    for _ in range(draw(st.integers(least, most))):
        safe = draw(st.floats(0.05, 1.5))
        away = safe + draw(st.one_of(st.floats(nearest, 0.5), st.floats(nearest, 5.0)))
        where = draw(st.floats(-math.pi, math.pi))
        speed = draw(st.one_of(st.just(0.0), st.floats(0.0, 2.0)))
        course = draw(st.floats(-math.pi, math.pi))
        rows.append((
            pose.x + away * math.cos(where), pose.y + away * math.sin(where),
            speed * math.cos(course), speed * math.sin(course), draw(st.floats(0.01, 1.0)), safe,
        ))  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def eta(pose: Pose) -> np.ndarray:
    return np.array(pose)


def as_goal(desired: Desired) -> Goal:
    return Goal(*desired)


def as_rows(discs: Floats) -> np.ndarray:
    """The oracle's disc rows: it knows only the safe distance, not the body's own radius."""
    return discs[:, [0, 1, 2, 3, 5]]


def as_parameters(g: Gains) -> Parameters:
    return Parameters(
        k_x=g.k_x, k_psi=g.k_psi, K=g.K, C=g.C, k_cbf=g.k_cbf, k_hx=g.k_hx, k_hpsi=g.k_hpsi,
        k_s=g.k_s, c_joy=g.dead_band, joint=g.joint, printed_sign=not g.true_sign,
        barrier=g.barrier,
    )  # fmt: skip
