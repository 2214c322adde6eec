"""The sweep, held against a robot that is moved in small steps, and against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Twist
from cohelm.robot.collision_monitor.sweep import (
    STRAIGHT,
    contact_time,
    edge_distances,
    fastest,
    outline,
    outwards as outwards_of,
    ring_of,
)

BOX = np.array([[0.36, 0.29], [-0.36, 0.29], [-0.36, -0.29], [0.36, -0.29]])
WEDGE = np.array([[0.5, 0.0], [-0.3, 0.25], [-0.4, -0.1], [0.1, -0.3]])
NOSE = np.array([[1.2, 0.1], [0.1, 0.2], [0.1, -0.1], [1.0, -0.3]])
"""All of it ahead of the axle."""
CORNERS = {"box": BOX, "wedge": WEDGE, "nose": NOSE}
SHAPES = {name: outline(corners) for name, corners in CORNERS.items()}
AHEAD = np.array([[1.0, 0.0]])
NO = np.zeros(1)


def contact_times(points, margins, twist, shape):
    ring = ring_of(twist, shape)
    each = zip(points, margins, strict=True)
    return np.array([contact_time(x, y, margin, twist, shape, ring) for (x, y), margin in each])


def outwards(points, twist, shape):
    return np.array([outwards_of(x, y, twist, shape) for x, y in points])


def stepped(point, margin, twist, shape, until, steps=4000):
    """When the point is first inside, by moving it in small steps; infinite until then."""
    times = np.linspace(0.0, until, steps + 1)
    angle = twist.omega * times
    if abs(twist.omega) < 1e-9:
        x, y = twist.v * times, np.zeros_like(times)
    else:
        x = twist.v / twist.omega * np.sin(angle)
        y = twist.v / twist.omega * (1.0 - np.cos(angle))
    dx, dy = point[0] - x, point[1] - y
    here = np.column_stack(
        (np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx)
    )
    inside = (edge_distances(here, shape) - margin).max(axis=1) <= 0.0
    return times[inside.argmax()] if inside.any() else math.inf


@given(
    st.sampled_from(sorted(SHAPES)), st.floats(0.0, 2.0), st.floats(-math.pi, math.pi),
    st.floats(-1.5, 1.5), st.floats(-2.0, 2.0), st.floats(0.0, 0.05),
)  # fmt: skip
def test_contact_is_when_small_steps_find_it(name, far, bearing, v, omega, margin):
    shape, twist = SHAPES[name], Twist(v, omega)
    if fastest(twist, shape) < 0.05:
        return
    point = np.array([[far * math.cos(bearing), far * math.sin(bearing)]])
    until = 2.0
    found = contact_times(point, np.array([margin]), twist, shape)[0]
    step = until / 4000
    # a graze shorter than a step is seen by the one and not by the other: grown a little by both
    more = stepped(point[0], margin + 2.0 * step * fastest(twist, shape), twist, shape, until)
    less = stepped(point[0], margin - 2.0 * step * fastest(twist, shape), twist, shape, until)
    assert found >= min(more, until) - 2.0 * step
    if less < math.inf:
        assert found <= less + 1e-9


def test_straight_ahead_it_is_the_distance_by_the_speed():
    box = SHAPES["box"]
    assert contact_times(AHEAD, NO, Twist(0.5, 0.0), box) == pytest.approx([1.28])
    assert contact_times(AHEAD, np.array([0.04]), Twist(0.5, 0.0), box) == pytest.approx([1.2])
    assert contact_times(-AHEAD, NO, Twist(-0.5, 0.0), box) == pytest.approx([1.28])
    assert contact_times(AHEAD, NO, Twist(-0.5, 0.0), box)[0] == math.inf


def test_obstacles_beside_the_swept_path_are_passed_and_others_are_hit():
    box, ahead = SHAPES["box"], Twist(1.0, 0.0)
    assert contact_times(np.array([[1.0, 0.2901]]), NO, ahead, box)[0] == math.inf
    assert contact_times(np.array([[1.0, 0.29]]), NO, ahead, box)[0] == pytest.approx(0.64)
    assert contact_times(np.array([[1.0, -0.2901]]), NO, ahead, box)[0] == math.inf
    assert contact_times(np.array([[1.0, 0.2901]]), np.array([0.001]), ahead, box)[0] < 1.0


def test_turning_on_the_spot_meets_what_a_corner_sweeps():
    box, reach = SHAPES["box"], math.hypot(0.36, 0.29)
    corner = math.atan2(0.29, 0.36)
    for turn in (1.0, -1.0):
        for off in (0.1, 0.3):
            at = corner + turn * off
            point = 0.999 * reach * np.array([[math.cos(at), math.sin(at)]])
            if edge_distances(point, box).max() > 0.0:
                found = contact_times(point, NO, Twist(0.0, turn), box)[0]
                assert found == pytest.approx(off, abs=0.05)
    beyond = 1.001 * reach * np.array([[math.cos(corner + 0.1), math.sin(corner + 0.1)]])
    assert contact_times(beyond, NO, Twist(0.0, 1.0), box)[0] == math.inf


def test_a_whole_turn_comes_round_to_what_is_just_behind_the_edge():
    box = SHAPES["box"]
    point = np.array([[0.3, -0.31]])  # left behind by a turn to the left, met again from behind
    found = contact_times(point, NO, Twist(0.0, 1.0), box)[0]
    assert 0.0 < found < 2.0 * math.pi
    assert found == pytest.approx(stepped(point[0], 0.0, Twist(0.0, 1.0), box, 7.0), abs=0.01)


def test_a_wide_turn_is_as_good_as_straight():
    box = SHAPES["box"]
    points = np.array([[1.0, 0.1], [0.8, -0.28], [2.0, 0.35], [-1.0, 0.0]])
    for v in (1.0, -1.0):
        straight = contact_times(points, np.zeros(4), Twist(v, 0.0), box)
        for omega in (1.01, 0.99):
            wide = contact_times(points, np.zeros(4), Twist(v, omega / STRAIGHT), box)
            met = np.isfinite(straight)
            assert ((wide < 10.0) == met).all()
            assert wide[met] == pytest.approx(straight[met], abs=2e-3)


def test_inside_is_now_and_standing_still_is_never():
    box = SHAPES["box"]
    points = np.array([[0.0, 0.0], [0.5, 0.0]])
    assert contact_times(points, np.zeros(2), Twist(0.0, 0.0), box).tolist() == [0.0, math.inf]
    assert contact_times(points, np.full(2, 0.15), Twist(-1.0, 0.0), box).tolist() == [0.0, 0.0]


def test_a_point_may_only_move_outwards_of_the_outline():
    box = SHAPES["box"]
    points = np.array([[0.35, 0.0], [-0.35, 0.0], [0.34, 0.28], [0.34, -0.28], [0.0, 0.28]])

    def out(v, omega):
        return (outwards(points, Twist(v, omega), box) > 0.0).tolist()

    assert out(-0.5, 0.0) == [True, False, True, True, False]
    assert out(0.5, 0.0) == [False, True, False, False, False]
    assert out(0.0, 1.0)[2:4] == [True, True]  # both leave: one through the front, one the side
    assert out(-0.5, 0.3)[3]
    assert out(-0.5, -0.3)[2]  # out through the front, turned or not


def test_motion_along_the_outline_moves_a_point_neither_out_nor_in():
    box = SHAPES["box"]
    points = np.array([[0.1, 0.28], [-0.2, -0.30]])
    assert outwards(points, Twist(0.7, 0.0), box) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert outwards(points, Twist(0.0, -1.0), box)[0] > 0.0  # its left front goes to the right
    assert outwards(np.array([[-0.3, 0.28]]), Twist(0.7, -0.5), box)[0] < 0.0  # its tail swings


def test_no_point_of_the_outline_is_faster():
    box = SHAPES["box"]
    assert fastest(Twist(-0.5, 1.0), box) == pytest.approx(0.5 + math.hypot(0.36, 0.29))
    assert box.reach == pytest.approx(math.hypot(0.36, 0.29))


def grown(corners, margin):
    """Corners of an outline all of whose edges went out by a margin: where the lines meet."""
    tangents = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack((tangents[:, 1], -tangents[:, 0]))
    normals /= np.hypot(*normals.T)[:, None]
    lines = (normals * corners).sum(axis=1) + margin
    return np.array([np.linalg.solve(normals[[i - 1, i]], lines[[i - 1, i]]) for i in range(4)])


@pytest.mark.parametrize("name", sorted(SHAPES))
@pytest.mark.parametrize("margin", [0.03, 0.2])
def test_each_edge_ends_where_it_meets_the_next_also_when_all_have_gone_out(name, margin):
    corners, shape = CORNERS[name], SHAPES[name]
    out = grown(corners, margin)
    along = np.column_stack((-shape.normals[:, 1], shape.normals[:, 0]))
    first = shape.first + margin * shape.first_grows
    last = shape.last + margin * shape.last_grows
    assert first == pytest.approx((along * out).sum(axis=1))
    assert last == pytest.approx((along * np.roll(out, -1, axis=0)).sum(axis=1))
    assert shape.spread == pytest.approx(np.hypot(*(out - corners).T).max() / margin)
    assert shape.reach == pytest.approx(np.hypot(*corners.T).max())


@pytest.mark.parametrize("name", sorted(SHAPES))
@pytest.mark.parametrize("centre", [0.0, 0.4, -0.4, 1.5, -1.5])
@pytest.mark.parametrize("omega", [1.0, -1.0])
def test_what_runs_against_a_grown_corner_is_met_there(name, centre, omega):
    """Just beside each grown corner, on either edge, taken back along the arc."""
    shape, margin, back, met = SHAPES[name], 0.05, 0.35, 0
    twist = Twist(centre * omega, omega)
    corners = grown(CORNERS[name], margin)
    for i in range(4):
        for edge, other in ((i, (i + 1) % 4), (i - 1, i - 1)):
            way = corners[other] - corners[i]
            x, y = corners[i] + 0.01 * way / np.hypot(*way)
            inwards = np.array((omega * y - twist.v, -omega * x)) @ shape.normals[edge]
            if inwards > -0.1:
                continue
            c, s = math.cos(omega * back), math.sin(omega * back)
            start = (c * x - s * (y - centre), centre + s * x + c * (y - centre))
            found = contact_times(np.array([start]), np.array([margin]), twist, shape)[0]
            assert found <= back + 1e-9
            assert found == pytest.approx(stepped(start, margin, twist, shape, 0.4), abs=3e-4)
            met += found > 0.9 * back
    assert met > 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_the_inner_side_of_a_turn_sweeps_only_by_its_margin_is_met(side):
    twist = Twist(1.0, side)
    angle = np.linspace(0.6, 1.2, 5)
    points = np.column_stack((0.69 * np.sin(angle), side * (1.0 - 0.69 * np.cos(angle))))
    for point in points:
        found = contact_times(point[None], np.array([0.05]), twist, SHAPES["box"])[0]
        assert found == pytest.approx(stepped(point, 0.05, twist, SHAPES["box"], 1.2), abs=1e-3)
        assert contact_times(point[None], NO, twist, SHAPES["box"])[0] == math.inf


@pytest.mark.parametrize("name", sorted(SHAPES))
@pytest.mark.parametrize("v", [0.5, -0.5])
def test_straight_on_it_meets_what_steps_find_and_passes_the_rest(name, v):
    shape, twist = SHAPES[name], Twist(v, 0.0)
    axis = np.linspace(-1.6, 1.6, 14)
    points = np.array([(x, y) for x in axis for y in 0.23 * axis])
    found = contact_times(points, np.full(len(points), 0.02), twist, shape)
    expected = [stepped(point, 0.02, twist, shape, 8.0, 2000) for point in points]
    assert found == pytest.approx(np.array(expected), abs=8.0 / 2000)
    assert np.isfinite(found).any()
    assert np.isinf(found).any()


def test_a_point_on_the_line_is_in_it():
    points = np.array([[0.36, 0.1], [0.36, 0.0], [-0.2, 0.29]])
    for twist in (Twist(0.5, 0.0), Twist(-0.5, 0.0), Twist(0.3, 1.0), Twist(-0.3, -1.0)):
        assert contact_times(points, np.zeros(3), twist, SHAPES["box"]).tolist() == [0.0] * 3
