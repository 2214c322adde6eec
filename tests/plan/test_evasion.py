"""The robot steps aside: who comes towards it, crosses or overtakes it is not waited for."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist, disc
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from cohelm.pilot.step import EVADING, LED
from cohelm.plan.evasion import EvasionParams
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import achievable
from cohelm.sim.run import run
from cohelm.sim.setup import with_pilot
from cohelm.sim.world import Body, clearance
from tests.pilot.drives import DT, SALLY, SETTINGS, drive
from tests.sim.test_closed_loop_lidar import crossing

WAY = [(0.0, 0.0), (3.0, 0.0), (6.0, 0.0)]
ON = SETTINGS
OFF = SETTINGS._replace(evasion=EvasionParams(horizon=0.0))


def coming(x, y, vx, vy, radius=0.25):
    """A disc that drifts, minding nobody."""
    return (x, y, radius, radius + 0.5, vx, vy)  # as `disc` takes it


ENCOUNTERS = {
    "head-on": coming(6.0, 0.0, -0.8, 0.0),
    "head-on, a little aside": coming(6.0, 0.3, -0.8, 0.0),
    "crossing from the left": coming(3.0, 3.0, 0.0, -0.6),
    "crossing from the right, fast": coming(3.0, -6.0, 0.0, 1.2),
    "overtaking": coming(-2.5, 0.1, 0.9, 0.0),
    "slower ahead": coming(1.5, 0.0, 0.2, 0.0),
}


@pytest.mark.parametrize("name", ENCOUNTERS)
def test_nobody_who_keeps_his_way_touches_a_robot_that_has_room(name):
    done = drive(WAY, [ENCOUNTERS[name]], seconds=40.0, settings=ON)
    assert done.gaps.min() > 0.05
    assert done.arrived


def test_without_evasion_the_same_encounters_end_in_a_touch():
    """The tests above can fail."""
    gaps = [drive(WAY, [who], seconds=20.0, settings=OFF).gaps.min() for who in ENCOUNTERS.values()]
    assert min(gaps) < 0.0


def test_where_nobody_moves_nothing_is_changed():
    still = [(2.0, 0.6, 0.2, 0.7, 0.0, 0.0)]
    with_it, without = (
        drive(WAY, still, settings=ON, agility=0.0),
        drive(WAY, still, settings=OFF, agility=0.0),
    )
    np.testing.assert_array_equal(with_it.poses, without.poses)


def test_who_passes_far_away_is_not_minded():
    done = drive(WAY, [coming(3.0, 4.0, 0.5, 0.0)], seconds=30.0, settings=ON)
    assert EVADING not in {d.behavior for d in done.decisions}


def test_it_comes_back_to_its_path():
    done = drive(WAY, [ENCOUNTERS["head-on"]], seconds=40.0, settings=ON)
    assert abs(done.poses[:, 1]).max() > 0.3  # it went round
    assert abs(done.poses[-1, 1]) < 0.1


WALKERS = {
    "from the right": Body((3.0, -2.5, 0.0, 0.5, 0.25, 0.6)),
    "from the left": Body((3.0, 2.5, 0.0, -0.5, 0.25, 0.6)),
    "from the right, slower": Body((3.5, -2.5, 0.0, 0.4, 0.25, 0.6)),
}


@pytest.mark.parametrize("name", WALKERS)
def test_a_walker_seen_by_lidar_is_kept_off(name):
    """What a LiDAR tells of a velocity is never twice the same: a motion that the filter could only
    just stop from was begun in front of him, and then could not be gone on with."""
    setup = with_pilot(crossing(WALKERS[name]), lidar=SALLY.lidar)
    rows = run(setup).rows
    assert rows["arrived"][-1]
    assert rows["clearance"].min() > 0.05


def test_who_turns_towards_the_robot_is_foreseen_to_turn():
    """A walker on a circle that passes through where the robot stands."""
    pilot, gaps = Pilot(through([(0.0, 0.0), (0.01, 0.0)], 0.5), ON), []
    pose, twist = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)
    for k in range(600):
        a = 0.35 * k * DT
        x, y = 1.6 * math.sin(a) - 1.6, 1.6 * math.cos(a)
        vx, vy = 0.56 * math.cos(a), -0.56 * math.sin(a)
        seen = surroundings([disc(x, y, 0.25, 0.75, vx, vy)], [0.5])
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, seen), pose, twist)
        d = pilot.step(k * DT, pose, twist, None, seen)
        gaps.append(clearance(pose, SALLY.outline, 0.5, seen.discs, np.empty((0, 4)), 9.0))
        twist = achievable(Twist(d.safe_v, d.safe_omega), twist, ON.limits, DT)
        pose = arc(pose, twist, DT)
    assert min(gaps) > 0.05


def test_a_person_who_leads_is_not_overruled():
    """Whole deflection straight on: the command asked for is the person's alone."""

    def hand(_time, _pose):
        return 1.0, 0.0

    done = drive(WAY, [ENCOUNTERS["head-on"]], seconds=5.0, hand=hand, settings=ON)
    led = [d for d in done.decisions if d.behavior == LED]
    assert led
    assert EVADING not in {d.behavior for d in done.decisions[50:]}
    for d in led[50:]:
        assert d.nominal_v == pytest.approx(d.operator_v, abs=0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("column", range(6))
def test_what_is_asked_for_is_finite_whatever_is_told(bad, column):
    pilot = Pilot(through(WAY, 0.5), ON)
    rows = np.array([disc(*coming(3.0, 0.1, -0.5, 0.0)), disc(*coming(2.0, 0.2, -0.5, 0.0))])
    rows[1, column] = bad
    around = surroundings(rows, np.array([0.5, 0.5]))
    for k in range(12):
        d = pilot.step(k * DT, Pose(0.0, 0.0, 0.0), Twist(0.2, 0.0), None, around)
        asked = (
            d.safe_v,
            d.safe_omega,
            d.nominal_v,
            d.nominal_omega,
            d.tracking_v,
            d.tracking_omega,
        )
        assert np.isfinite(asked).all()


def test_who_slows_down_is_foreseen_to_stop_and_not_to_come_back():
    """He walks away ahead of the robot, and stops: what would come back had to be fled from."""
    pilot = Pilot(through([(0.0, 0.0), (0.01, 0.0)], 0.5), ON)
    pose, twist, went = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), 0.0
    x, v = 1.1, 0.7
    for k in range(150):
        seen = surroundings([disc(x, 0.0, 0.25, 0.75, v, 0.0)], [1.0])
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, seen), pose, twist)
        d = pilot.step(k * DT, pose, twist, None, seen)
        twist = achievable(Twist(d.safe_v, d.safe_omega), twist, ON.limits, DT)
        pose = arc(pose, twist, DT)
        went = max(went, math.hypot(pose.x, pose.y))
        x, v = x + v * DT, max(v - 0.7 * DT, 0.0)
    assert went < 0.05
