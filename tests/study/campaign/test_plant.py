"""Suites on the physics twin: what the robot carries, and what is said of a contact."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.row import ROW
from cohelm.robot.gate.gate import Passed
from cohelm.robot.port import Health
from cohelm.scenario.load import robot
from cohelm.sim.twin.robot import Twin
from cohelm.study.campaign import suites
from cohelm.study.campaign.contact_analysis import first_touch
from cohelm.study.campaign.loop_run import Watched
from cohelm.study.campaign.replay_episode import drive
from cohelm.study.campaign.runner import CampaignConfig
from cohelm.study.campaign.worker import chunk


def test_a_room_is_driven_on_sensors_alone():
    (row,) = chunk(suites.suite("random", 1, None, "twin"), "guard", (6,))
    assert (row.plant, row.fault, row.contacts_moving) == ("twin", "", 0)
    assert row.arrived
    assert (row.stops, row.stopped_by) == (0, "")
    assert row.gate_share < 0.01  # the gate is there, and has little to do
    assert 0.0 <= row.monitor_share < 1.0
    (known,) = chunk(suites.suite("random", 1, None), "guard", (6,))
    assert math.isnan(known.gate_share)
    assert math.isnan(known.monitor_share)


@pytest.mark.slow  # that the gate stops it for either is tested with the gate
@pytest.mark.parametrize(("bumped", "mute"), [(6.0, 3.0), (3.0, 6.0)])
def test_a_fault_and_a_silent_loop_are_reset_and_counted_in_a_campaign(monkeypatch, bumped, mute):
    """A bumper is pressed for a moment: the gate latches; at another time nothing is commanded, and
    the watchdog stops the robot. The drive is gone on with, and the row says why it first was
    stopped."""
    read, propose = Twin.read, Watched.propose

    def pressed(twin):
        readings = read(twin)
        at = twin.now()
        if bumped < at < bumped + 0.8:
            health = readings.health or Health(at, math.nan, ())
            return readings._replace(health=health._replace(faults=("the bumper is pressed",)))
        return readings

    def silent(gated, proposal):
        if mute < gated.now() < mute + 0.5:
            return Passed(gated.gate.applied, "")
        return propose(gated, proposal)

    monkeypatch.setattr(Twin, "read", pressed)
    monkeypatch.setattr(Watched, "propose", silent)
    (row,) = chunk(suites.suite("random", 1, None, "twin"), "guard", (6,))
    assert (row.fault, row.stops) == ("", 2)
    reasons = (
        "no valid command for more than 100 ms",
        "the robot reports: the bumper is pressed",
    )
    assert row.stopped_by == reasons[bumped < mute]
    assert row.arrived
    assert row.duration_s > 5.0


@pytest.mark.slow  # tests/cli/test_campaign.py drives a row again by default
def test_a_room_is_driven_again_alike_on_sensors_alone():
    made = suites.suite("random", 1, None, "twin")
    (row,) = chunk(made, "guard", (6,))
    assert drive(made.case(6), row).same


@pytest.mark.slow
def test_the_attackers_walkers_are_after_the_robot_on_the_twin_too():
    made = suites.suite("adversary", 1, None, "twin")
    (row,), (again,) = chunk(made, "guard", (2,)), chunk(made, "guard", (2,))
    assert repr(row) == repr(again)
    assert (row.plant, row.fault, row.contacts_moving, row.stops) == ("twin", "", 0, 0)
    assert row.human_share > 0.5  # the stick is armed, and drives ...
    assert row.path_length_m > 0.1
    assert 0.0 <= row.gate_share < 0.01  # ... behind the gate
    case = suites.suite("adversary", 1, None, "twin").case(2)
    assert drive(case, row).same
    kinematic = suites.suite("adversary", 1, None).case(2)
    assert case.rollout is not None
    assert case.rollout.scene.discs.tolist() == kinematic.rollout.scene.discs.tolist()
    posts = case.setup.obstacles.discs[len(case.rollout.scene.discs) :]
    assert posts[:, :2].tolist() == case.rollout.scene.points.tolist()


@pytest.mark.parametrize(("plant", "degrees"), [("twin", 270.0), ("twin-all-round", 360.0)])
def test_the_plant_says_how_far_round_the_lidar_sees(plant, degrees):
    twin = suites.suite("lab", 1, None, plant).case(1).setup.twin
    assert twin.robot.lidar.field_of_view_deg == degrees
    fitted = twin.physics.fitted(twin.robot).lidar
    assert (fitted.noise_m, fitted.latency_s, fitted.sweep_s) == (0.02, 0.05, 0.075)
    assert twin.known is not None


def test_a_rear_lidar_is_as_the_front_one_and_the_robot_is_sally_rear():
    twin = suites.suite("lab", 1, None, "twin-rear").case(1).setup.twin
    assert twin.robot.lidars == suites.sensed(robot("sally-rear")).lidars
    (rear,) = twin.physics.fitted(twin.robot).further_lidars
    assert (rear.noise_m, rear.latency_s, rear.sweep_s) == (0.02, 0.05, 0.075)


def test_each_lidar_sweeps_within_its_own_scan_period():
    """A rear LiDAR four times as fast as the front one can be driven."""
    model = robot("sally-rear")
    (rear,) = model.further_lidars
    fast = rear.model_copy(update={"rate_hz": 40.0})
    model = model.model_copy(update={"further_lidars": (fast,)})
    twin = suites.suite("random", 1, None, "twin", model).case(0).setup.twin
    fitted = twin.physics.fitted(twin.robot)
    sweeps = [one.sweep_s for one in fitted.lidars]
    assert sweeps == [pytest.approx(0.075), pytest.approx(0.75 / 40.0)]


def test_a_robot_with_sensors_worse_than_the_suites_is_driven_with_its_own():
    model = robot("sally")
    lidar = model.lidar.model_copy(update={"noise_m": 0.05, "latency_s": 0.4, "sweep_s": 0.09})
    odometry = model.odometry.model_copy(update={"distance_error": 0.04, "gyro_drift_degps": 0.5})
    model = model.model_copy(update={"lidar": lidar, "odometry": odometry})
    twin = suites.suite("random", 1, None, "twin", model).case(0).setup.twin
    fitted = twin.physics.fitted(twin.robot)
    assert fitted.lidar == lidar
    assert fitted.odometry == odometry


def test_visibility_before_a_contact_is_computed_from_the_true_scene():
    """A walker straight ahead for 2 s, then behind a disc, at last on the robot's front."""
    case = suites.suite("random", 1, None, "twin").case(0)
    setup, n = case.setup, 151
    rows = np.zeros(n, dtype=ROW)
    rows["t"] = 0.02 * np.arange(n)
    rows["x"], rows["y"], rows["applied_v"] = 5.0, 3.0, 0.5
    discs = np.zeros((n, 2, 6))
    discs[:, 0] = (5.61, 3.0, -0.4, 0.0, 0.25, 0.7)
    discs[:, 1] = (5.5, 30.0, 0.0, 0.0, 0.05, 0.7)
    discs[100:126, 0, :2] = (7.0, 3.0)
    discs[100:126, 1, :2] = (5.9, 3.0)
    discs[100:126, 1, 4] = 0.4
    touch = first_touch(setup, setup.twin, rows, discs, 3.0)
    assert touch.seen == pytest.approx(0.5)
    assert touch.share == pytest.approx(25 / 31)
    assert touch.needed == pytest.approx(0.225 + 0.2 + 0.05 + 0.25)  # sweep, scans, wheels, brakes
    assert (touch.speed, touch.driven) == (0.4, 0.5)
    discs[-1, 0, 2:4] = 0.0  # the twin's movers stop dead as they bump
    assert first_touch(setup, setup.twin, rows, discs, 3.0) == touch
    behind = discs.copy()
    behind[:, 0, 0] = 4.39
    hidden = first_touch(setup, setup.twin, rows, behind, 3.0)
    assert (hidden.seen, hidden.share) == (0.0, 0.0)


def test_suites_not_available_on_the_twin_are_reported():
    for plan, words in (
        (
            CampaignConfig("barn", ("guard",), 1, plant="twin"),
            "barn is not driven with --plant twin",
        ),
        (CampaignConfig("random", ("guard",), 1, plant="twinn"), "no plant 'twinn'"),
        (CampaignConfig("random", ("rvo",), 1, plant="twin"), "rvo does not drive"),
        (CampaignConfig("adversary", ("paper",), 1, plant="twin"), "choose guard"),
    ):
        with pytest.raises(CohelmError, match=words):
            plan.prepared()
    assert math.isnan(chunk(suites.suite("adversary", 1, None), "guard", (0,))[0].contact_seen_s)
