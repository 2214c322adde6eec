"""One scenario under any law: the same plant, the same judge."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import cohelm
from cohelm.law.human import authority, blend, human, intent, limited
from cohelm.law.track import track
from cohelm.robot.model import shipped_path
from cohelm.scenario import build
from cohelm.study.controlled import driven
from tests.few import first

STRAIGHT = ["simulation.duration_s=8"]


def test_the_papers_law_as_ones_own_drives_as_the_papers_law():
    """A person at the stick, wheel limits and a delay: the same trajectory from both loops."""
    changes = ["law.filter=none", "simulation.duration_s=10", "simulation.delay_s=0.05"]
    gains = build.setup(cohelm.load_scenario("lab-shared", changes)).gains

    def law(now: cohelm.Observation) -> cohelm.Twist:
        stick = limited(now.stick, gains)
        share = authority(intent(stick, gains), gains)
        return blend(track(now.pose, now.reference, gains), human(stick, gains), share)

    ours = cohelm.run("lab-shared", law, changes=changes).trace.rows
    theirs = cohelm.run("lab-shared", changes=changes).trace.rows
    assert np.abs(theirs["stick_x"]).max() > 0.3
    for name in (
        "x",
        "y",
        "psi",
        "safe_v",
        "safe_omega",
        "applied_v",
        "applied_omega",
        "clearance",
        "e_p",
    ):
        assert np.allclose(ours[name][: len(theirs)], theirs[name][: len(ours)], atol=1e-9), name


def test_a_law_that_rams_is_judged_to_have_touched():
    def ram(now: cohelm.Observation) -> cohelm.Twist:
        return cohelm.Twist(1.0, 0.0)

    result = cohelm.run("lab-guard", ram, changes=STRAIGHT)
    assert result.contacts >= 1
    assert not result.arrived
    assert result.metrics.contact


def test_a_law_that_changes_what_it_is_given_changes_neither_world_nor_evaluation():
    def shifts(now: cohelm.Observation) -> cohelm.Twist:
        seen = now.obstacles
        for one in (seen.discs, seen.segments, seen.points, seen.max_acceleration):
            one += 100.0  # as into the body's frame, in place
        return cohelm.Twist(0.5, 0.0)

    kept, shifted = (
        cohelm.run("lab-track", law, changes=STRAIGHT).trace.rows["clearance"]
        for law in (lambda now: cohelm.Twist(0.5, 0.0), shifts)
    )
    assert np.array_equal(kept, shifted)


def test_the_filter_around_the_same_law_touches_nothing():
    robot = cohelm.load_robot("sally")
    safe = cohelm.SafetyFilter(robot, period=0.02, delay=0.06)

    def ram(now: cohelm.Observation) -> cohelm.Twist:
        return safe(now.pose, now.twist, cohelm.Twist(1.0, 0.0), now.obstacles).twist

    result = cohelm.run("lab-guard", ram, changes=STRAIGHT)
    assert result.contacts == 0
    assert result.metrics.min_clearance_m > 0.0075
    assert result.metrics.path_length_m > 1.0


def test_a_law_that_returns_nan_stands_and_the_trace_has_it():
    result = cohelm.run(
        "lab-track", lambda now: cohelm.Twist(math.nan, 0.0), changes=["simulation.duration_s=1"]
    )
    assert (result.trace.rows["applied_v"] == 0.0).all()
    assert set(result.trace.rows["verdict"]) == {cohelm.Verdict.INVALID}


@pytest.mark.parametrize("answer", [None, 1.0, "go", (1.0, 2.0, 3.0)])
def test_no_answer_that_is_no_twist_goes_unsaid(answer):
    with pytest.raises(cohelm.CohelmError, match="must return a Twist"):
        cohelm.run("lab-track", lambda now: answer, changes=["simulation.duration_s=1"])


def test_parameters_that_a_custom_law_can_not_have_are_reported():
    with pytest.raises(cohelm.CohelmError, match="a controller is called"):
        cohelm.run("lab-track", 0.5)
    with pytest.raises(cohelm.CohelmError, match="senses=truth"):
        cohelm.run("lab-guard", lambda now: cohelm.Twist(0, 0), changes=["senses=lidar"])
    made = cohelm.load_scenario("lab-track")
    with pytest.raises(cohelm.CohelmError, match="model_copy"):
        cohelm.run(made, changes=["simulation.duration_s=1"])


@pytest.mark.parametrize("changes", ["law.tracking.k_x=0.3", {"law.tracking.k_x": 0.3}])
def test_changes_that_are_no_list_are_told_as_what_they_are(changes):
    with pytest.raises(cohelm.CohelmError, match="changes are a list of"):
        cohelm.run("lab-track", changes=changes)


def test_what_is_no_scenario_is_said():
    with pytest.raises(cohelm.CohelmError, match=r"a cohelm.Scenario\(...\), got dict"):
        cohelm.run({"name": "x"})


def test_a_scenario_made_in_python_says_what_is_wrong_in_words():
    """pydantic tells it; keys and sentences are those of a file."""
    posts = [{"name": "post", "center_m": [9, 9], "radius_m": 0.1}] * 2
    ahead = {"speed_mps": 0.5, "waypoints_m": [[0, 0], [2, 0]]}
    with pytest.raises(ValueError, match="obstacles") as error:
        cohelm.Scenario(name="x", robot="sally", reference=ahead, obstacles=posts)
    said = str(error.value).splitlines()[1].strip()
    assert said.startswith("obstacles.1.name: obstacle 1 is called 'post' too; names must differ [")
    late = {"kind": "script", "events": [[2, 0, 0], [1, 0, 0]]}
    with pytest.raises(ValueError, match=r"events\.1: comes after an event at 2 s but says"):
        cohelm.Scenario(name="x", robot="sally", reference=ahead, stick=late)


def test_a_run_shows_what_became_of_it_and_not_its_numbers():
    made = cohelm.run("lab-track", changes=["simulation.duration_s=1"])
    assert repr(made) == "RunResult(not arrived, 0 contacts, 101 steps)"


def test_a_run_that_is_cut_short_on_its_reference_has_not_reached_its_end():
    assert cohelm.run("lab-track").arrived
    assert not cohelm.run("lab-track", changes=["simulation.duration_s=1"]).arrived


def test_a_run_ends_where_its_reference_does():
    setup = build.setup(cohelm.load_scenario("minimal", ["stick={kind: none}"]))
    trace = driven(setup, lambda now: track(now.pose, now.reference, setup.gains))
    assert trace.rows["arrived"][-1]
    assert trace.rows["to_go"][-1] < setup.near
    assert trace.rows["t"][-1] == pytest.approx(setup.reference.duration, rel=0.1)


@pytest.mark.parametrize("others", first([80, 0]))
def test_a_fast_robot_knows_a_wall_in_time_however_many_there_are(tmp_path, others):
    """It needs 8 m to stop; of many walls only near ones are looked at."""
    robot = yaml.safe_load(Path(shipped_path("sally")).read_text(encoding="utf-8"))
    robot["limits"] = {
        "speed_mps": 4.0, "acceleration_mps2": 1.0, "yaw_rate_radps": 1.0,
        "yaw_acceleration_radps2": 2.0,
    }  # fmt: skip
    (tmp_path / "fast.yaml").write_text(yaml.safe_dump(robot))
    walls = [[22.0, -30.0, 22.0, 30.0], *([-20.0 - k, 4.0, -20.0 - k, 5.0] for k in range(others))]
    scenario = {
        "name": "wall", "robot": "fast.yaml", "start": {"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0},
        "reference": {"speed_mps": 3.9, "waypoints_m": [[0.0, 0.0], [15.0, 0.0], [30.0, 0.0]]},
        "walls_m": walls,
    }  # fmt: skip
    (tmp_path / "wall.yaml").write_text(yaml.safe_dump(scenario))
    result = cohelm.run(tmp_path / "wall.yaml")
    assert result.contacts == 0
    assert result.table()["x"].max() > 21.0
