"""How far a robot can have been carried since it knew its place, and what may be where it stood."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.perceive.localize.caution import PARAMS
from cohelm.perceive.localize.hypotheses import Hypotheses
from cohelm.perceive.localize.hypothesis import Departure, Hypothesis
from cohelm.perceive.localize.kidnap_alarm import KidnapAlarm
from cohelm.perceive.localize.localization_map import Judgement, map_from_occupancy
from cohelm.perceive.localize.scan_judge import ScanJudge
from cohelm.perceive.localize.verdict import rivals
from cohelm.perceive.scan.deskew import NO_SWEEP
from tests.perceive.drives import LIDAR
from tests.perceive.test_keyframe import HERE, seen
from tests.perceive.test_places import room

NOWHERE = Pose(0.0, 0.0, 0.0)
AWAY = Pose(HERE.x + 2.0, HERE.y, 0.0)


def sweep(ranges, stamp, odometry=NOWHERE):
    return NO_SWEEP._replace(lidar=LIDAR.lidar(), ranges=ranges, stamp=stamp, pose=odometry)


def after(scans, every=0.1, lost=True):
    """The alarm of a robot whose wheels stand, after these scans."""
    alarm = KidnapAlarm()
    for k, ranges in enumerate(scans):
        alarm.compare(sweep(ranges, every * k), NOWHERE, HERE, lost and k > 0)
    return alarm


def test_while_scans_agree_the_robot_is_not_carried():
    assert after([seen(HERE, k) for k in range(20)]).carried == 0.0


@pytest.mark.parametrize("scans", [5, 15])
def test_for_as_long_as_scans_contradict_each_other_it_may_be_carried(scans):
    moved = [seen(HERE), seen(HERE, 1), *(seen(AWAY, 2 + k) for k in range(scans))]
    assert after(moved).carried == pytest.approx(0.1 * scans)


def test_what_one_jolt_leaves_is_forgotten_once_the_robot_goes_on_knowing_its_place():
    scans = [seen(HERE), seen(AWAY, 1), *(seen(HERE, 2 + k) for k in range(5))]
    assert after(scans, lost=True).carried == pytest.approx(0.1)
    assert after(scans, lost=False).carried == 0.0


def test_under_a_cover_and_without_scans_it_may_be_carried_as_well():
    covered = np.full(LIDAR.beams, -math.inf)
    assert after([seen(HERE), *[covered] * 30]).carried == pytest.approx(3.0)
    assert after([seen(HERE), seen(HERE, 1)], every=4.0).carried == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("fell", "falls", "first"), [(True, False, 0.0), (False, False, 0.35), (True, True, 0.35)]
)
def test_a_keyframe_from_since_the_map_fits_worse_is_no_view_from_before_the_alarm(
    fell, falls, first
):
    """Pushed along a corridor, no scan contradicts another at first, and the next keyframe is
    taken where the robot was pushed to, at the pose that it had before. Unless the map, poor
    there, fits much worse only since that was taken."""
    alarm = KidnapAlarm()
    on = Pose(HERE.x + 0.35, HERE.y, HERE.psi)
    for k in range(6):
        alarm.compare(sweep(seen(HERE, k), 0.1 * k), NOWHERE, HERE, False)
        alarm.fall(0.0, False)
    led = Pose(0.35, 0.0, 0.0)
    for k in range(6, 10):
        alarm.compare(sweep(seen(on, k), 0.1 * k, led), led if k == 6 else NOWHERE, HERE, False)
        alarm.fall(-1.0 if fell else 0.0, fell)
    for k in range(10, 12):
        alarm.compare(sweep(seen(AWAY, k), 0.1 * k, led), NOWHERE, on, False)
        alarm.fall(-30.0 if falls else -1.0 if fell else 0.0, fell)
    assert alarm.raised
    assert alarm._reference is not None
    assert alarm._reference[0].pose.x == first


def lost_at(pose, odds=0.0, was_known=True):
    """What is followed by a robot that became lost there."""
    drawn, free = room(0.05)
    lidar, made = LIDAR.lidar(), map_from_occupancy(drawn, free, 0.05, NOWHERE)
    judge, alarm = ScanJudge(made, lidar), KidnapAlarm()
    found = Hypotheses(made, judge, alarm, False)
    found.left = Departure(pose, np.diag([0.05, 0.05, 0.02, 0.01, 0.01]) ** 2, odds, was_known)
    found.everywhere = True
    return found


def at(x, log, agree=0.9, reported=700):
    judged = Judgement(agree, 0.0, 1.0 - agree, log, reported, log, 0.0)
    return Hypothesis(Pose(x, 0.0, 0.0), np.diag([0.02, 0.02, 0.01]) ** 2, 0.0, log, judged)


def test_a_place_too_far_to_be_carried_to_is_unlikely():
    found, far, near = lost_at(NOWHERE), at(9.0, -5.0), at(2.0, -5.0)
    assert [h.prior for h in found_ranked(found, far, near)] == [0.0, -PARAMS.unmoved]
    found.alarm.carried = 4.0  # at 1.6 m/s
    assert [h.prior for h in found_ranked(found, far, near)] == [0.0, 0.0]


def test_a_robot_without_a_known_pose_may_be_anywhere():
    assert found_ranked(lost_at(NOWHERE, was_known=False), at(9.0, -5.0))[0].prior == 0.0


def found_ranked(found, *places):
    """Of places, by how far off they are."""
    for one in places:
        one.prior = found._prior(one)
    return sorted(places, key=lambda h: h.pose.x)


def test_where_it_left_off_is_believed_though_a_third_of_the_map_is_wrong():
    """The next place is as likely by the map, and 9 m off; it stood still throughout."""
    found = lost_at(NOWHERE)
    found._whole = True
    own, far = at(0.0, -28.0, agree=0.79), at(9.0, -28.5, agree=0.76)
    for one in (own, far):
        one.prior = found._prior(one)
    verdict = found.verdict([own, far], -PARAMS.trust)
    assert verdict.best is own
    assert verdict.why == ""


def along_a_wall(x, log):
    """A place that a match tells across the wall only."""
    one = at(x, log, agree=0.67, reported=105)
    one.covariance = np.diag([0.3, 0.02, 0.01]) ** 2
    return one


def test_along_a_wall_the_last_pose_is_known_as_well_as_by_odometry():
    """A third of the map is gone, the match slides, and what is 0.6 m on is the same place. It
    stands, and no scan tells it more."""
    found = lost_at(NOWHERE, odds=PARAMS.unmoved, was_known=False)
    found.left = found.left._replace(joint=np.diag([0.09, 0.09, 0.05, 0.01, 0.01]) ** 2)
    found._whole = True
    own, beside, far = along_a_wall(0.1, -3.2), along_a_wall(-0.55, -4.0), at(5.0, 5.0, 1.0, 105)
    for one in (own, beside, far):
        one.prior = found._prior(one)
    said = [found.verdict([own, beside, far], -PARAMS.trust) for _ in range(PARAMS.steady)]
    assert said[0].why  # and not at once
    assert said[-1].why == ""
    assert abs(said[-1].best.pose.x) < 0.02
    assert math.sqrt(said[-1].best.covariance[0, 0]) < 0.09


def test_a_place_far_off_that_looks_better_than_where_it_left_off_by_as_much_keeps_it_lost():
    found = lost_at(NOWHERE, odds=PARAMS.unmoved, was_known=False)
    found._whole = True
    own, far = along_a_wall(0.1, -3.2), at(5.0, 8.0, 1.0, 105)
    for one in (own, far):
        one.prior = found._prior(one)
    assert all(found.verdict([own, far], -PARAMS.trust).why for _ in range(2 * PARAMS.steady))


def test_people_about_speak_no_less_against_where_it_stands_than_against_its_twin():
    """They contradict what was seen before, had it stayed; what it would have seen from the other
    end of the hall nobody knows. The newest scan fits both."""
    here = Pose(2.0, 2.0, 0.0)
    found = lost_at(here)
    own, other = at(2.0, -1.0), at(4.0, -1.0)
    own.pose, other.pose = here, Pose(3.0, 1.0, math.pi)
    own.keyframe_log = -17.5
    found.all = [other, own]
    assert found.ranked()[0] is own


def test_while_nothing_shows_that_it_was_moved_a_place_that_explains_less_is_no_rival():
    """Where the map knows little, little speaks against a place."""
    own, little, as_much = at(0.0, -25.0, 0.52), at(25.0, -6.0, 1.0, 225), at(20.0, -18.0, 0.8)
    left = Departure(NOWHERE, np.diag([0.05, 0.05, 0.02, 0.01, 0.01]) ** 2, PARAMS.unmoved, True)
    assert rivals([little, as_much, own], left) == [as_much, own]
    assert rivals([little, own], left._replace(odds=0.0)) == [little, own]


def test_of_two_places_where_it_may_have_been_put_neither_is_left_out():
    """Along a corridor, a start that was told half a metre off leaves more than one."""
    left = Departure(NOWHERE, np.diag([0.5, 0.5, 0.25, 0.01, 0.01]) ** 2, PARAMS.unmoved, False)
    there, beside = at(0.6, -3.0, 0.99), at(-0.4, -3.2, 0.98)
    assert rivals([there, beside], left) == [there, beside]
