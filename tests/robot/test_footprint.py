"""Clearance against an independent geometry library (shapely, GEOS)."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, strategies as st
from shapely.affinity import rotate, translate

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.robot.clearance import disc_clearance, point_gap, segment_clearance
from cohelm.robot.footprint import convex_outline

poses = st.builds(Pose, st.floats(-5, 5), st.floats(-5, 5), st.floats(-20, 20))
places = st.floats(-2, 2)
SALLY = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
HERE = Pose(0.0, 0.0, 0.0)
CLOSE = 1e-9


@st.composite
def outlines(draw):
    """Convex outlines, counter-clockwise: corners at rising angles on an ellipse off the origin."""
    k = draw(st.integers(3, 9))
    gaps = np.array([draw(st.floats(0.2, 1.0)) for _ in range(k)])
    angles = 2 * math.pi * (np.cumsum(gaps) / gaps.sum() + draw(st.floats(0, 1)))
    a, b = draw(st.floats(0.1, 1.0)), draw(st.floats(0.1, 1.0))
    centre = [draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3))]
    return np.column_stack([a * np.cos(angles), b * np.sin(angles)]) + centre


def polygon(outline, pose=HERE):
    shape = rotate(shapely.Polygon(outline), pose.psi, origin=(0, 0), use_radians=True)
    return translate(shape, pose.x, pose.y)


def signed(shape, point):
    """Distance to a polygon, minus the depth inside."""
    point = shapely.Point(point)
    outside = shape.distance(point)
    return outside if outside > 0 else -shape.exterior.distance(point)


@given(outlines(), places, places)
def test_the_gap_to_a_point_is_its_distance_and_its_depth_inside(outline, x, y):
    assert point_gap(outline, x, y) == pytest.approx(signed(polygon(outline), (x, y)), abs=CLOSE)


@given(outlines(), st.data())
def test_every_point_of_the_outline_is_in_touch(outline, data):
    i = data.draw(st.integers(0, len(outline) - 1))
    share = data.draw(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1)))
    x, y = (1 - share) * outline[i] + share * outline[(i + 1) % len(outline)]
    assert point_gap(outline, x, y) == pytest.approx(0.0, abs=1e-12)


@given(poses, outlines(), places, places, st.floats(0.0, 2.0))
def test_the_clearance_of_a_disc_is_the_gap_between_the_shapes(pose, outline, x, y, radius):
    told = signed(polygon(outline, pose), (pose.x + x, pose.y + y)) - radius
    got = disc_clearance(pose, outline, pose.x + x, pose.y + y, radius)
    assert got == pytest.approx(told, abs=CLOSE)


@given(poses, outlines(), places, places, st.floats(0.05, 2.0))
def test_a_disc_is_clear_of_the_outline_exactly_when_they_do_not_overlap(pose, outline, x, y, r):
    got = disc_clearance(pose, outline, pose.x + x, pose.y + y, r)
    assume(abs(got) > 1e-3)
    round_ = shapely.Point(pose.x + x, pose.y + y).buffer(r, quad_segs=512)
    assert (got < 0) == polygon(outline, pose).intersects(round_)


segments = st.tuples(places, places, places, places)


@given(poses, outlines(), segments)
def test_the_clearance_of_a_wall_is_the_gap_and_negative_when_it_cuts_the_outline(
    pose, outline, segment
):
    x1, y1, x2, y2 = segment
    ends = [(pose.x + x1, pose.y + y1), (pose.x + x2, pose.y + y2)]
    shape, wall = polygon(outline, pose), shapely.LineString(ends)
    assume(wall.length > 1e-6)  # shapely cuts no point out of a polygon; see the next test
    got = segment_clearance(pose, outline, *ends[0], *ends[1])
    apart = shape.distance(wall)
    if apart > 1e-12:
        assert got == pytest.approx(apart, abs=CLOSE)
        return
    # The deepest point of the cut, sampled; the depth is concave along it, so ends and middle
    # find at least half of it.
    cut = shape.intersection(wall)
    at = [cut.interpolate(s, normalized=True) for s in np.linspace(0, 1, 201) if cut.length]
    deepest = max((shape.exterior.distance(point) for point in at), default=0.0)
    assert got <= 1e-12
    assert -deepest * (1 + 1e-3) - CLOSE <= got <= -deepest / 2 + CLOSE


@given(outlines(), places, places)
def test_a_wall_of_no_length_is_a_point(outline, x, y):
    got = segment_clearance(HERE, outline, x, y, x, y)
    assert got == pytest.approx(point_gap(outline, x, y), abs=1e-12)


@given(poses, outlines(), segments)
def test_a_walls_clearance_does_not_depend_on_its_direction(pose, outline, segment):
    x1, y1, x2, y2 = segment
    there = segment_clearance(pose, outline, x1, y1, x2, y2)
    assert segment_clearance(pose, outline, x2, y2, x1, y1) == pytest.approx(there, abs=CLOSE)


@given(outlines(), st.data())
def test_a_wall_along_an_edge_is_in_touch(outline, data):
    i = data.draw(st.integers(0, len(outline) - 1))
    a, b = outline[i], outline[(i + 1) % len(outline)]
    shift = data.draw(st.floats(-0.5, 0.5)) * (b - a)
    got = segment_clearance(HERE, outline, *(a + shift), *(b + shift))
    assert got == pytest.approx(0.0, abs=1e-12)


@given(poses, outlines(), st.data())
def test_a_wall_wholly_inside_is_not_clear(pose, outline, data):
    corners = np.array(polygon(outline, pose).exterior.coords)[:-1]
    middle = corners.mean(axis=0)
    ends = []
    for _ in range(2):
        i = data.draw(st.integers(0, len(corners) - 1))
        ends.extend(middle + data.draw(st.floats(0.0, 0.9)) * (corners[i] - middle))
    assert segment_clearance(pose, outline, *ends) < 0.0


@pytest.mark.parametrize(
    ("wall", "gap"),
    [
        ((1.0, -5.0, 1.0, 5.0), 0.64),  # across the road ahead
        ((-5.0, 1.0, 5.0, 1.0), 0.71),  # along the left side
        ((1.36, 0.0, 0.36, 1.0), 0.71 / 2**0.5),  # nearest to a corner, half way along the wall
        ((0.66, 0.69, 5.0, 5.0), 0.5),  # nearest from its end to a corner: 3, 4, 5
        ((0.36, -5.0, 0.36, 5.0), 0.0),  # flush with the front
        ((0.36, 0.29, 1.0, 1.0), 0.0),  # touching a corner
        ((-5.0, 0.0, 5.0, 0.0), -0.29),  # through the middle
        ((0.0, 0.0, 0.0, 0.0), -0.29),  # a point inside
        ((0.36, 0.0, 5.0, 0.0), 0.0),  # ends on the front
    ],
)
def test_clearances_one_can_check_by_hand(wall, gap):
    assert segment_clearance(HERE, SALLY, *wall) == pytest.approx(gap, abs=1e-12)


@given(outlines(), st.data())
def test_an_outline_in_any_order_round_with_corners_too_many_is_the_same_outline(outline, data):
    given = np.roll(outline, data.draw(st.integers(0, 9)), axis=0)
    for _ in range(data.draw(st.integers(0, 3))):
        i = data.draw(st.integers(0, len(given) - 1))
        share = data.draw(st.sampled_from([0.0, 0.5]))  # the corner again, or amid an edge
        between = (1.0 - share) * given[i] + share * given[(i + 1) % len(given)]
        given = np.insert(given, i + 1, between, axis=0)
    if data.draw(st.booleans()):
        given = given[::-1]
    made = convex_outline(given)
    assert shapely.Polygon(made).exterior.is_ccw
    assert shapely.Polygon(made).symmetric_difference(polygon(outline)).area < 1e-12
    assert np.array_equal(convex_outline(made), made)


@given(st.lists(st.tuples(places, places), min_size=0, max_size=8))
def test_what_passes_for_an_outline_is_its_own_convex_hull_and_ccw(corners):
    try:
        made = convex_outline(corners)
    except CohelmError:
        return
    assert (corner_turns(made) > 0.0).all()
    hull = shapely.MultiPoint(corners).convex_hull
    assert shapely.Polygon(made).symmetric_difference(hull).area < 1e-9


def corner_turns(corners):
    into = corners - np.roll(corners, 1, axis=0)
    out = np.roll(into, -1, axis=0)
    return into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
