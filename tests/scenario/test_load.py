"""Errors in a scenario are reported with line, value and allowed values."""

import os
import tracemalloc
from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel
from cohelm.scenario import load
from cohelm.scenario.model import Scenario

GOOD = """\
name: mine
reference:
  speed_mps: 0.4
  waypoints_m: [[0, 0], [2, 0], [4, 1]]
obstacles:
  - {name: post, center_m: [2, 1], radius_m: 0.1}
law:
  barrier: {k_cbf: 1.5}
"""


def parsed(text: str, *overrides: str) -> Scenario:
    return load.parse(text, Scenario, "mine.yaml", overrides)


def refusal(text: str, *overrides: str) -> str:
    with pytest.raises(CohelmError) as caught:
        parsed(text, *overrides)
    return str(caught.value)


def test_omitted_options_have_the_values_of_the_paper(tmp_path):
    law = parsed(GOOD).law
    assert (law.tracking.k_x, law.tracking.k_psi) == (0.9, 1.0)
    assert (law.filter, law.barrier.K, law.barrier.C) == ("guard", 0.5, 0.5)
    assert (law.sharing.k_hx, law.sharing.k_hpsi, law.sharing.k_s) == (0.5, 0.5, 5.0)
    assert parsed(GOOD).obstacles[0].safe_distance_m == 0.2


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        ("  barrier:", "  barier:", "mine.yaml:8: law.barier: unknown key; did you mean barrier?"),
        ("k_cbf", "k_cfb", "mine.yaml:8: law.barrier.k_cfb: unknown key; did you mean k_cbf?"),
        ("k_cbf", "zzz", "unknown key; known here: K, C, k_cbf, motion_sign"),
        ("speed_mps", "speed_kmh", "unknown key; did you mean speed_mps (in m/s)?"),
        ("speed_mps", "speed", "mine.yaml:3: reference.speed: unknown key; did you mean speed_mps"),
        ("radius_m: 0.1", "radius_cm: 10", "did you mean radius_m (in m)?"),
        ("0.4", "0.4 m/s", "must be a number in m/s, without the unit, got '0.4 m/s'; write 0.4"),
        ("0.4", "'0.4'", "must be a number in m/s, without the unit, got '0.4'; write 0.4"),
        ("0.4", "true", "reference.speed_mps: must be a number in m/s, without the unit, got true"),
        ("0.4", ".nan", "mine.yaml:3: reference.speed_mps: must be a finite number in m/s"),
        ("0.4", "nan", "must be a number in m/s, without the unit, got 'nan'"),
        ("0.4", "-.inf", "must be a finite number in m/s, without the unit, got -inf"),
        ("0.4", "0", "mine.yaml:3: reference.speed_mps: must be > 0 and <= 100 m/s, got 0"),
        ("0.4", "-1", "must be > 0 and <= 100 m/s, got -1"),
        ("0.1}", "-1}", "mine.yaml:6: obstacles.0.radius_m: must be >= 0 and <= 1000 m, got -1"),
        ("[2, 1]", "[2, x]", "obstacles.0.center_m.1: must be a number in m"),
        ("[2, 1]", "[2, 1, 0]", "obstacles.0.center_m: needs at most 2 items, got 3"),
        ("[2, 1]", "2", "obstacles.0.center_m: must be a list [..., ...], got 2"),
        ("center_m: [2, 1], ", "", "obstacles.0: needs either center_m: [x, y] or a path"),
        (", [2, 0], [4, 1]", "", "reference.waypoints_m: needs at least 2 items, got 1"),
        (", [2, 0]", ", [0, 0]", "waypoints 1 and 2 are the same point"),
        ("{k_cbf: 1.5}", "", "law.barrier: needs keys of its own (K"),
        ("name: mine", "nickname: mine", "mine.yaml:1: name: is missing: What to call it."),
        ("name: mine", "name: 7", "mine.yaml:1: name: must be text, got 7; put it in quotes"),
    ],
)
def test_a_wrong_key_or_value_is_reported_with_its_line_and_the_allowed_values(was, becomes, said):
    assert was in GOOD
    assert said in refusal(GOOD.replace(was, becomes, 1))


@pytest.mark.parametrize("typed", ["０.４", "1２", "'0x10'", "'1_000'", "'1,000'"])
def test_no_number_is_proposed_that_may_be_another_one(typed):
    said = refusal(GOOD.replace("0.4", typed, 1))
    typed = typed.strip("'")
    assert f"must be a number in m/s, without the unit, got '{typed}'" in said
    assert "write" not in said


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        ("simulation: {step_s: 0}", "simulation.step_s: must be > 0 and <= 1 s, got 0"),
        ("simulation: {delay_s: -1}", "simulation.delay_s: must be >= 0 and <= 60 s, got -1"),
        ("simulation: {seed: 1.5}", "simulation.seed: must be a whole number, got 1.5"),
        ("simulation: {wheel_limits: yes}", "must be true or false, got 'yes'"),
        ("simulation: {duration_s: -3}", "must be > 0 and <= 1e+06 s, got -3"),
        ("stick: {kind: operater}", "must be one of none, script, file, operator; got 'operater'"),
        ("stick: {events: []}", "stick: kind is missing; one of file, none, operator, script"),
        ("stick: {kind: script, events: [[0, 1.5, 0]]}", "events.0.1: must be >= -1 and <= 1"),
        ("stick: {kind: script, events: [[1, 0, 0], [0, 0, 0]]}", "stick.events.1: comes after"),
        ("stick: {kind: operator, minds: [pots]}", "no obstacle is called 'pots'; there are: post"),
        ("walls_m: [[1, 1, 1, 1]]", "walls_m.0: both ends are the same point"),
        ("robot: {name: r}", "mine.yaml:9: robot.footprint_m: is missing: Corners"),
        ("start: {x_m: 0, y_m: 0}", "start.heading_rad: is missing: Heading"),
        ("start: {x_m: 0, y_m: 0, heading_deg: 90}", "did you mean heading_rad (in rad)?"),
        ("name: again", "mine.yaml:9: name: given twice, first at mine.yaml:1; remove one"),
    ],
)
def test_a_wrong_section_is_reported(extra, said):
    assert said in refusal(GOOD + extra + "\n")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "mine.yaml: the file is empty"),
        ("# nothing\n", "the file is empty"),
        ("hello", "needs keys of its own (name, robot"),
        ("- 1\n", "not a scenario"),
        ("name: [1", "mine.yaml:1: not valid YAML: expected ',' or ']', but got the end"),
        ("name:\n\tx: 1", "mine.yaml:2: not valid YAML: a tab; YAML is indented with spaces"),
        ("a: 1\n---\nb: 2", "mine.yaml:2: not valid YAML: a second document starts here"),
        ("a: &x 1\nb: *x", "mine.yaml:2: not valid YAML: aliases"),
        ("name: \x00", "not a YAML text file"),
        ("[" * 5000, "nested too deeply"),
    ],
)
def test_a_file_that_is_not_a_yaml_scenario_is_reported(text, said):
    assert said in refusal(text)


def test_nothing_in_a_file_is_evaluated(tmp_path):
    proof = tmp_path / "evaluated"
    text = GOOD.replace("mine", f"!!python/object/apply:os.mkdir ['{proof}']")
    assert "the tag !!python/object/apply:os.mkdir is not read" in refusal(text)
    assert not proof.exists()


def test_all_problems_of_a_file_are_reported_at_once():
    said = refusal(GOOD.replace("0.4", "fast").replace("m: 0.1", "m: -1") + "stik: 1\n")
    assert [line.split(": ")[0] for line in said.splitlines()] == [
        "mine.yaml:3", "mine.yaml:6", "mine.yaml:9",
    ]  # fmt: skip


def test_two_obstacles_of_one_name_are_reported_at_the_second():
    twice = "  - {name: post, center_m: [2, 1], radius_m: 0.1}\n"
    said = refusal(GOOD.replace(twice, twice * 2))
    assert "mine.yaml:7: obstacles.1.name: obstacle 1 is called 'post' too" in said


@pytest.mark.parametrize("written", ["1e-2", "1.0e-2", "0.01", ".01", "+0.01"])
def test_a_number_is_read_however_it_is_written(written):
    assert parsed(GOOD + f"simulation: {{step_s: {written}}}").simulation.step_s == 0.01


def test_an_override_reaches_any_key_by_index_or_by_name():
    made = parsed(
        GOOD, "law.barrier.k_cbf=0.5", "obstacles.0.radius_m=0.3",
        "obstacles.post.safe_distance_m=1", "simulation.delay_s=0.1",
        "reference.waypoints_m.1=[2, 0.5]",
    )  # fmt: skip
    assert made.law.barrier.k_cbf == 0.5
    assert made.obstacles[0].radius_m == 0.3
    assert made.obstacles[0].safe_distance_m == 1.0
    assert made.simulation.delay_s == 0.1
    assert made.reference.waypoints_m[1] == (2.0, 0.5)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("law.barrier.k_cbf", "--set law.barrier.k_cbf: write key.path=value, for example"),
        ("law..k_cbf=1", "write key.path=value"),
        ("law.barrier.k_cbf=abc", "law.barrier.k_cbf: must be a number, got 'abc'"),
        ("law.barrier.k_cbf=-1", "must be >= 0 and <= 10000, got -1"),
        ("law.barier.k_cbf=1", "law.barier: unknown key; did you mean barrier?"),
        ("law.guard.clear_m=0.01", "clear_m: unknown key; it is called hard_margin_m now"),
        ("law.plan.room_m=0.2", "unknown key; it is called ample_clearance_m now"),
        ("obstacles.4.radius_m=1", "obstacles has 1 items, no '4'; count from 0 to 0 or a name"),
        ("name.x=3", "name is a value and has no 'x' in it"),
        ("reference.waypoints_m=[1", "not valid YAML"),
    ],
)
def test_a_wrong_override_is_quoted(override, said):
    told = refusal(GOOD, override)
    assert told.startswith(f"--set {override}")
    assert said in told


def test_a_missing_file_is_reported_with_the_nearest_name(tmp_path):
    (tmp_path / "garden.yaml").write_text(GOOD)
    for path, said in [
        (tmp_path / "gardn.yaml", "no such file; did you mean garden.yaml?"),
        ("turtlebot5", "turtlebot5: no such file; did you mean turtlebot4?"),
        ("lab-sharde", "no such file; did you mean lab-shared?"),
        (tmp_path / "lab-shared.yaml", "did you mean the shipped scenario 'lab-shared'?"),
        (tmp_path, "is a folder; name a YAML file in it (garden.yaml)"),
    ]:
        with pytest.raises(CohelmError, match=r".") as caught:
            load.scenario(path)
        assert said in str(caught.value)


def test_a_binary_or_unreadable_file_is_reported(tmp_path):
    picture = tmp_path / "picture.yaml"
    picture.write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(CohelmError, match="not a text file in UTF-8"):
        load.scenario(picture)
    locked = tmp_path / "locked.yaml"
    locked.write_text(GOOD)
    locked.chmod(0)
    if os.access(locked, os.R_OK):
        pytest.skip("this user may read every file")
    with pytest.raises(CohelmError, match="can not be read: Permission denied"):
        load.scenario(locked)


def test_a_robot_is_found_by_name_or_beside_the_scenario(tmp_path):
    jackal = load.robot("jackal")
    assert isinstance(jackal, RobotModel)
    (tmp_path / "mine.yaml").write_text(GOOD + "robot: rover.yaml\n")
    (tmp_path / "rover.yaml").write_text(load.dump(jackal).replace("jackal", "rover"))
    made = load.scenario(tmp_path / "mine.yaml")
    assert isinstance(made.robot, RobotModel)
    assert made.robot.name == "rover"


def test_a_missing_or_incomplete_robot_file_is_reported(tmp_path):
    mine, rover = tmp_path / "mine.yaml", tmp_path / "rover.yaml"
    rover.write_text(
        "name: r\ntrack_m: 0.5\nwheel_radius_m: 0\n"
        "footprint_m: [[0, 0], [1, 0], [0.1, 0.1], [0, 1]]\n"
    )
    for robot, said in [
        ("jakal", f"{mine}: robot: no robot is called 'jakal'"),
        ("jakal", "did you mean jackal?"),
        ("rove.yaml", "rove.yaml: no such file; did you mean rover.yaml?"),
        ("rover.yaml", f"{rover}:3: wheel_radius_m: must be > 0 and <= 5 m, got 0"),
    ]:
        mine.write_text(GOOD + f"robot: {robot}\n")
        with pytest.raises(CohelmError, match=r".") as caught:
            load.scenario(mine)
        assert said in str(caught.value)
    rover.write_text(rover.read_text().replace("radius_m: 0", "radius_m: 0.1"))
    with pytest.raises(CohelmError, match=r"rover.yaml:4: footprint_m: .*dent at \[0.1, 0.1\]"):
        load.scenario(mine)


@given(st.text(max_size=200))
@settings(max_examples=40)
def test_any_text_gives_a_scenario_or_sentences(text):
    with suppress(CohelmError):
        parsed(text)


@given(
    st.sampled_from(["law.barrier.k_cbf", "obstacles.0", "stick.kind"]) | st.text(max_size=40),
    st.text(max_size=40),
)
@settings(max_examples=60)
def test_any_override_gives_a_scenario_or_a_sentence(path, value):
    with suppress(CohelmError):
        parsed(GOOD, f"{path}={value}")


def test_files_beyond_the_size_limit_are_not_read_further(tmp_path):
    """2 GB were read whole, and took 4 GB, only to see whether they describe a robot."""
    large = tmp_path / "large.yaml"
    with large.open("wb") as file:
        file.truncate(500_000_000)
    tracemalloc.start()
    try:
        assert not load.is_robot_file(large)
        assert tracemalloc.get_traced_memory()[1] < 120_000_000
    finally:
        tracemalloc.stop()
