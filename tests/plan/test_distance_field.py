import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from shapely import MultiPoint, Point, Polygon
from shapely.affinity import rotate, translate

from cohelm.plan.distance_field import clearance, distance_field, inscribed_radius, swept_clearances
from tests.perceive.scenes import JACKAL, LONG, NOTHING

points = arrays(np.float64, st.tuples(st.integers(1, 30), st.just(2)), elements=st.floats(-2, 2))


@given(points)
def test_a_cell_knows_its_distance_to_the_nearest_point(seen):
    made = distance_field(seen, (-2.5, -2.5), (2.5, 2.5), 0.1)
    rows, columns = made.clearance.shape
    for i in range(0, rows, 7):
        for j in range(0, columns, 7):
            at = (made.x + 0.1 * j, made.y + 0.1 * i)
            true = np.hypot(*(seen - at).T).min()
            # the nearest cell's point may be half a diagonal farther than another's
            assert true - 1e-9 <= made.clearance[i, j] <= true + 0.1 * math.sqrt(2.0)


@given(points, st.floats(-2, 2), st.floats(-2, 2))
def test_between_cells_the_clearance_is_right_within_a_cell(seen, x, y):
    made = distance_field(seen, (-2.5, -2.5), (2.5, 2.5), 0.05)
    true = np.hypot(*(seen - (x, y)).T).min()
    assert clearance(made, x, y) == pytest.approx(true, abs=0.1)


def test_without_points_nearby_all_is_clear():
    for seen in (NOTHING, np.array([[9.0, 9.0]])):
        made = distance_field(seen, (0.0, 0.0), (1.0, 1.0), 0.1)
        assert np.isinf(made.clearance).all()
        assert clearance(made, 0.5, 0.5) == math.inf


def test_outside_the_chart_the_border_counts():
    made = distance_field(np.array([[0.5, 0.5]]), (0.0, 0.0), (1.0, 1.0), 0.1)
    assert clearance(made, 5.0, 0.5) == pytest.approx(0.5)


@pytest.mark.parametrize("outline", [JACKAL, LONG])
@given(seen=points, x=st.floats(-1, 1), y=st.floats(-1, 1), psi=st.floats(-4, 4))
def test_the_swept_clearance_is_shapelys_distance(outline, seen, x, y, psi):
    body = translate(rotate(Polygon(outline), psi, origin=(0, 0), use_radians=True), x, y)
    gap = swept_clearances(seen, outline, np.array([[x, y, psi]]))[0]
    assert gap == pytest.approx(body.distance(MultiPoint(seen)), abs=1e-9)


poses = arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-2.0, 2.0))


@pytest.mark.parametrize("outline", [JACKAL, LONG, JACKAL + np.array([2.0, 0.0])])
@given(seen=points, swept=poses)
def test_along_a_path_each_clearance_is_that_of_its_pose_alone(outline, seen, swept):
    """Poses that follow one another share their search, also where the axle is off the outline."""
    alone = [swept_clearances(seen, outline, pose[None])[0] for pose in swept]
    assert swept_clearances(seen, outline, swept).tolist() == alone


def test_nothing_seen_is_an_infinite_clearance():
    assert swept_clearances(NOTHING, JACKAL, np.zeros((3, 3))).tolist() == [math.inf] * 3


def test_the_inscribed_circle_touches_the_nearest_side():
    assert inscribed_radius(JACKAL) == pytest.approx(0.165)
    ahead = JACKAL + np.array([0.1, 0.0])
    assert inscribed_radius(ahead) == pytest.approx(Polygon(ahead).exterior.distance(Point(0, 0)))
