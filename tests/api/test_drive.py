"""A robot by somebody else in the whole loop: gate, watchdog, perception, pilot."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import cohelm
from cohelm.drive.factory import own_robot, simulated
from cohelm.drive.operate import mode_and_stick
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from tests.api import carts
from tests.api.carts import SITE


def test_a_robot_of_ones_own_arrives_and_is_recorded(tmp_path):
    site = tmp_path / "short.yaml"
    site.write_text(SITE.read_text().replace(", [6, 0], [8, 0]]", "]"))
    summary = cohelm.drive(carts.Simulated, site, arrive=True, seconds=60.0,
                           record=tmp_path / "drive.mcap")  # fmt: skip
    assert summary["arrived"]
    assert not summary["faulted"]
    assert summary["kind"] == "own"
    record = cohelm.read_record(tmp_path / "drive.mcap")
    assert record.table["x"][-1] > 3.8
    assert record.table["applied_v"].max() > 0.4


def test_it_drives_as_the_simulated_robot_of_the_same_site_does():
    """Simulation is one adapter among equals: the same readings, the same trajectory."""
    tracks = []
    for factory in (own_robot(carts.Simulated, SITE), simulated(SITE, real_time=False, seed=0)):
        with Session(SessionConfig(factory)) as session:
            track = []

            def until(loop, track=track):
                track.append((*loop.seen.pose, *loop.gated.gate.applied))
                return loop.gated.now() > 4.0

            session.run(until, Mode.AUTOMATIC)
            tracks.append(np.array(track))
    assert tracks[0][-1, 0] > 1.0
    assert np.abs(tracks[0] - tracks[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rate": "50"}, "rate must be from 10"), ({"seconds": math.nan}, "seconds must be more"),
        ({"seconds": -1}, "seconds must be more"), ({"mode": 3}, "mode must be a text"),
        ({"listen": 3}, "listen must be a text"), ({"record": 3}, "name the record's file"),
        ({"model": 3}, "name a robot, or its"), ({"site": 3}, "name a site, or its"),
    ],
)  # fmt: skip
def test_what_a_drive_is_given_is_looked_at_before_it_drives(given, said):
    with pytest.raises(cohelm.CohelmError, match=said):
        cohelm.drive(carts.Cart, **given)


@pytest.mark.parametrize(
    ("given", "mode"),
    [
        ({}, Mode.HOLD), ({"joystick": True}, Mode.MANUAL), ({"goals": True}, Mode.AUTOMATIC),
        ({"mode": "shared"}, Mode.SHARED), ({"mode": "automatic", "goals": True}, Mode.AUTOMATIC),
    ],
)  # fmt: skip
def test_a_real_robot_follows_no_route_that_nobody_named(given, mode):
    """The default site's route leads anywhere in the real world."""
    unnamed, named = own_robot(carts.Cart, model="sally"), own_robot(carts.Cart, SITE)
    assert mode_and_stick(unnamed, **({"mode": ""} | given))[0] is mode
    with pytest.raises(cohelm.CohelmError, match="there is none: name a site"):
        mode_and_stick(unnamed, "automatic")
    assert mode_and_stick(named, "")[0] is Mode.AUTOMATIC
    assert mode_and_stick(simulated("lab-guard"), "")[0] is Mode.AUTOMATIC


def test_without_a_site_it_stands(tmp_path):
    summary = cohelm.drive(carts.Simulated, seconds=1.5, record=tmp_path / "drive.mcap")
    assert summary["reason"] == "the drive is over"
    assert not cohelm.read_record(tmp_path / "drive.mcap").table["applied_v"].any()
    with pytest.raises(cohelm.CohelmError, match="does not arrive: name a site"):
        cohelm.drive(carts.Simulated, arrive=True)


def test_no_error_in_the_robots_own_code_leaves_it_driving(tmp_path):
    summary = cohelm.drive(carts.Dying, SITE, seconds=4.0, record=tmp_path / "drive.mcap")
    assert summary["faulted"]
    assert "send failed: OSError: the line is dead" in summary["reason"]
    events = [said for _, said in cohelm.read_record(tmp_path / "drive.mcap").events]
    assert any("the robot reports: send failed" in said for said in events)


@pytest.mark.xdist_group("realtime")
def test_in_real_time_it_lives_in_the_process_of_the_gate():
    summary = cohelm.drive("tests.api.carts:Cart", SITE, mode="hold", seconds=2.0)
    assert summary["reason"] == "the drive is over"
    assert summary["periods"] > 50


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((object(), SITE), "must be a subclass of cohelm.Robot or make one"),
        (("json:JSONDecoder", SITE), "JSONDecoder is no subclass of cohelm.Robot"),
        (("tests.api.carts:Nothing", SITE), "can not be imported"),
        (("no_such_package:Cart", SITE), "can not be imported"),
        (("cart", SITE), "entry point of cohelm.robots"),
        ((lambda model: None, SITE), "can not be sent to the process"),
        ((carts.Broken, SITE), "no such device"),
        ((carts.Other, SITE), "is not the model of"),
        ((carts.Simulated, "no-site"), "no such file"),
        ((carts.Simulated, SITE, "no-robot"), "no robot is called"),
    ],
)
def test_scenarios_that_can_not_be_driven_are_reported(given, said):
    with pytest.raises(cohelm.CohelmError, match=said):
        own_robot(*given)()


def test_a_robot_that_knows_its_own_model_needs_no_argument():
    made = own_robot(carts.NoArguments, SITE)
    assert made().model == made.model
    again = own_robot(carts.NoArguments, SITE, "jackal")
    with pytest.raises(cohelm.CohelmError, match="is not the model of"):
        again()


def test_incompatible_options_are_reported():
    for options, said in (
        ({"rate": 5.0}, "rate must be"),
        ({"rate": math.nan}, "rate must be"),
        ({"listen": "127.0.0.1", "arrive": True}, "the station chooses mode and goal"),
        ({"mode": "fly"}, "there is no mode"),
    ):
        with pytest.raises(cohelm.CohelmError, match=said):
            cohelm.drive(carts.Simulated, SITE, **options)


def test_the_function_and_the_room_of_one_name_are_both_to_be_had():
    import cohelm.drive.session

    assert cohelm.drive.session.Session is Session
    assert callable(cohelm.drive)


def test_a_real_robot_without_known_braking_is_not_driven(tmp_path):
    """The guard would count on braking without end."""
    text = (Path(cohelm.__file__).parent / "robot" / "models" / "sally.yaml").read_text()
    endless = tmp_path / "endless.yaml"
    turning = "yaw_acceleration_radps2: 3.0"
    endless.write_text(re.sub(r"wheel_acceleration_mps2: [\d.]+", turning, text))
    assert cohelm.load_robot(endless).limits.wheel_acceleration_mps2 is None
    with pytest.raises(cohelm.CohelmError, match="how hard the robot brakes"):
        cohelm.drive(carts.Simulated, SITE, model=endless, mode="hold", seconds=0.1)
