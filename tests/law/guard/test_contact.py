import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, strategies as st

from cohelm.law.guard.contact import contact, overlap, point_clearance, wall_clearance
from tests.law.guard.scenes import SALLY, lengths, outlines

near = st.floats(-1.2, 1.2, allow_subnormal=False)  # shapely has no length for those


@given(outlines(), near, near)
def test_the_clearance_is_the_distance_outside_and_minus_the_depth_inside(outline, x, y):
    body, point = shapely.Polygon(outline), shapely.Point(x, y)
    expected = body.distance(point) or -body.exterior.distance(point)
    assert contact(outline, x, y).clearance == pytest.approx(expected, abs=1e-9)
    assert point_clearance(outline, x, y) == pytest.approx(expected, abs=1e-9)


@given(outlines(), near, near)
def test_the_contact_is_a_point_of_the_outline_in_the_direction_of_the_obstacle(outline, x, y):
    c = contact(outline, x, y)
    assert math.hypot(c.nx, c.ny) == pytest.approx(1.0)
    if c.clearance <= 1e-6:
        return
    assert shapely.Polygon(outline).distance(shapely.Point(c.qx, c.qy)) < 1e-9
    assert (x + c.clearance * c.nx, y + c.clearance * c.ny) == pytest.approx((c.qx, c.qy), abs=1e-9)


@given(outlines(), near, near, st.floats(1e-5, 1e-4))
def test_moving_along_the_normal_increases_the_clearance(outline, x, y, step):
    """The robot moves by +n, which is the thing moving by -n; inside, out of the nearest edge."""
    c = contact(outline, x, y)
    after = contact(outline, x - step * c.nx, y - step * c.ny)
    assert after.clearance == pytest.approx(c.clearance + step, abs=1e-9)


@given(outlines(), near, near, near, near)
def test_the_clearance_to_a_wall_is_the_distance_and_negative_exactly_where_they_cross(
    outline, ax, ay, bx, by
):
    assume(math.hypot(bx - ax, by - ay) > 1e-3)
    body, wall = shapely.Polygon(outline), shapely.LineString([(ax, ay), (bx, by)])
    got = wall_clearance(outline, ax, ay, bx, by)
    apart = body.distance(wall)
    if apart > 0.0:
        assert got == pytest.approx(apart, abs=1e-9)
    else:
        assert got <= 1e-9
        if got < -1e-9:
            assert body.intersection(wall).length > 0.0


@given(outlines(), near, near, near, near)
def test_a_wall_in_the_outline_is_left_by_the_shortest_way(outline, ax, ay, bx, by):
    out = overlap(outline, ax, ay, bx, by)
    if out.clearance > -1e-6:
        return
    body = shapely.Polygon(outline)

    def crossing(dx, dy):
        wall = shapely.LineString([(ax + dx, ay + dy), (bx + dx, by + dy)])
        return body.buffer(-1e-9).intersects(wall)

    depth = -out.clearance
    assert not crossing(-out.nx * (depth + 1e-8), -out.ny * (depth + 1e-8))
    for turn in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False):
        assert crossing(0.99 * depth * math.cos(turn), 0.99 * depth * math.sin(turn))


@given(outlines(), near, near, st.integers(0, 7))
def test_a_repeated_corner_changes_nothing(outline, x, y, i):
    twice = np.insert(outline, i % len(outline), outline[i % len(outline)], axis=0)
    assert contact(twice, x, y) == pytest.approx(contact(outline, x, y), abs=1e-12)
    assert point_clearance(twice, x, y) == pytest.approx(point_clearance(outline, x, y), abs=1e-12)
    assert wall_clearance(twice, x, y, 1.0, 0.3) == pytest.approx(
        wall_clearance(outline, x, y, 1.0, 0.3)
    )


@pytest.mark.parametrize("corners", [1, 3])
@given(lengths, lengths, lengths, lengths)
def test_a_robot_of_no_size_is_a_point(corners, ax, ay, bx, by):
    assume(math.hypot(ax, ay) > 1e-6)
    dot = np.tile([[0.1, -0.2]], (corners, 1))
    assert point_clearance(dot, ax, ay) == pytest.approx(math.hypot(ax - 0.1, ay + 0.2), abs=1e-11)
    wall = shapely.LineString([(ax, ay), (bx, by)])
    assert abs(wall_clearance(dot, ax, ay, bx, by)) == pytest.approx(
        wall.distance(shapely.Point(0.1, -0.2)), abs=1e-9
    )


def test_on_the_outline_the_way_out_is_through_the_edge():
    c = contact(SALLY, 0.36, 0.1)
    assert (c.clearance, c.nx, c.ny) == (0.0, -1.0, 0.0)


def test_a_point_robot_that_is_touched_gets_some_direction_out():
    """Which one is nothing: but a direction, of length 1."""
    dot = np.array([[0.1, -0.2]])
    for c in (contact(dot, 0.1, -0.2), overlap(dot, 0.1, -0.2, 0.1, -0.2)):
        assert (c.clearance, math.hypot(c.nx, c.ny)) == (0.0, 1.0)
