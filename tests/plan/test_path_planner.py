import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from shapely import LineString, MultiPoint, Polygon
from shapely.affinity import rotate, translate

from cohelm.core.types import Pose
from cohelm.law.reference import evaluate, through
from cohelm.plan.elastic_band import distances, spread, tangents
from cohelm.plan.path_planner import PathParams, plan_path
from tests.perceive.scenes import JACKAL, LONG, NOTHING, circle, line, room, wall

PATH_PARAMS = PathParams()
AT = Pose(0.0, 0.0, 0.0)
LINE = line(0, 0, 8, 0)


def least_clearance(points, outline, poses):
    """By shapely, of the outline at poses along a way."""
    seen = MultiPoint(points)
    clearances = []
    for x, y, psi in poses:
        body = rotate(Polygon(outline), psi, origin=(0, 0), use_radians=True)
        clearances.append(translate(body, x, y).distance(seen))
    return min(clearances)


def test_where_nothing_is_in_the_way_it_is_straight():
    found = plan_path(AT, NOTHING, LINE, JACKAL)
    assert found.rejoined == len(LINE) - 1
    assert found.clearance == math.inf
    assert np.abs(found.points[:, 1]).max() < 1e-6
    assert found.points[0].tolist() == [0, 0]
    assert found.points[-1].tolist() == [8, 0]


def test_it_goes_around_what_blocks_the_line():
    points = circle(4.0, 0.0, 0.6)
    assert least_clearance(points, JACKAL, tangents(LINE)) < PATH_PARAMS.clearance
    found = plan_path(AT, points, LINE, JACKAL)
    assert np.abs(found.points[:, 1]).max() > 0.7
    assert distances(found.points)[-1] < 8.8
    assert least_clearance(points, JACKAL, tangents(found.points)[1:]) >= PATH_PARAMS.clearance
    assert found.points[-1].tolist() == [8, 0]


def test_it_stays_clear_after_it_is_made_a_spline():
    points = np.vstack((circle(3.0, 0.3, 0.4), circle(4.3, -0.5, 0.4), circle(5.5, 0.3, 0.4)))
    found = plan_path(AT, points, LINE, JACKAL)
    spline = through(found.points[::2], 1.0)
    poses = []
    for t in np.linspace(0.0, spline.duration, 300):
        m = evaluate(spline.knots, spline.coeffs, t)
        poses.append((m.x, m.y, math.atan2(m.vy, m.vx)))
    assert least_clearance(points, JACKAL, poses) >= 0.5 * PATH_PARAMS.clearance


def test_it_is_refused_where_there_is_none():
    assert plan_path(AT, room(-1, -1, 1, 1), LINE, JACKAL) is None


def test_a_goal_occupied_all_around_is_refused():
    assert plan_path(AT, room(7.4, -0.6, 8.6, 0.6), LINE, JACKAL) is None


@pytest.mark.parametrize(("width", "passes"), [(0.36, False), (0.5, True)])
def test_a_gap_is_taken_only_if_the_robot_fits_through(width, passes):
    points = np.vstack((wall(4, 0.5 * width, 4, 20), wall(4, -0.5 * width, 4, -20)))
    assert (plan_path(AT, points, LINE, JACKAL) is not None) == passes


def test_a_long_robot_goes_through_a_door_straight_also_where_its_route_turns_there():
    """The shortest way turns between the posts, and there a robot 1.2 m long does not fit askew."""
    points = np.vstack((wall(4, 0.22, 4, 20), wall(4, -0.22, 4, -20)))
    turns = np.vstack((line(2, 3, 4, 0), line(4.05, 0.08, 6, 3)))
    found = plan_path(Pose(2.0, 3.0, -1.0), points, turns, LONG)
    assert found is not None
    assert found.rejoined == len(turns) - 1
    poses = tangents(found.points)
    assert np.abs(poses[np.abs(poses[:, 0] - 4.0) < 0.6, 2]).max() < 0.1
    assert least_clearance(points, LONG, poses[1:]) >= PATH_PARAMS.clearance


def test_a_bend_is_taken_only_if_the_whole_footprint_fits_around_it():
    """A corridor 0.75 m wide with a right-angled corner: the long robot's tail does not clear."""
    points = np.vstack((
        wall(-2, 0.375, 3.625, 0.375), wall(-2, -0.375, 4.375, -0.375),
        wall(4.375, -0.375, 4.375, 5), wall(3.625, 0.375, 3.625, 5), wall(-2, -0.4, -2, 0.4),
    ))  # fmt: skip
    corner = np.vstack((line(0, 0, 4, 0), line(4, 0.1, 4, 4)))
    short = plan_path(AT, points, corner, JACKAL)
    assert short is not None
    assert short.rejoined == len(corner) - 1
    assert plan_path(AT, points, corner, LONG) is None


def test_it_prefers_room_to_a_shorter_way_through_a_tight_gap():
    points = np.vstack((wall(4, 0.22, 4, 0.9), wall(4, -0.22, 4, -6)))
    found = plan_path(AT, points, LINE, JACKAL, PathParams(stray=0.0))
    crossing = np.interp(4.0, found.points[:, 0], found.points[:, 1])
    assert crossing > 0.9


def test_it_rejoins_the_line_at_the_horizon():
    found = plan_path(Pose(1.0, 0.3, 0.0), NOTHING, LINE, JACKAL, PATH_PARAMS, 10, 3.0)
    assert LINE[found.rejoined].tolist() == pytest.approx([4.0, 0.0])
    assert found.points[-1].tolist() == pytest.approx([4.0, 0.0])


def test_it_rejoins_farther_on_where_the_horizon_is_taken():
    found = plan_path(AT, circle(3.0, 0.0, 0.5), LINE, JACKAL, PATH_PARAMS, 0, 3.0)
    assert LINE[found.rejoined, 0] > 3.5
    assert found.points[-1].tolist() == LINE[found.rejoined].tolist()


def test_it_does_not_go_back_behind_what_is_done():
    loop = np.vstack((line(0, 0, 4, 0), line(4, 0.1, 4, 2), line(3.9, 2, 0, 2)))
    early = plan_path(AT, NOTHING, loop, JACKAL, PATH_PARAMS, 0, 1.0)
    late = plan_path(AT, NOTHING, loop, JACKAL, PATH_PARAMS, 70, 1.0)
    assert early.rejoined < 15
    assert late.rejoined > 70


def test_a_line_that_comes_back_is_not_cut_short():
    spur = np.vstack((line(0, 0, 2, 0), line(1.9, 0, 0, 0), line(0, -0.1, 0, -4)))
    found = plan_path(AT, circle(1.0, 0.0, 0.2), spur, JACKAL, PATH_PARAMS, 0, 4.0)
    assert found.points[-1].tolist() == pytest.approx([2.0, 0.0])
    assert found.rejoined < 25


def test_it_begins_in_the_robots_direction_if_that_is_roughly_its_own():
    turned = Pose(0.0, 0.0, 0.5)
    x, y = plan_path(turned, NOTHING, LINE, JACKAL).points[1]
    assert math.atan2(y, x) == pytest.approx(0.5)


def test_it_can_be_left_from_a_place_tighter_than_the_clearance():
    points = np.vstack((wall(-0.5, 0.19, 0.3, 0.19), wall(-0.5, -0.19, 0.3, -0.19)))
    found = plan_path(AT, points, LINE, JACKAL, PathParams(clearance=0.04))
    assert found is None or found.clearance >= 0.04
    free = plan_path(AT, points, LINE, JACKAL, PathParams(clearance=0.02))
    assert free is not None


def test_a_robot_at_the_end_has_arrived():
    found = plan_path(Pose(8.0, 0.01, 0.0), NOTHING, LINE, JACKAL, here=len(LINE) - 1)
    assert len(found.points) == 1


def test_an_occupied_goal_is_approached_to_where_the_robot_can_turn():
    points = circle(8.0, 0.0, 0.03)
    found = plan_path(AT, points, LINE, JACKAL)
    assert 0.33 < math.hypot(*(found.points[-1] - LINE[-1])) <= PATH_PARAMS.beside


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(1, 7), st.floats(-2, 2), st.floats(0.05, 0.5)), max_size=25))
def test_a_path_never_touches_an_obstacle(things):
    points = np.vstack([NOTHING, *(circle(*thing) for thing in things)])
    assume(len(points) == 0 or np.hypot(*points.T).min() > 0.35)
    found = plan_path(AT, points, LINE, JACKAL)
    if found is None or len(points) == 0:
        return
    assert (
        least_clearance(points, JACKAL, tangents(found.points)[1:]) >= PATH_PARAMS.clearance - 1e-9
    )
    centre = LineString(found.points)
    assert centre.distance(MultiPoint(points)) > 0.165


@given(st.floats(0.02, 3.0))
def test_a_line_spread_out_keeps_its_ends_and_its_course(spacing):
    bent = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    even = spread(bent, spacing)
    assert even[[0, -1]].tolist() == bent[[0, -1]].tolist()
    assert np.hypot(*np.diff(even, axis=0).T).max() <= spacing + 1e-9
    assert all(LineString(bent).distance(LineString(even[[i, i]])) < 1e-9 for i in range(len(even)))


def test_of_two_similar_paths_the_previous_one_is_kept():
    def side(y, chosen):
        found = plan_path(AT, circle(3.0, y, 0.4), LINE, JACKAL, chosen=chosen)
        return math.copysign(1.0, found.points[np.abs(found.points[:, 1]).argmax(), 1])

    assert side(0.02, NOTHING) == -1.0
    left = plan_path(AT, circle(3.0, -0.02, 0.4), LINE, JACKAL).points
    assert left[:, 1].max() > 0.5
    assert side(0.02, left) == 1.0
    assert side(0.02, left + np.array([1000.0, 0.0])) == -1.0  # one that is far away says nothing
    assert side(0.5, left) == -1.0  # now it is much the longer
