"""A drive becomes a map: near the truth, with loops closed, on a grid that shows the walls."""

import math

import numpy as np
import pytest
import shapely

from benchmarks import intel
from cohelm.core.errors import CohelmError
from cohelm.core.frames import between, compose
from cohelm.core.types import Pose, Twist
from cohelm.perceive.map.loop_closure import LoopClosure, distinct, revisits
from cohelm.perceive.map.mapper import Mapper, encounters
from cohelm.perceive.map.mapper_params import MapperParams
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.perceive.map.place_graph import Place, PlaceGraph
from cohelm.perceive.map.pose_graph import Link, consistent, solved, spread
from cohelm.perceive.map.raster import raster
from cohelm.perceive.match.odometry_covariance import (
    SCALE,
    OdometryErrors,
    joined,
    predict,
    updated,
)
from cohelm.perceive.match.scan_matching import MatchParams, align
from cohelm.perceive.match.surfaces import FlatPoints, seen_from, surfaces
from cohelm.robot.port import Odometry, Scan
from tests.perceive import killian
from tests.perceive.buildings import loop_errors, surveying
from tests.perceive.drives import CONES, LIDAR, TOUR, WALLS, along, drive

HOME = [(-0.5, -1.75), (-0.6, -0.5), (-0.5, 0.8), (0.0, 2.5)]


def recorded(path, seed=0, **more):
    """Odometry, scans, and the true pose at any time of a drive."""
    odometry, scans, truth = [], {}, {}
    for moment in drive(*path, seed, **more):
        odometry.append(moment.readings.odometry)
        truth[round(moment.now, 2)] = moment.truth
        scan = moment.readings.scan
        if scan is not None:
            scans[scan.number] = scan
    return odometry, list(scans.values()), truth


def errors(found, true):
    """Distances after the best rigid fit (ATE), headings after it [m, rad]."""
    a, b = np.array(found), np.array(true)
    ma, mb = a[:, :2].mean(axis=0), b[:, :2].mean(axis=0)
    u, _, v = np.linalg.svd((a[:, :2] - ma).T @ (b[:, :2] - mb))
    turn = v.T @ np.diag([1.0, np.linalg.det(v.T @ u.T)]) @ u.T
    off = (a[:, :2] - ma) @ turn.T + mb - b[:, :2]
    angle = math.atan2(turn[1, 0], turn[0, 0])
    heading = (a[:, 2] + angle - b[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.hypot(*off.T), heading, (turn, mb - turn @ ma)


states = []  # of the tour's survey, before its loops are closed for good


@pytest.fixture(scope="module")
def tour():
    odometry, scans, truth = recorded(along(TOUR + HOME))
    seen = mapping_scans(LIDAR.lidar(), odometry, scans)
    survey = Mapper(LIDAR.lidar())
    for sweep in seen:
        survey.add(sweep)
    states.append(survey.state())
    return survey.finished(), seen, [truth[round(g.stamp, 2)] for g in seen]


def test_the_trajectory_in_the_lab_is_true_within_centimetres(tour):
    made, seen, truth = tour
    off, heading, _ = errors(made.poses, truth)
    assert np.sqrt((off**2).mean()) < 0.03
    assert np.abs(heading).max() < math.radians(0.6)
    drifted, _, _ = errors([g.pose for g in seen], truth)
    assert np.sqrt((off**2).mean()) < 0.2 * np.sqrt((drifted**2).mean())


def test_coming_home_closes_loops_with_the_beginning(tour):
    made, _, _ = tour
    assert any(a < 50 and b > len(made.poses) - 150 for a, b in made.loops)


def test_a_loop_that_was_removed_is_not_closed_again_and_the_others_are(tour):
    made, _, truth = tour
    (state,) = states
    met = encounters(made)
    assert sum(map(len, met)) == len(made.loops)
    survey = Mapper.restored(LIDAR.lidar(), state)
    survey.keep_apart(met[0])
    again = survey.finished()
    apart = {(a, b) for a, b in met[0]}
    assert not apart & {(min(pair), max(pair)) for pair in again.loops}
    assert len(encounters(again)) == len(met) - 1
    off, _, _ = errors(again.poses, truth)
    assert np.sqrt((off**2).mean()) < 0.1


@pytest.mark.slow
def test_of_places_that_are_left_out_none_meets_others(tour):
    made, _, _ = tour
    survey = Mapper.restored(LIDAR.lidar(), states[0])
    out = range(len(made.poses) - 150, len(made.poses))
    survey.leave_out(out)
    assert not {scan for pair in survey.finished().loops for scan in pair} & set(out)


def test_a_mapping_that_is_resumed_is_the_same_as_one_that_did_not_stop(tour):
    _, seen, _ = tour
    whole, half = Mapper(LIDAR.lidar()), Mapper(LIDAR.lidar())
    for k, sweep in enumerate(seen[:200]):
        whole.add(sweep)
        if k == 120:
            half = Mapper.restored(LIDAR.lidar(), half.state())
        half.add(sweep)
    for name, values in whole.state().items():
        assert np.array_equal(values, half.state()[name]), name


def test_occupied_cells_lie_on_true_walls_and_every_wall_has_some(tour):
    made, seen, truth = tour
    _, _, (turn, shift) = errors(made.poses, truth)
    drawn = raster(made.poses, [g.points for g in seen], LIDAR.lidar().mount, 0.05)
    cells = np.argwhere(drawn.occupied())[:, ::-1] + 0.5
    world = (cells * 0.05 + drawn.origin[:2]) @ turn.T + shift
    walls = shapely.unary_union([
        *(shapely.LineString([(a, b), (c, d)]) for a, b, c, d in WALLS),
        *(shapely.Point(x, y).buffer(r).exterior for x, y, _, _, r, _ in CONES),
    ])  # fmt: skip
    off = shapely.distance(shapely.points(world), walls)
    assert np.quantile(off, 0.95) < 0.06
    assert off.max() < 0.3
    cloud = shapely.MultiPoint(world).buffer(0.1)
    seen_share = walls.intersection(cloud).length / walls.length
    assert seen_share > 0.8  # the corridor's west end is behind the robot all the time


def test_free_cells_are_where_nothing_is(tour):
    made, seen, truth = tour
    _, _, (turn, shift) = errors(made.poses, truth)
    drawn = raster(made.poses, [g.points for g in seen], LIDAR.lidar().mount, 0.1)
    cells = (np.argwhere(drawn.free())[:, ::-1] + 0.5) * 0.1 + drawn.origin[:2]
    world = cells @ turn.T + shift
    inside = shapely.union(shapely.box(-1, -4, 14, 3), shapely.box(-3.5, 3, 16.5, 5)).buffer(0.12)
    assert shapely.contains(inside, shapely.points(world)).mean() > 0.995


def test_a_robot_that_stands_makes_one_place():
    still = [Pose(3.0, -1.0, 0.0)] * 101
    odometry, scans, _ = recorded((still, [Twist(0.0, 0.0)] * 100), drift=0.0)
    survey = Mapper(LIDAR.lidar())
    for sweep in mapping_scans(LIDAR.lidar(), odometry, scans):
        survey.add(sweep)
    assert len(survey.finished().places) == 1


def test_a_false_loop_is_outvoted():
    poses = [Pose(0.3 * k, 0.0, 0.0) for k in range(20)]
    firm = np.diag([1e4, 1e4, 1e5])
    steps = [Link(k, k + 1, Pose(0.3, 0.0, 0.0), firm, False) for k in range(19)]
    wrong = Link(2, 17, Pose(0.0, 1.0, 0.5), firm, True)
    assert np.allclose(solved(poses, [*steps, wrong]), poses, atol=0.05)


def test_false_loops_that_came_first_are_found_out_by_those_that_can_be_true_together():
    ring = [Pose(math.cos(a), math.sin(a), a + math.pi / 2) for a in np.linspace(0, 4 * np.pi, 81)]
    firm = np.diag([1e4, 1e4, 1e5])
    steps = [Link(k, k + 1, between(ring[k], ring[k + 1]), firm, False) for k in range(80)]
    right = [Link(k, k + 40, Pose(0.0, 0.0, 0.0), firm, True) for k in (1, 20, 39)]
    wrong = [Link(k, k + 30, Pose(0.1, 0.0, 0.0), firm, True) for k in (3, 5)]
    glued = solved(ring, [*steps, *(link._replace(loop=False) for link in wrong)])
    kept = consistent(glued, [*steps, *wrong, *right])
    assert [link for link in kept if link.loop] == right


def test_views_of_two_places_count_together_only_where_the_way_between_these_is_known():
    """Two laps lie on each other only because the drift between them is unknown. What
    a look-alike in the first one says, a right view of the second one says too, by chance."""
    graph, firm, weak = PlaceGraph(), np.eye(3) * 1e6, np.diag([0.1, 0.1, 100.0])
    laps = [[Pose(0.5 * k, y, 0.0) for k in range(10)] for y in (0.0, 0.0, 5.0)]
    for k, pose in enumerate(pose for lap in laps for pose in lap):
        step = None
        if k > 0:
            information = weak if k % 10 == 0 else firm
            step = Link(k - 1, k, between(graph.poses[-1], pose), information, False)
        graph.add(Place(k, FlatPoints(np.empty((0, 2)), np.empty((0, 2)))), pose, step)

    def seen(lap: int, k: int) -> None:
        graph.add_contradicting(Link(10 * lap + k, 20 + k, Pose(0.0, 0.0, 0.0), firm, True))

    seen(0, 2)
    seen(0, 4)
    seen(1, 6)  # 2 m after the first
    assert not any(link.loop for link in graph.links)
    seen(1, 8)
    assert not any(link.loop for link in graph.links)
    seen(0, 9)
    believed = [(link.a, link.b) for link in graph.links if link.loop]
    assert believed == [(2, 22), (4, 24), (9, 29)]


def test_places_are_unsure_by_the_way_to_them_and_no_more_than_a_loop_allows():
    line = [Pose(0.5 * k, 0.0, 0.0) for k in range(41)]
    own = np.linalg.inv(np.diag([0.01, 0.01, 0.002]) ** 2)
    steps = [Link(k, k + 1, Pose(0.5, 0.0, 0.0), own, False) for k in range(40)]
    open_ = spread(line, steps, 40)
    assert open_[0, 0, 0] == pytest.approx(40 * 0.01**2)
    lever = 0.002**2 * (0.5 * np.arange(40)) ** 2  # each step's heading turns all behind it
    assert open_[0, 1, 1] == pytest.approx(40 * 0.01**2 + lever.sum())
    loop = Link(0, 40, Pose(20.0, 0.0, 0.0), own, True)
    assert np.trace(spread(line, [*steps, loop], 40)[0]) < 0.1 * np.trace(open_[0])
    back = Link(40, 0, Pose(-20.0, 0.0, 0.0), own, True)
    both = spread(line, [*steps, loop, back], 40)
    assert np.allclose(both, spread(line, [*steps, loop], 40))


@pytest.mark.parametrize(("scale", "bend"), [(0.02, 0.003), (-0.02, -0.003), (-0.04, 0.07)])
def test_what_wheels_measure_wrongly_is_learnt_from_matches(scale, bend):
    """The last are those of the Intel log."""
    prior = np.diag([SCALE, MapperParams().bend]) ** 2
    wheels, pose, joint = OdometryErrors(), Pose(0.0, 0.0, 0.0), joined(1e-6 * np.eye(3), prior)
    sure, true = np.diag([1e6, 1e6, 1e6]), pose
    for _ in range(600):
        true = compose(true, Pose(0.1, 0.0, 0.0))
        step = wheels.corrected(Pose(0.1 / (1.0 + scale), 0.0, -0.1 * bend))
        predicted, joint = predict(pose, joint, step)
        off = np.array(between(predicted, true))
        wheels, joint, pose = wheels.updated_by(joint, off), updated(joint, sure), true
    assert wheels.scale == pytest.approx(scale, abs=0.003)
    assert wheels.bend == pytest.approx(bend * (1.0 + scale), abs=0.0008)


@pytest.mark.slow
def test_a_building_whose_loops_drift_has_torn_apart_by_metres_lies_on_itself():
    lidar, seen, truth = surveying(4)
    survey = Mapper(lidar)
    for sweep in seen:
        survey.add(sweep)
    off = loop_errors(survey.finished().poses, truth)
    assert off.mean() < 0.05
    assert off.max() < 0.3


def test_a_loop_corrects_what_has_drifted():
    true = [Pose(math.cos(a), math.sin(a), a + math.pi / 2) for a in np.linspace(0, 2 * np.pi, 21)]
    drifted = [true[0]]
    links = []
    for k in range(20):
        step = between(true[k], true[k + 1])
        step = Pose(1.02 * step.x, step.y, step.psi + 0.01)
        drifted.append(compose(drifted[-1], step))
        links.append(Link(k, k + 1, step, np.diag([1e3, 1e3, 1e3]), False))
    links.append(Link(0, 20, between(true[0], true[20]), np.diag([1e5, 1e5, 1e5]), True))
    before = math.hypot(drifted[20].x - true[20].x, drifted[20].y - true[20].y)
    after = solved(drifted, links)[20]
    assert math.hypot(after.x - true[20].x, after.y - true[20].y) < 0.2 * before


def test_a_link_is_firm_in_the_axes_of_the_place_that_was_seen():
    turned = Pose(1.0, 0.0, math.pi / 2)  # its x axis is the other one's y
    along_x = Link(0, 1, turned, np.diag([1e6, 1.0, 1e6]), False)
    apart = Link(0, 1, Pose(2.0, 1.0, math.pi / 2), np.diag([1e3, 1e3, 1e6]), False)
    found = solved([Pose(0.0, 0.0, 0.0), turned], [along_x, apart])[1]
    assert found.x == pytest.approx(2.0, abs=0.01)
    assert found.y == pytest.approx(0.0, abs=0.01)


RING = np.array([
    [0, 0, 24, 0], [24, 0, 24, 16], [24, 16, 0, 16], [0, 16, 0, 0], [6, 5, 18, 5], [18, 5, 18, 11],
    [18, 11, 6, 11], [6, 11, 6, 5], [9, 0, 9, 1], [4, 16, 4, 15], [15, 5, 15, 4], [24, 7, 23, 7],
], dtype=float)  # fmt: skip


@pytest.mark.slow  # that coming home closes loops, and where a submap is found: above and below
def test_a_loop_is_closed_though_the_robot_slid_metres_unnoticed():
    way = along([(3, 2.5), (12, 2.5), (21, 2.5), (21, 13.5), (3, 13.5), (3, 2.5), (14, 2.5)], 1.0)
    slid = [(30.0, (-2.2, -1.2, 0.0))]
    odometry, scans, truth = recorded(way, walls=RING, around=CONES[:0], pushes=slid)
    survey = Mapper(LIDAR.lidar())
    seen = mapping_scans(LIDAR.lidar(), odometry, scans)
    for sweep in seen:
        survey.add(sweep)
    made = survey.finished()
    true = [truth[round(g.stamp, 2)] for g in seen]
    last = between(between(made.poses[0], made.poses[-1]), between(true[0], true[-1]))
    assert math.hypot(last.x, last.y) < 0.1


def lined(walls, pose):
    """Points of walls 5 cm apart, and the directions across them, in the frame of a pose."""
    points, across = [], []
    for x1, y1, x2, y2 in walls:
        n = int(math.hypot(x2 - x1, y2 - y1) / 0.05)
        points.append(np.linspace((x1, y1), (x2, y2), n))
        across.append(np.tile((y1 - y2, x2 - x1) / np.hypot(x2 - x1, y2 - y1), (n, 1)))
    flat = FlatPoints(np.vstack(points), np.vstack(across))
    return seen_from(between(pose, Pose(0.0, 0.0, 0.0)), flat)


def known(walls):
    made = surfaces(lined(walls, Pose(0.0, 0.0, 0.0)), 0.05, 0.65)
    return made._replace(
        back=np.arange(len(made.points))
    )  # without thickness, seen from both sides


def test_a_scan_is_not_matched_to_the_other_side_of_a_wall():
    """Between equal rooms, views slid by the 20 cm of the wall between two of them: what was seen
    of it from the one lay on what had been seen from the other."""
    sides = [[0.0, 0.0, 4.0, 0.0], [0.0, 3.0, 4.0, 3.0]]
    left = lined([*sides, [4.0, 3.0, 4.0, 0.0]], Pose(0.0, 0.0, 0.0))  # faces the one room,
    right = lined([[4.2, 0.0, 4.2, 3.0]], Pose(0.0, 0.0, 0.0))  # and the next
    graph, home = PlaceGraph(), Pose(0.0, 0.0, 0.0)
    left, right = (one._replace(normals=-one.normals) for one in (left, right))
    graph.add(Place(0, left), home, None)
    graph.add(Place(1, right), home, Link(0, 1, home, np.eye(3), False))
    around = graph.surfaces_around([0, 1], None)
    for first in (0.13, 0.25):
        fit = align(around, left, Pose(first, 0.0, 0.0), 1e-3 * np.eye(3), MatchParams())
        assert abs(fit.pose.x) < 0.01


def test_the_normals_of_a_place_face_the_lidar(tour):
    assert tour
    mount, points, across = LIDAR.lidar().mount, states[0]["points"], states[0]["across"]
    towards = np.einsum("ij,ij->i", points - (mount.x, mount.y), across) < 0.0
    assert towards.mean() > 0.999  # but for the mean of two at a corner
    either = {**states[0], "across": across * np.where(np.arange(len(across)) % 2, 1, -1)[:, None]}
    again = Mapper.restored(LIDAR.lidar(), either).state()["across"]  # as of an older version
    assert np.abs(again - across).max(axis=1).mean() < 1e-3


def two_laps(torn):
    """A graph of two laps that see the same, the second one beside the first, by chance, so far."""
    graph, firm, weak = PlaceGraph(), np.eye(3) * 1e6, np.diag([1.0, 1.0, 100.0])
    lap = [Pose(2.0 + 0.3 * k, 2.5, 0.0) for k in range(45)]
    beside = [Pose(p.x + 0.7 * torn, p.y + 0.7 * torn, p.psi) for p in lap]
    for k, pose in enumerate([*lap, *beside]):
        step = None
        if k > 0:
            information = weak if k == len(lap) else firm
            step = Link(k - 1, k, between(graph.poses[-1], pose), information, False)
        graph.add(Place(k, lined(RING, lap[k % len(lap)])), pose, step)
    return graph


def apart(graph):
    laps = np.array(graph.poses)[:, :2].reshape(2, -1, 2)
    return np.linalg.norm(laps[1] - laps[0], axis=1).max()


def test_laps_that_lie_beside_each_other_are_put_together_at_the_end():
    """Less than a loop would be needed for: no loop was closed where they see the same."""
    graph = two_laps(torn=0.42)
    graph.link_all(lambda share: None, move=True)
    assert apart(graph) < 0.02


@pytest.mark.slow  # laps that lie beside each other are put together: above
def test_a_lap_that_drifts_away_is_pulled_in_from_where_it_lies_beside_the_other():
    """Its end is farther off than a match reaches, until the part before has been pulled in."""
    graph = two_laps(torn=0.0)
    loose = np.diag([2500.0, 2500.0, 2500.0])  # 2 cm a step
    for k in range(45):
        pose = graph.poses[45 + k]
        graph.poses[45 + k] = pose._replace(y=pose.y + 0.05 * k)
    graph.links = [
        Link(link.a, link.b, between(graph.poses[link.a], graph.poses[link.b]), loose, False)
        for link in graph.links
    ]
    graph.link_all(lambda share: None, move=True)
    assert apart(graph) < 0.25  # as far as the last matches reach


def test_where_the_path_revisits_a_place_that_is_not_linked_a_loop_is_searched_once_more():
    graph = two_laps(torn=1.0)
    LoopClosure(graph).look_again()
    assert apart(graph) < 0.05
    before = len(graph.links)
    graph.link_all(lambda share: None, move=True)
    LoopClosure(graph).look_again()  # all is linked
    assert len(graph.links) > before
    assert apart(graph) < 0.02


def test_a_submap_is_found_metres_and_degrees_from_where_drift_put_it():
    true, thought = Pose(3.0, 2.5, 0.3), Pose(5.5, 0.0, 0.0)
    trail = np.column_stack((np.linspace(1.0, 21.0, 60), np.full(60, 2.0)))
    fits = revisits(known(RING), lined(RING, true), trail, np.full(60, 5.0), thought, 0.5)
    assert fits[0].pose == pytest.approx(true, abs=0.01)
    assert fits[0].share > 0.9


def test_two_bays_alike_are_both_found():
    bays = np.array([
        [0, 0, 30, 0], [0, 4, 30, 4], [5, 4, 5, 3], [15, 4, 15, 3],
    ], dtype=float)  # fmt: skip
    part = np.array([[1, 0, 9, 0], [1, 4, 9, 4], [5, 4, 5, 3]], dtype=float)
    trail = np.column_stack((np.linspace(2.0, 28.0, 80), np.full(80, 2.0)))
    seen = lined(part, Pose(5.0, 2.0, 0.0))
    fits = revisits(known(bays), seen, trail, np.full(80, 12.0), Pose(9.0, 2.0, 0.0), 0.2)
    assert sorted(f.pose.x for f in fits[:2]) == pytest.approx([5.0, 15.0], abs=0.05)
    assert fits[1].share > fits[0].share - 0.02


def bays_passed(bays, thought):
    """A way along a corridor past bays, and a newest place back at the first; its surfaces."""
    leaves = [[x + d, 4, x + d, 2.2] for x in bays for d in (-1.5, 0.0, 1.0)]
    walls = np.array([[0, 0, 40, 0], [0, 4, 40, 4], *leaves], dtype=float)
    graph = PlaceGraph()

    def add(pose, at):
        flat = lined(walls, at)
        near = np.abs(flat.points[:, 0]) < 4.0
        seen = FlatPoints(*(part[near] for part in flat))
        k = len(graph)
        step = Link(k - 1, k, between(graph.poses[-1], pose), np.eye(3), False) if k else None
        graph.add(Place(k, seen), pose, step)
        return seen

    for k in range(90):
        pose = Pose(2.0 + 0.3 * k, 1.5, 0.0)
        add(pose, pose)
    return graph, add(thought, graph.poses[10])


@pytest.mark.parametrize(
    ("bays", "thought", "sigma", "reported"),
    [
        # drift can hardly have led so far: a landmark only
        ((5,), Pose(30.0, 9.0, 0.0), 0.5, True),
        ((5, 15), Pose(30.0, 9.0, 0.0), 0.5, False),
        # it can, but a look-alike stands as likely anywhere where it can
        ((5,), Pose(6.5, 1.5, 0.0), 3.0, True),
        ((5, 15), Pose(6.5, 1.5, 0.0), 3.0, False),
        # one stands hardly so near by chance
        ((5, 15), Pose(5.7, 1.5, 0.0), 0.5, True),
    ],
)
def test_a_loop_that_a_look_alike_explains_as_well_as_drift_does_is_not_believed(
    bays, thought, sigma, reported
):
    """Buildings whose rooms are all alike were glued 8 m off: by the one look-alike within reach of
    drift, and where drift was just within three sigma of one."""
    graph, newest = bays_passed(bays, thought)
    loop = Link(10, 90, Pose(0.0, 0.0, 0.0), np.eye(3), True)
    unsure = np.array([np.diag([sigma, sigma, 0.1 * sigma]) ** 2] * 56)
    assert distinct(graph, loop, newest, 1.0, unsure) is reported


def test_how_far_drift_strays_is_learnt_from_loops_and_a_false_one_hardly_counts():
    closure = LoopClosure(PlaceGraph())
    assert closure.variance_factor() == 1.0
    squared = np.random.default_rng(0).chisquare(3, 400)
    closure.drift_errors = [*(0.1 * squared), *[2500.0] * 8]
    assert closure.variance_factor() == pytest.approx(0.1, rel=0.15)
    closure.drift_errors = [2500.0]
    assert closure.variance_factor() == 1.0


def test_nothing_is_searched_farther_than_the_possible_drift():
    trail = np.array([[3.0, 2.5]])
    seen = lined(RING, Pose(3.0, 2.5, 0.0))
    assert not revisits(known(RING), seen, trail, np.array([2.0]), Pose(9.0, 2.5, 0.0), 0.2)


@pytest.mark.slow
@pytest.mark.skipif(not intel.LOG.exists(), reason="the shared data are not beside this checkout")
@pytest.mark.parametrize("raw", [False, True])
def test_the_laps_of_the_intel_lab_lie_on_each_other(raw):
    """Wheels that bend a straight line by 4 degrees a metre lay one lap metres off another."""
    off, heading, alone = intel.errors(intel.surveyed(raw).poses)
    assert (len(off), alone.sum()) == (2984, 1748)
    assert off[alone].mean() < 0.05
    assert np.percentile(off[alone], 99) < 0.15
    assert np.degrees(heading[alone]).mean() < 1.5


@pytest.mark.skipif(killian.FILE is None, reason="COHELM_KILLIAN names no killian.g2o")
def test_two_kilometres_of_mit_are_put_together_right():
    """From odometry that is 12 m wrong, rms; every place where the way met itself is closed."""
    log = killian.read(killian.FILE)
    survey = Mapper(log.lidar)
    for sweep in log.seen:
        survey.add(sweep)
    made = survey.finished()
    assert np.sqrt((errors(log.odometry, log.poses)[0] ** 2).mean()) > 10.0
    off, _, _ = errors(made.poses, log.poses)
    assert np.sqrt((off**2).mean()) < 1.5
    assert off.max() < 3.0
    apart = np.array([
        np.hypot(*between(true, between(made.poses[a], made.poses[b]))[:2])
        for a, b, true in log.loops
    ])  # fmt: skip
    assert np.median(apart) < 0.1
    assert (apart < 0.5).mean() > 0.95
    assert apart.max() < 2.0


def test_a_drive_whose_scans_and_odometry_never_meet_is_refused():
    odometry = [Odometry(0.02 * k, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)) for k in range(10)]
    scans = [Scan(100.0, 0, np.full(720, 3.0), 0.0)]
    with pytest.raises(CohelmError, match="no scan came while there was odometry"):
        mapping_scans(LIDAR.lidar(), odometry, scans)


def test_nothing_but_open_space_can_not_be_mapped():
    with pytest.raises(CohelmError, match="nothing to map"):
        Mapper(LIDAR.lidar()).finished()
