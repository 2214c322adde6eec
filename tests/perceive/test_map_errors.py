"""A map error costs a place once, by its length; and which place is believed for it."""

import math
from itertools import pairwise

import numpy as np
import pytest

from cohelm.core.scalars import wrap
from cohelm.core.types import Pose
from cohelm.perceive.localize import verdict as believing
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.hypothesis import Hypothesis, sigma
from cohelm.perceive.localize.localization_map import Judgement, map_from_occupancy
from cohelm.perceive.localize.localizer import Localizer
from cohelm.perceive.localize.map_errors import MapErrorCosts, new_errors
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.localize.verdict import Belief, SearchContext
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.scan.deskew import NO_SWEEP
from cohelm.scenario import load
from cohelm.sim.grid import grid
from cohelm.sim.lidar import scan
from tests.few import first
from tests.perceive.buildings import NO_DISCS, building, tour
from tests.perceive.drives import LIDAR, along, drive
from tests.perceive.test_places import NO_WALLS, dotted, room

AT = Pose(3.0, 2.9, 0.3)
CELL = 0.05


def seen(drawn, pose, model=LIDAR, number=0):
    lidar = model.lidar()
    ranges = np.empty(len(lidar.beams))
    world = grid(drawn, CELL, Pose(0.0, 0.0, 0.0))
    scan(pose, lidar, NO_DISCS, NO_WALLS, world, 0, number, ranges)
    return ranges


def standing(*, more=False, less=False, post=False, box=False, nearer=False):
    """A room as it is: with a wall of 1.5 m on no map, or without 1.5 m of one that is drawn, or
    with a post of 10 cm, or a box of 0.6 m, or with 1.5 m of wall 15 cm nearer than it is drawn."""
    drawn, _ = room(CELL)
    if more:
        drawn[45:75, 100] = True
    if post:
        drawn[64:66, 80:82] = True
    if box:
        drawn[54:66, 100:112] = True
    if nearer:
        drawn[45:75, -6] = True
    if less:
        drawn[45:75, -3] = False
    return drawn


def charge(ranges, pose, charges=None, model=LIDAR, every=1, stamp=0.0, made=None):
    """What the map has wrong, what may walk, how closely the rest fits, and what is narrow and
    wrong, by one view."""
    made = made or map_from_occupancy(*room(CELL), CELL, Pose(0.0, 0.0, 0.0))
    own = charges or MapErrorCosts()
    care = 0.5 * CELL, 0.05, own.cells, own.off, stamp
    reported = new_errors(made, model.lidar(), pose, ranges, every, *care)
    own.take(reported)
    return reported


def test_where_the_map_is_right_nothing_costs():
    log, in_view, closer, narrow = charge(seen(standing(), AT), AT)
    assert log == in_view == narrow == 0.0
    assert closer > 0.0


@pytest.mark.parametrize("how", [{"more": True}, {"less": True}])
def test_a_wrong_wall_of_the_map_costs_once_however_often_it_is_seen(how):
    world, charges, logs = standing(**how), MapErrorCosts(), []
    for k in range(5):
        there = Pose(AT.x + 0.05 * k, AT.y + 0.02 * k, AT.psi + 0.02 * k)
        logs.append(charge(seen(world, there, number=k), there, charges)[0])
    assert logs[0] < -2.5
    assert sum(logs[1:]) > 0.25 * logs[0]  # more of it comes into view


@pytest.mark.parametrize("how", [{"more": True}, {"less": True}])
def test_it_costs_by_its_length_not_by_the_beams_that_fall_on_it(how):
    few = LIDAR.model_copy(update={"beams": LIDAR.beams // 4})
    world = standing(**how)
    whole = charge(seen(world, AT), AT)
    fourth = charge(seen(world, AT, few), AT, None, few)
    assert fourth[0] == pytest.approx(whole[0], abs=0.8)
    assert fourth[2] == pytest.approx(whole[2], rel=0.2)


def test_a_possible_edge_costs_nothing():
    ranges = seen(standing(post=True), AT)
    assert (ranges < 1.2).sum() >= 10
    assert charge(ranges, AT)[:2] == (0.0, 0.0)


def test_what_is_narrow_and_wrong_in_every_view_counts_once_and_an_edge_seen_past_fades():
    """A post on no map, seen from ten places; and one that is there in the first view alone."""
    always, once = MapErrorCosts(), MapErrorCosts()
    for k in range(10):
        there = Pose(AT.x - 0.15 * k, AT.y, AT.psi)
        charge(seen(standing(post=True), there, number=k), there, always)
        charge(seen(standing(post=k == 0), there, number=k), there, once)
    assert always.log - once.log == pytest.approx(-1.5, abs=0.5)
    assert always.errors == once.errors == 0.0
    assert once.edges > -0.5


def test_a_wall_on_no_map_is_as_rare_as_one_that_is_gone_and_a_box_is_not():
    more, less, box = (
        charge(seen(standing(**how), AT), AT) for how in ({"more": True}, {"less": True},
                                                          {"box": True})
    )  # fmt: skip
    assert more[0] == pytest.approx(less[0], abs=0.6)
    assert more[1] == less[1] == 0.0
    assert -3.0 < box[0] + box[1] < -1.5


def test_a_possible_person_costs_for_good_once_it_has_stood():
    world, charges = standing(box=True), MapErrorCosts()
    logs = []
    for k in range(10):
        charge(seen(world, AT, number=k), AT, charges, stamp=0.3 * k)
        logs.append((charges.errors, charges.errors + charges.in_view))
    assert logs[0][0] == 0.0  # it may walk away
    assert logs[-1][0] < -1.5
    assert all(-3.0 < whole < -1.5 for _, whole in logs)  # it speaks against the place all along


def test_a_passer_by_costs_no_longer_than_it_is_in_view():
    """A person of 0.4 m that crosses the room at 0.7 m/s."""
    charges, drawn = MapErrorCosts(), standing()
    for k in range(12):
        world = drawn.copy()
        at = 40 + round(0.7 * 0.3 * k / CELL)
        world[at : at + 8, 90:98] = True
        charge(seen(world, AT, number=k), AT, charges, stamp=0.3 * k)
        assert charges.in_view < -1.5
    charge(seen(drawn, AT), AT, charges, stamp=4.0)
    assert charges.errors == charges.in_view == 0.0


def test_a_wall_beside_where_it_is_drawn_is_an_error_from_near_by():
    """A corridor that is 15 cm narrower than another is another."""
    near = Pose(5.0, 2.9, 0.3)
    assert charge(seen(standing(nearer=True), near), near)[0] < -2.0


def test_a_map_that_is_wrong_once_is_likelier_wrong_again():
    costs = [MapErrorCosts(errors=-3.0 * k).log for k in range(4)]
    steps = [a - b for a, b in pairwise(costs)]
    assert costs[0] == 0.0
    assert steps[0] > 3.5 > 2.5 > steps[1] > steps[2] > 2.0


def test_a_wall_in_unknown_space_is_no_error_as_a_missing_wall_is():
    """What was not drawn may stand or not; what was drawn stood."""
    drawn, free = room(CELL)
    blank = drawn.copy()
    blank[45:75, -3] = False
    ranges = seen(drawn, AT)
    made = map_from_occupancy(blank, free & ~drawn, CELL, Pose(0.0, 0.0, 0.0))
    log, _, closer, _ = charge(ranges, AT, made=made)
    gone, _, nearer, _ = charge(seen(standing(less=True), AT), AT)
    assert gone + 2.0 < log < 0.0
    assert closer > nearer + 0.1  # nor is it taken to lie worse than what is drawn
    assert closer == pytest.approx(charge(ranges, AT)[2], rel=0.1)


def test_how_closely_ends_lie_on_a_wall_tells_once_however_long_one_looks():
    charges, reported = MapErrorCosts(), []
    for k in range(20):
        charge(seen(standing(), AT, number=k), AT, charges)
        reported.append(charges.closer)
    assert reported[-1] == pytest.approx(reported[0], rel=0.25)


def test_each_wall_that_comes_into_view_tells_how_closely_it_fits():
    """On the mean over the way, what a place does not fit hid behind the corridor that it does."""
    charges = MapErrorCosts()
    narrow = LIDAR.model_copy(update={"field_of_view_deg": 90.0, "beams": 240})
    reported = []
    for psi in (0.0, 0.5 * math.pi, math.pi):
        there = Pose(AT.x, AT.y, psi)
        charge(seen(standing(), there, narrow), there, charges, narrow)
        reported.append(charges.closer)
    assert reported[1] > 1.5 * reported[0]
    assert reported[2] > 1.2 * reported[1]


def test_a_place_where_all_is_wrong_accumulates_cost_without_end():
    charges, rng = MapErrorCosts(), np.random.default_rng(1)
    for _ in range(60):
        there = Pose(*rng.uniform(0.5, 5.5, 2), rng.uniform(-math.pi, math.pi))
        charge(rng.uniform(0.2, 9.0, LIDAR.beams).repeat(4)[: LIDAR.beams], there, charges)
    assert np.count_nonzero(charges.cells[1:]) == charges.cells[0] <= 1800


def at(x, log, now, passed=0):
    judged = Judgement(0.95, 0.0, 0.05, now, 700, now, 0.0, passed)
    return Hypothesis(Pose(x, 0.0, 0.0), np.diag([0.02, 0.02, 0.01]) ** 2, log, 0.0, judged)


@pytest.mark.parametrize(("now", "why"), [(-3.0, True), (-8.0, False)])
def test_switched_on_it_believes_no_place_where_another_explains_better_what_it_sees_now(now, why):
    """One wall that is gone at the right place may have separated the two."""
    kept = [at(0.0, -2.0, -7.0), at(9.0, -12.0, now)]
    found = verdict(kept)
    assert found.best is kept[0]
    assert bool(found.why) is why


def verdict(kept, vain=-1.0):
    judge = ScanJudge(map_from_occupancy(*room(CELL), CELL, Pose(0.0, 0.0, 0.0)), LIDAR.lidar())
    about = SearchContext(True, True, True, True, False, vain, 9, True, None, None)
    return Belief(judge).verdict(kept, about)


def test_a_place_found_after_a_long_way_in_vain_must_hold_for_as_long():
    """In another building, sooner or later one looks right."""
    found = [at(0.0, -1.0, -2.0)]
    assert verdict(found).why == ""
    assert "is it the map of this building? It must fit for 4 m more" in verdict(found, 4.0).why


def test_the_way_in_vain_is_what_the_map_did_not_explain_less_what_it_did():
    known = map_from_occupancy(*room(CELL), CELL, Pose(0.0, 0.0, 0.0))
    locator = Localizer(known, LIDAR.lidar())
    assert locator._trust == PARAMS.trust
    for k in range(9):
        locator.correct(NO_SWEEP._replace(pose=Pose(1.0 * k, 0.0, 0.0)))
    assert locator.located.lost
    assert locator._trust == pytest.approx(PARAMS.trust - 8.0)


@pytest.mark.slow  # four minutes of a drive
def test_on_the_map_of_another_building_no_place_is_believed_after_a_minute_of_none():
    """One was after 77 s, for the 100 s that were left."""
    here, map_of = building(304), building(305).known
    poses, twists = along(tour(here, 8808, 160.0, 0.38), 0.5, most=10_000)
    perception = Perception(load.robot("sally").model_copy(update={"lidar": LIDAR}), map_of)
    for moment in drive(poses, twists, 1, around=NO_DISCS, walls=here.walls, grid=here.grid):
        assert perception.take(moment.now, moment.readings).lost


@pytest.mark.parametrize(("others", "sure"), [(1, True), (8, False)])
def test_switched_on_it_believes_what_is_likelier_than_all_others_together(others, sure):
    """Each is 5 nats behind: of many, one may well be right."""
    kept = [at(0.0, -1.0, -2.0), *(at(9.0 + 4.0 * k, -6.0, -2.0) for k in range(others))]
    assert (verdict(kept).why == "") is sure


@pytest.mark.parametrize(("passed", "sure"), [(0, True), (1, True), (2, False)])
def test_switched_on_it_believes_no_place_from_which_it_looks_through_two_walls(passed, sure):
    """The right place was not among those that were followed, and narrow pieces cost nothing."""
    assert (verdict([at(0.0, -1.0, -2.0, passed)]).why == "") is sure


@pytest.mark.slow  # one place of one building; along other corridors: below, and test_places.py
def test_switched_on_in_a_corridor_of_rooms_alike_the_right_place_does_not_slide_away():
    """It slid by 0.45 m, to where a map that is wrong fitted better, and another was believed."""
    place = building(8205, alike=True)
    k, seed = 4137, 287740
    poses, twists = along(tour(place, 8206, 160.0), 0.5, most=k + 499)
    robot = load.robot("sally").model_copy(update={"lidar": LIDAR})
    perception, sure = Perception(robot, place.known), False
    for moment in drive(
        poses[k : k + 500], twists[k : k + 499], seed, around=NO_DISCS, walls=place.walls
    ):
        seen = perception.take(moment.now, moment.readings)
        off = math.hypot(seen.pose.x - moment.truth.x, seen.pose.y - moment.truth.y)
        assert seen.lost or off < 0.3
        sure = sure or not seen.lost
    assert sure


@pytest.mark.parametrize(("map_", "start"), first([(2, 24), (0, 24)]))
def test_switched_on_along_a_corridor_no_place_is_held_to_where_it_was_found(
    map_, start, monkeypatch
):
    """Every beam of every scan made it surer: to 9 mm, and it was 6 cm off."""
    occupied, free, cell, origin = dotted(map_, length=40.0)
    perception = Perception(load.robot("sally").model_copy(update={"lidar": LIDAR}),
                            map_from_occupancy(occupied, free, cell, origin))  # fmt: skip
    assert perception._localizer is not None
    followed = perception._localizer._hypotheses
    # they are followed all the way
    monkeypatch.setattr(believing, "PARAMS", PARAMS._replace(certain=math.inf))
    poses, twists = along([(start + 0.7 * k, 0.05 * (-1) ** k) for k in range(7)])
    off = math.inf
    for moment in drive(
        poses, twists, start, NO_DISCS, NO_WALLS, grid=grid(occupied, cell, origin)
    ):
        perception.take(moment.now, moment.readings)
        for one in followed.all if not followed.searching else ():
            away = math.hypot(one.pose.x - moment.truth.x, one.pose.y - moment.truth.y)
            if one.age == 0 and away < 0.3 and abs(wrap(one.pose.psi - moment.truth.psi)) < 0.3:
                off = away / sigma(one)
    assert off < 3.0
