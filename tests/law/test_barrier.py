import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from cohelm.core.types import Pose, Twist, disc, discs
from cohelm.law.barrier import HEADING, barrier
from cohelm.law.gains import Gains
from cohelm.law.verdict import POWERLESS, SHAPED, UNTOUCHED
from tests.law import states
from tests.law.test_track import turned
from tests.oracle import paper

PAPER = Gains()
EAGER = PAPER._replace(K=0.0, C=-1e12)  # the filter always acts, so that I is always reported


def growth(pose, nominal, scene, true_sign=True):
    """I as the law reports it (31)."""
    return barrier(pose, nominal, scene, EAGER._replace(true_sign=true_sign)).I


def B_after(pose, nominal, scene, t):
    """B (22) a moment later, robot on its arc and every disc on its way: only (6) and (22)."""
    x, y, psi = pose
    a = nominal.omega * t / 2
    chord = nominal.v * t * np.sinc(a / np.pi)
    eta = np.array([x + chord * np.cos(psi + a), y + chord * np.sin(psi + a), psi + 2 * a])
    rows = states.as_rows(scene).copy()
    rows[:, :2] += t * rows[:, 2:4]
    return paper.B(eta, rows)


def differenced(pose, nominal, scene, dt=1e-5):
    """dB/dt by a central difference of fourth order."""
    b = [B_after(pose, nominal, scene, k * dt) for k in (-2, -1, 1, 2)]
    return (b[0] - 8 * b[1] + 8 * b[2] - b[3]) / (12 * dt)


@given(states.poses, states.twists, st.data())
def test_the_growth_of_B_is_its_finite_difference(pose, nominal, data):
    """(26), (27) with the true sign, and (31) at once: L_gB and the discs' own motion."""
    scene = data.draw(states.scenes(pose, nearest=0.05))
    reported = differenced(pose, nominal, scene)
    steep = np.sum(1 / paper.margins(np.array(pose), states.as_rows(scene)) ** 2)
    slack = 1e-6 + 1e-7 * steep
    assert growth(pose, nominal, scene) == pytest.approx(reported, rel=1e-6, abs=slack)


@given(states.poses, st.data())
def test_each_entry_of_L_gB_is_the_growth_under_that_input_alone(pose, data):
    scene = data.draw(states.scenes(pose, nearest=0.05))
    scene[:, 2:4] = 0.0
    along = growth(pose, Twist(1.0, 0.0), scene)
    turning = growth(pose, Twist(0.0, 1.0), scene)
    reported = paper.L_gB(np.array(pose), states.as_rows(scene))
    assert (along, turning) == pytest.approx(tuple(reported), rel=1e-9, abs=1e-9)
    assert turning == pytest.approx(differenced(pose, Twist(0.0, 1.0), scene), rel=1e-6, abs=1e-4)


coming = st.builds(
    lambda away, speed: disc(away, 0.0, 0.1, vx=-speed), st.floats(0.3, 3.0), st.floats(0.01, 2.0)
)


@given(coming)
def test_an_obstacle_that_approaches_raises_the_growth_of_B(row):
    """E2: with the derivative's own sign."""
    still = disc(row[0], 0.0, 0.1)
    here, halt = Pose(0.0, 0.0, 0.4), Twist(0.0, 0.0)
    assert growth(here, halt, discs(row)) > growth(here, halt, discs(still)) == 0.0


@given(coming)
def test_with_the_printed_sign_an_approaching_obstacle_counts_as_receding(row):
    """E2: what (27) as printed does."""
    here, halt = Pose(0.0, 0.0, 0.4), Twist(0.0, 0.0)
    true, printed = (growth(here, halt, discs(row), sign) for sign in (True, False))
    assert printed < 0.0 < true
    assert printed == pytest.approx(-true, rel=1e-12)


@given(states.poses, states.twists, states.gains(barrier=True), st.data())
def test_a_nominal_command_that_B_tolerates_passes_untouched(pose, nominal, gains, data):
    scene = data.draw(states.scenes(pose))
    out = barrier(pose, nominal, scene, gains)
    if out.I <= out.J:
        assert out.verdict == UNTOUCHED
        assert out.input == (0.0, 0.0)
        assert out.limiting == -1
    else:
        assert out.verdict in (SHAPED, POWERLESS)


@given(st.data(), st.floats(-math.pi, math.pi))
def test_under_the_filter_B_grows_no_faster_than_E4_says(data, psi):
    """Ḃ ≤ K B + C + k_cbf with the command, by the twin; the paper's C > k_cbf is not needed."""
    pose = Pose(0.0, 0.0, psi)
    gains = data.draw(states.gains(barrier=True, true_sign=True))
    nominal, scene = data.draw(states.twists), data.draw(states.scenes(pose))
    rows, p = states.as_rows(scene), states.as_parameters(gains)
    slope = paper.L_gB(np.array(pose), rows)
    assume(slope @ slope > 1e-8)
    out = barrier(pose, nominal, scene, gains)
    U = np.array([nominal.v + out.input.v, nominal.omega + out.input.omega])
    grown, tolerated = paper.I_and_J(np.array(pose), U, rows, p)
    terms = abs(slope) @ abs(U) + abs(paper.drift(np.array(pose), rows, p)) + abs(tolerated)
    assert grown <= tolerated + gains.k_cbf + 1e-9 * terms


ABEAM = discs(disc(0.0, 0.35, 0.1, vy=-0.5))


@pytest.mark.parametrize("quarter", [0, 2])
def test_without_power_over_B_the_filter_only_steers(quarter):
    """E5: ψ a multiple of π/2 and the obstacle, closing in, exactly abeam; ‖L_gB‖ vanishes."""
    out = barrier(Pose(0.0, 0.0, quarter * math.pi / 2), Twist(0.0, 0.0), ABEAM, PAPER)
    assert out.verdict == POWERLESS
    assert out.input.v == 0.0
    assert out.input.omega == pytest.approx(-PAPER.k_cbf * math.tanh(1 / out.h))
    assert out.limiting == 0


@given(
    st.sampled_from([0.0, 1.0, -1.0, 2.0]), st.floats(-1e-7, 1e-7), st.sampled_from([1.0, -1.0]),
    st.floats(0.201, 0.5), st.floats(0.0, 2.0), states.twists,
)  # fmt: skip
def test_near_the_pole_of_the_law_the_command_stays_finite(
    quarter, off, side, away, speed, nominal
):
    """E5, also an ulp or a µrad beside it."""
    psi = quarter * math.pi / 2 + off
    left = np.array([-math.sin(psi), math.cos(psi)]) * side
    scene = discs(disc(*(away * left), 0.1, vx=-speed * left[0], vy=-speed * left[1]))
    out = barrier(Pose(0.0, 0.0, psi), nominal, scene, PAPER)
    assert math.isfinite(out.input.v)
    assert math.isfinite(out.input.omega)


@pytest.mark.parametrize("away", [0.2, 0.2 + 1e-17, math.nextafter(0.2, 1.0), 0.1, 0.0])
def test_on_and_inside_the_safe_circle_the_command_stays_finite(away):
    out = barrier(Pose(0.0, 0.0, 0.3), Twist(0.5, 0.0), discs(disc(away, 0.0, 0.1)), PAPER)
    assert all(map(math.isfinite, (*out.input, out.I, out.J, out.h)))


def test_steering_turns_right_of_an_obstacle_dead_ahead():
    """E1: with yaw positive to the left, as the paper's signs ask."""
    out = barrier(Pose(0.0, 0.0, 0.3), Twist(0.5, 0.0), discs(disc(0.4, 0.1, 0.1)), PAPER)
    assert out.verdict == SHAPED
    assert out.input.omega < 0.0
    assert out.input.v < 0.0


def test_a_fast_turn_in_free_space_sets_the_filter_off():
    """E6: for no obstacle at all; the heading term is the limiting, and no steering is added."""
    out = barrier(Pose(0.0, 0.0, -math.pi / 4), Twist(0.5, 2.0), discs(), PAPER)
    assert (out.verdict, out.limiting) == (SHAPED, HEADING)
    assert out.h == math.inf
    assert out.I == pytest.approx(2.0)
    assert out.J == pytest.approx(0.5 * 0.5 + 0.5)
    assert out.input == pytest.approx(Twist(0.0, -(2.0 - 0.75)))


def test_the_same_scene_turned_about_the_origin_is_answered_differently():
    """E6: cos²ψ makes B depend on which way north is. A fact of the paper's law, and kept."""
    pose, nominal, ahead = Pose(0.0, 0.0, 0.0), Twist(0.5, 0.6), np.array([0.8, 0.1])
    out = {}
    for angle in np.radians([0, 30, 60, 90, 120, 150]):
        c, s = math.cos(angle), math.sin(angle)
        around = discs(disc(*(np.array([[c, -s], [s, c]]) @ ahead), 0.1))
        out[round(math.degrees(angle))] = barrier(turned(pose, angle), nominal, around, PAPER)
    assert {o.verdict for o in out.values()} == {UNTOUCHED, SHAPED}
    acting = [o.input for o in out.values() if o.verdict == SHAPED]
    assert np.ptp([u.v for u in acting]) > 0.05
    assert np.ptp([o.h for o in out.values()]) < 1e-12  # nothing else about the scene changed


@given(states.poses, st.data())
def test_the_filters_answer_comes_back_after_half_a_turn_of_the_whole_scene(pose, data):
    """cos² has the period π, so E6 goes no further than that."""
    scene, nominal = data.draw(states.scenes(pose, nearest=0.05)), data.draw(states.twists)
    around = scene.copy()
    around[:, :4] *= -1
    out, back = (
        barrier(pose, nominal, scene, PAPER),
        barrier(turned(pose, math.pi), nominal, around, PAPER),
    )
    assume(abs(out.I - out.J) > 1e-6 * (1 + abs(out.I)))
    slope = paper.L_gB(np.array(pose), states.as_rows(scene))
    assume(slope @ slope > 1e-6)
    assert back.verdict == out.verdict
    assert back.input == pytest.approx(out.input, rel=1e-5, abs=1e-6 * (1 + abs(out.I)))


@given(states.poses, states.twists, st.data())
def test_the_limiting_obstacle_has_the_largest_part(pose, nominal, data):
    scene = data.draw(states.scenes(pose, least=2))
    out = barrier(pose, nominal, scene, PAPER)
    if out.verdict == UNTOUCHED:
        return
    rows, p = states.as_rows(scene), states.as_parameters(PAPER)
    parts = []
    for row in rows:
        alone = row[None]
        I, _ = paper.I_and_J(np.array(pose), np.array([nominal.v, 0.0]), alone, p)
        parts.append(I)
    heading = -math.sin(2 * pose.psi) * nominal.omega
    named = heading if out.limiting == HEADING else parts[out.limiting]
    most = max([heading, *parts])
    assert named == pytest.approx(most, rel=1e-9, abs=1e-9 * (1 + abs(most)))


def test_the_limiting_obstacle_is_found_wherever_it_is_in_the_list():
    near, far = disc(0.4, 0.0, 0.1), disc(3.0, 3.0, 0.1)
    for k in range(4):
        rows = [far] * 4
        rows[k] = near
        assert barrier(Pose(0.0, 0.0, 0.1), Twist(0.5, 0.0), discs(*rows), PAPER).limiting == k


@pytest.mark.parametrize(("omega", "verdict"), [(0.7499, UNTOUCHED), (0.7501, SHAPED)])
def test_the_filter_acts_from_I_equal_J_on(omega, verdict):
    """In free space at ψ = −π/4, I = ω and J = 0.5 · 0.5 + 0.5."""
    nominal = Twist(0.0, omega)
    assert barrier(Pose(0.0, 0.0, -math.pi / 4), nominal, discs(), PAPER).verdict == verdict


def test_the_heading_is_to_blame_though_an_obstacle_draws_near_when_it_asks_more():
    """E6: the turn asks 2 of the filter, the obstacle 2 m ahead far less, but something."""
    ahead = discs(disc(2.0 * math.sqrt(0.5), -2.0 * math.sqrt(0.5), 0.1))
    turning, going = Twist(0.5, 2.0), Twist(0.5, 0.0)
    assert growth(Pose(0.0, 0.0, -math.pi / 4), going, ahead) > 0.0
    out = barrier(Pose(0.0, 0.0, -math.pi / 4), turning, ahead, PAPER)
    assert (out.verdict, out.limiting) == (SHAPED, HEADING)
