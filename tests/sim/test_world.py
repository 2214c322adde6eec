import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Pose, disc
from cohelm.law.reference import evaluate, through
from cohelm.robot.clearance import disc_clearance, segment_clearance
from cohelm.sim.world import Body, ever_moving, outline_clearance, place, world
from tests.oracle import lab, paper
from tests.sim.runs import MOVER, NO_WALLS, lab_world

TWIN = paper.Spline(lab.MOVER, lab.MOVER_SPEED)


def placed(around, t):
    discs = np.full((len(around.discs), 6), np.nan)
    place(discs, around, t)
    return discs


@given(st.floats(0.0, 1.0, exclude_max=True))
def test_an_obstacle_with_a_path_follows_it_from_its_start_on(share):
    t = share * MOVER.duration
    spot, velocity, _ = TWIN(t)
    mover = placed(lab_world(), lab.MOVER_START + t)[3]
    assert mover[:2] == pytest.approx(spot, abs=1e-9)
    assert mover[2:4] == pytest.approx(velocity, abs=1e-9)
    assert mover[4:].tolist() == [lab.CONE_RADIUS, lab.SAFE]
    told = evaluate(MOVER.knots, MOVER.coeffs, t)
    assert mover[:4] == pytest.approx(told[:4], abs=1e-9)


@pytest.mark.parametrize("t", [0.0, 1.0, 14.0, math.nextafter(lab.MOVER_START, 0.0)])
def test_before_its_start_it_rests_where_its_path_begins(t):
    assert placed(lab_world(), t)[3, :4] == pytest.approx([*lab.MOVER[0], 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("after", [0.0, 1e-9, 1.0, 1e6])
def test_after_its_path_it_rests_where_the_path_ends(after):
    end = placed(lab_world(), lab.MOVER_START + MOVER.duration + after)[3]
    assert end[:4] == pytest.approx([*lab.MOVER[-1], 0.0, 0.0], abs=1e-9)


@given(st.floats(0.0, 100.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_an_obstacle_with_a_velocity_drifts(t, vx, vy):
    drifting = world(([Body(disc(1.0, 2.0, 0.1, vx=vx, vy=vy))], NO_WALLS))
    told = [1.0 + vx * t, 2.0 + vy * t, vx, vy, 0.1, 0.2]
    assert placed(drifting, t)[0] == pytest.approx(told, abs=1e-12)


@pytest.mark.parametrize("t", [0.0, 3.0, 50.0])
def test_each_obstacle_of_many_goes_its_own_way(t):
    """However their paths and drifts are laid out in the flat arrays."""
    other = through([(0, 0), (1, 1), (2, 0)], 0.3)
    bodies = [
        Body(disc(5.0, 5.0, 0.1)), Body(disc(0.0, 0.0, 0.2), other, 1.0),
        Body(disc(1.0, 0.0, 0.1, vx=0.5)), Body(disc(9.0, -1.5, 0.1), MOVER, 15.0),
        Body(disc(0.0, 0.0, 0.3), other),
    ]  # fmt: skip
    together = world((bodies, NO_WALLS))
    for row, body in zip(placed(together, t), bodies, strict=True):
        assert (row == placed(world(([body], NO_WALLS)), t)[0]).all()
    assert ever_moving(together).tolist() == [False, True, True, True, True]


@given(
    st.builds(Pose, st.floats(-3, 3), st.floats(-3, 3), st.floats(-4, 4)),
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(0.05, 1.0)), max_size=6),
    st.lists(st.tuples(*[st.floats(-4, 4)] * 4), max_size=4),
)
def test_skipping_what_is_far_never_changes_the_clearance(pose, round_things, walls):
    scene = np.array([disc(*d) for d in round_things]).reshape(-1, 6)
    reach = float(np.hypot(*lab.SALLY.T).max())
    told = [disc_clearance(pose, lab.SALLY, *d) for d in round_things]
    told += [segment_clearance(pose, lab.SALLY, *w) for w in walls]
    got = outline_clearance(pose, lab.SALLY, reach, scene, np.array(walls).reshape(-1, 4), math.inf)
    assert got == pytest.approx(min(told, default=math.inf), abs=1e-12)


def test_the_least_clearance_so_far_is_kept():
    nothing = np.empty((0, 6))
    assert outline_clearance(Pose(0.0, 0.0, 0.0), lab.SALLY, 0.5, nothing, NO_WALLS, 0.07) == 0.07
