"""From a scenario to a run, and from its stored text to the same run."""

from pathlib import Path

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.scenario import build, load, schema
from cohelm.scenario.model import Scenario
from cohelm.sim.run import run

FOLDER = Path(__file__).parents[2] / "scenarios"
SHIPPED = ["dock", "lab-avoid", "lab-guard", "lab-shared", "lab-track", "minimal", "open"]


def scenario(*overrides: str, name: str = "minimal") -> Scenario:
    return load.scenario(name, overrides)


def refusal(*overrides: str) -> str:
    with pytest.raises(CohelmError) as caught:
        build.setup(scenario(*overrides))
    return str(caught.value)


def windows(trace) -> list[float]:
    led = trace.rows["authority_x"] < 0.5
    return trace.rows["t"][np.flatnonzero(np.diff(led.astype(int)))].tolist()


def test_the_shipped_scenarios_are_as_documented():
    assert sorted(load.shipped()) == SHIPPED


@pytest.mark.parametrize("name", SHIPPED)
def test_the_scenario_in_a_record_repeats_the_run(name):
    first = run(build.setup(scenario("simulation.seed=7", "simulation.duration_s=10", name=name)))
    again = run(build.setup(load.parse(first.scenario, Scenario, "again")))
    assert again.rows.tobytes() == first.rows.tobytes()
    assert (again.h == first.h).all()
    assert again.scenario == first.scenario


def test_the_scenario_in_a_record_is_self_contained(tmp_path):
    (tmp_path / "hand.csv").write_text("t,x,psi\n0,0,0\n1,0.8,0.1\n2,0,0\n")
    (tmp_path / "mine.yaml").write_text(
        (FOLDER / "minimal.yaml").read_text().partition("stick:")[0]
        + "stick: {kind: file, path: hand.csv, start_s: 1}\n"
    )
    made = build.setup(load.scenario(tmp_path / "mine.yaml"))
    trace = run(made)
    assert trace.rows["stick_x"][205] == 0.8
    kept = load.parse(made.scenario, Scenario, "kept")
    assert run(build.setup(kept)).rows.tobytes() == trace.rows.tobytes()
    (tmp_path / "hand.csv").write_text("t,x,psi\n0,0,0\n1,0.7,0.1\n2,0,0\n")
    with pytest.raises(CohelmError, match="has changed since this scenario was written down"):
        build.setup(kept)


def test_a_stick_file_replaces_the_stick_of_the_scenario(tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_text("run,source,t,v,w\n3,joy_cmd,0,1,0.65\n4,joy_cmd,0,0,0\n")
    monkeypatch.chdir(tmp_path)
    made = load.scenario("minimal", stick="log.csv#3")
    hands = build.setup(made).recorded_stick
    assert (hands.x.tolist(), hands.psi.tolist()) == ([1.0], [0.5])


def test_every_option_of_the_paper_reaches_the_law():
    made = build.setup(
        scenario(
            "law.barrier={motion_sign: printed}", "law.filter=none",
            "law.sharing={blend: per-axis}",
            "reference.feed_forward=spline", "simulation={delay_s: 0.2, wheel_limits: false}",
            "reference.speed_mps=0.3",
        )
    )  # fmt: skip
    assert (made.gains.barrier, made.gains.true_sign, made.gains.joint) == (False, False, False)
    assert made.gains.u_d == made.reference.speed == 0.3
    assert made.spline_speed
    assert made.delay_steps == 20
    assert np.isinf(made.limits.wheel_speed)


def test_by_default_the_robot_starts_on_the_reference():
    trace = run(build.setup(scenario("stick={kind: none}", "obstacles=[]", "law.filter=none")))
    assert trace.rows["e_p"][0] == 0.0
    guarded = run(build.setup(scenario("stick={kind: none}", "obstacles=[]"))).rows[0]
    assert guarded["e_p"] < 1e-3  # the clock has gone on by one step already
    assert tuple(guarded[["x", "y", "psi"]]) == tuple(trace.rows[0][["x", "y", "psi"]])


def test_an_obstacle_drifts_or_follows_its_path():
    path = "{start_s: 1, speed_mps: 0.5, waypoints_m: [[3, 3], [3, 4]]}"
    drifting = "{name: a, center_m: [2, 2], radius_m: 0.1, velocity_mps: [0.5, 0]}"
    made = scenario(f"obstacles=[{drifting}, {{name: b, radius_m: 0.1, path: {path}}}]")
    discs = run(build.setup(made)).discs
    assert discs[200, 0, :2] == pytest.approx([3.0, 2.0])
    assert discs[100, 1, :2] == pytest.approx([3.0, 3.0])
    assert discs[400, 1, :2] == pytest.approx([3.0, 4.0])


def test_a_robot_that_starts_inside_something_is_refused_with_its_name():
    at_origin = "start={x_m: 0, y_m: 0, heading_rad: 0}"
    assert "m inside obstacle post (obstacles.0)" in refusal("obstacles.post.center_m=[0.2, 0]")
    # the real outline counts: the Jackal's front is 0.21 m ahead, the post's radius is 0.1 m
    assert "0.001 m inside" in refusal("obstacles.post.center_m=[0.309, 0]", at_origin)
    build.setup(scenario("obstacles.post.center_m=[0.311, 0]", at_origin))
    said = refusal("walls_m=[[5, 5, 6, 6], [-1, 0.1, 1, 0.1]]", at_origin)
    assert "inside the wall from (-1.0, 0.1) to (1.0, 0.1) (walls_m.1)" in said


def test_a_robot_that_sees_too_short_for_its_brakes_is_refused_as_when_it_is_driven():
    made = scenario(name="lab-guard")
    lidar = made.robot.lidar.model_copy(update={"range_max_m": 0.4})
    short = made.model_copy(update={"robot": made.robot.model_copy(update={"lidar": lidar})})
    build.setup(short)  # knows all there is
    seeing = short.model_copy(update={"senses": "lidar"})
    with pytest.raises(CohelmError, match=r"from 1 m/s stops after .* set limits\.speed_mps to"):
        build.setup(seeing)


def test_a_run_too_long_for_memory_is_refused_with_what_fits():
    assert "shorten duration_s or raise step_s" in refusal("simulation.duration_s=1e6")
    assert "shorten duration_s or raise step_s" in refusal("reference.speed_mps=1e-9")
    late = refusal("simulation.delay_s=60", "simulation.duration_s=30")
    assert "longer than the run" in late
    twin = refusal("simulation.plant=twin", "simulation.delay_s=2", "simulation.duration_s=9")
    assert "simulation.delay_s: 2 s and the robot's own" in twin


def test_a_reference_beyond_the_robot_is_a_warning_not_an_error():
    assert build.warnings(scenario()) == []
    corner = "reference.waypoints_m=[[0, 0], [2, 0], [2, 2]]"
    found = build.warnings(scenario("reference.speed_mps=3", corner))
    assert any("asks for a speed of" in line and "jackal has 2 m/s" in line for line in found)
    assert not any("asks for a yaw rate of" in line for line in found)  # it slows down there
    found = build.warnings(scenario("reference.speed_mps=3", corner, "law.filter=none"))
    assert any("asks for a yaw rate of" in line for line in found)


def test_a_stick_file_shorter_than_the_run_is_a_warning(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t,x,psi\n0,0,0\n2,0,0\n")
    (line,) = build.warnings(load.scenario("minimal", stick=str(file)))
    assert "the file ends at 2.0 s" in line


def test_a_stick_file_of_another_time_than_the_run_is_a_warning_and_can_be_shifted(tmp_path):
    file = tmp_path / "unix.csv"
    file.write_text("t,x,psi\n1700000000,0.5,0\n1700000100,0.5,0\n")
    (line,) = build.warnings(load.scenario("minimal", stick=str(file)))
    assert "begins at 1700000000.0 s, and the run ends at" in line
    text = f"{{kind: file, path: {file}, start_s: -1700000000}}"
    made = scenario(f"stick={text}", "simulation.duration_s=1")
    assert build.warnings(made) == []
    assert run(build.setup(made)).rows["stick_x"].max() == 0.5


@pytest.mark.parametrize("name", ["lab-avoid", "lab-shared", "lab-track"])
def test_the_lab_requests_nothing_beyond_the_limits_of_sally(name):
    assert build.warnings(scenario(name=name)) == []


def test_in_the_shared_lab_the_operator_leads_only_past_cones_and_mover():
    trace = run(build.setup(scenario(name="lab-shared")))
    rows = trace.rows
    assert windows(trace) == pytest.approx([2.5, 6.3, 43.0, 46.6], abs=0.5)
    hands_off = (rows["t"] < 2.2) | ((rows["t"] > 7.2) & (rows["t"] < 42.2)) | (rows["t"] > 47.2)
    assert (rows["authority_x"][hands_off] == 1.0).all()
    assert trace.h.min() > 0.1
    assert rows["clearance"].min() > 0.0
    back = ((rows["t"] > 15) & (rows["t"] < 20)) | (rows["t"] > 52)
    assert rows["e_p"][back].max() < 0.03


def test_in_the_lab_the_barrier_avoids_obstacles_that_tracking_hits():
    with_it = run(build.setup(scenario(name="lab-avoid")))
    without = run(build.setup(scenario("law.filter=none", name="lab-avoid")))
    assert with_it.h.min() > 0.14
    assert (without.h.min(axis=0) < 0.0).all()
    track = run(build.setup(scenario(name="lab-track"))).rows
    assert track["e_p"].max() < 0.03
    assert track["e_p"][-1] < 0.001


def test_the_shipped_schema_is_the_models_own():
    assert (FOLDER / "scenario.schema.json").read_text() == schema.text()


def test_every_key_is_described_for_editors():
    made = schema.json_schema()
    for form in [made, *made["$defs"].values()]:
        for key, value in form["properties"].items():
            assert value.get("description"), (form["title"], key)
