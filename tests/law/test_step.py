import math

import numba
import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from cohelm.core.types import Desired, Pose, Stick, disc, discs
from cohelm.law.gains import Gains
from cohelm.law.step import Step, step
from cohelm.law.verdict import INVALID, SHAPED, UNTOUCHED
from tests.law import states
from tests.law.test_track import turned

PAPER = Gains()
COMPILED = not numba.config.DISABLE_JIT
POSE = Pose(0.0, 0.0, 0.2)
DESIRED = Desired(0.1, 0.1, 0.3, 0.5, 0.1)
STICK = Stick(0.3, -0.2)
SCENE = discs(disc(0.5, 0.1, 0.1), disc(-2.0, 1.0, 0.1, vx=0.2))

only_compiled = pytest.mark.skipif(
    not COMPILED, reason="uncompiled, Python's math raises where IEEE arithmetic gives inf or NaN"
)
any_float = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True, allow_subnormal=True),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 1e154, 1e-200]),
)
any_rows = st.lists(st.tuples(*[any_float] * 6), max_size=5).map(lambda rows: discs(*rows))
any_gains = st.tuples(*[any_float] * 10, st.booleans(), st.booleans(), st.booleans())


@only_compiled
@given(
    st.tuples(*[any_float] * 3), st.tuples(*[any_float] * 5), st.tuples(*[any_float] * 2),
    any_rows, st.one_of(st.just(PAPER), any_gains.map(lambda g: Gains(*g))),
)  # fmt: skip
def test_whatever_comes_in_no_nan_goes_out(pose, desired, stick, scene, gains):
    s = step(Pose(*pose), Desired(*desired), Stick(*stick), scene, gains)
    assert math.isfinite(s.safe_v)
    assert math.isfinite(s.safe_omega)
    if s.verdict == INVALID:
        assert (s.safe_v, s.safe_omega) == (0.0, 0.0)


inputs = [
    *[("pose", k) for k in range(3)],
    *[("desired", k) for k in range(5)],
    *[("stick", k) for k in range(2)],
    *[("scene", k) for k in (0, 1, 2, 3, 5)],  # the body's own radius is not the law's business
]


def reported(where, k, value, gains=PAPER):
    """A healthy scene with one number replaced."""
    given = {"pose": POSE, "desired": DESIRED, "stick": STICK}
    scene = SCENE.copy()
    if where == "scene":
        scene[1, k] = value
    else:
        kind = type(given[where])
        given[where] = kind(*[value if j == k else x for j, x in enumerate(given[where])])
    return step(given["pose"], given["desired"], given["stick"], scene, gains)


STANDING = Step(*[0.0] * 17, INVALID, -1)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("where", "k"), inputs)
def test_a_number_that_is_not_finite_means_stand_still(where, k, value):
    if not COMPILED and (math.isinf(value) or where == "scene"):
        pytest.skip("uncompiled, Python's math raises where IEEE arithmetic gives inf or NaN")
    assert reported(where, k, value) == STANDING


@pytest.mark.parametrize(
    "stick", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf)]
)
@pytest.mark.parametrize("barrier", [True, False])
def test_a_stick_that_is_no_number_is_neither_centred_nor_full(stick, barrier):
    gains = PAPER._replace(barrier=barrier)
    assert step(POSE, DESIRED, Stick(*stick), SCENE, gains) == STANDING


def test_with_the_barrier_off_obstacles_are_not_even_read():
    bad = SCENE.copy()
    bad[:] = math.nan
    s = step(POSE, DESIRED, STICK, bad, PAPER._replace(barrier=False))
    assert (s.safe_v, s.safe_omega) == (s.nominal_v, s.nominal_omega)
    assert (s.verdict, s.limiting, s.h) == (UNTOUCHED, -1, math.inf)


def test_paper_gains_are_the_default():
    assert step(POSE, DESIRED, STICK, SCENE) == step(POSE, DESIRED, STICK, SCENE, Gains())
    assert PAPER[:10] == (0.9, 1.0, 0.5, 0.5, 1.5, 0.5, 0.5, 5.0, 0.05, 0.5)  # Table II, E3
    assert (PAPER.barrier, PAPER.joint, PAPER.true_sign) == (True, True, True)


@given(states.poses, states.desireds, states.sticks(), st.data())
def test_the_command_is_the_blend_and_the_avoidance_input(pose, desired, stick, data):
    """(49)."""
    s = step(pose, desired, stick, data.draw(states.scenes(pose)))
    assert s.safe_v == pytest.approx(s.nominal_v + s.avoid_v, rel=1e-12, abs=1e-12)
    assert s.safe_omega == pytest.approx(s.nominal_omega + s.avoid_omega, rel=1e-12, abs=1e-12)


@given(
    states.poses, states.desireds, states.sticks(), st.integers(-20, 20), st.integers(-20, 20),
    st.data(),
)  # fmt: skip
def test_whole_turns_of_either_heading_give_the_same_command(pose, desired, stick, own, goal, data):
    scene = data.draw(states.scenes(pose, nearest=0.05))
    one = step(pose, desired, stick, scene)
    two = step(
        pose._replace(psi=pose.psi + 2 * math.pi * own),
        desired._replace(psi=desired.psi + 2 * math.pi * goal), stick, scene,
    )  # fmt: skip
    assert (two.nominal_v, two.nominal_omega) == pytest.approx(
        (one.nominal_v, one.nominal_omega), rel=1e-9, abs=1e-9
    )
    if abs(one.I - one.J) > 1e-9 * (1 + abs(one.I)) and abs(math.sin(2 * pose.psi)) > 1e-3:
        size = 1 + abs(one.avoid_v) + abs(one.avoid_omega)
        assert (two.safe_v, two.safe_omega) == pytest.approx(
            (one.safe_v, one.safe_omega), abs=1e-9 * size
        )


@given(states.poses, states.desireds, states.sticks(), st.floats(-math.pi, math.pi))
@example(POSE, DESIRED, STICK, math.pi / 2)
def test_tracking_and_blend_do_not_depend_on_where_north_is(pose, desired, stick, angle):
    off = PAPER._replace(barrier=False)
    one = step(pose, desired, stick, discs(), off)
    two = step(turned(pose, angle), turned(desired, angle), stick, discs(), off)
    assert (two.safe_v, two.safe_omega) == pytest.approx((one.safe_v, one.safe_omega), abs=1e-9)


def test_a_full_stick_into_an_obstacle_is_still_shaped():
    """The person's wish goes through the filter like the controller's."""
    scene = discs(disc(0.35, 0.05, 0.1))
    s = step(Pose(0.0, 0.0, 0.3), DESIRED, Stick(1.0, 0.0), scene)
    assert s.verdict == SHAPED
    assert s.safe_v < s.nominal_v
    assert np.sign(s.avoid_omega) == -1
