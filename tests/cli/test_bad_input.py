"""Invalid command lines and files: one sentence on stderr with the cure, exit status 2."""

import gzip
import io
import os
from pathlib import Path

import numpy as np
import pytest

from cohelm.core.files import alone

BASE = "name: b\nreference: {speed_mps: 0.5, waypoints_m: [[0, 0], [2, 0]]}\n"
HERE = "start: {x_m: %s, y_m: 0, heading_rad: 0}\n"


def refused(said, *words):
    """Exit code 2, nothing on stdout, and an error on stderr in which these words stand."""
    assert said.code == 2
    assert said.out == ""
    assert said.err.startswith("error: ")
    assert "Traceback" not in said.err
    for word in words:
        assert word in said.err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BASE + "obstacels: []\n", ["s.yaml:3", "obstacels", "did you mean obstacles?"]),
        (BASE + HERE % "0 m", ["s.yaml:3", "start.x_m", "without the unit", "write 0"]),
        (BASE + HERE % "[]", ["s.yaml:3", "start.x_m", "must be a number"]),
        (BASE + HERE % ".nan", ["s.yaml:3", "start.x_m", "finite"]),
        (BASE + "law: {barrier: {k_cbf: .inf}}\n", ["law.barrier.k_cbf", "finite"]),
        ("name: b\nreference: {waypoints_m: [[0, 0]]}\n", ["waypoints_m", "at least 2"]),
        ("name: b\nreference: {waypoints_m: [[0, 0], [1, 0], [1, 0]]}\n", ["2 and 3", "same"]),
        (BASE + "obstacles: [{name: a, center_m: [1, 1], radius_m: -0.1}]\n", ["radius_m", ">= 0"]),
        (BASE + "obstacles: [{name: a, center_m: [0, 0], radius_m: 0.1}]\n", ["inside obstacle a"]),
        (BASE + "walls_m: [[-1, 0, 1, 0]]\n", ["inside the wall", "walls_m.0", "move one"]),
        (BASE + "simulation: {duration_s: 1e6, step_s: 1e-4}\n", ["GiB to hold", "shorten"]),
        (BASE + "simulation: {step_s: 1e-300}\n", ["GiB to hold", "raise step_s"]),
        (BASE + "stick: {kind: flie, path: x}\n", ["stick", "file"]),
        ("", ["the file is empty", "minimal"]),
        ("[1, 2]\n", ["not a scenario"]),
        ("[" * 3000, ["nested too deeply"]),
        (BASE + "name: c\n", ["given twice"]),
        (BASE + "\tx: 1\n", ["tab"]),
        ("\x00\x01", ["not a YAML text file"]),
        (BASE.replace("b\n", "''\n"), ["s.yaml:1", "name: must not be empty"]),
        (BASE.replace("b\n", "x" * 99 + "\n"), ["name: must have at most 80 characters, got 99"]),
    ],
)  # fmt: skip
def test_an_error_in_a_scenario_is_reported_with_its_line(cohelm, tmp_path, text, words):
    (tmp_path / "s.yaml").write_text(text)
    refused(cohelm("run", "s.yaml", "--json"), *words)
    assert not (tmp_path / "out").exists()


def test_a_drive_in_a_missing_scenario_is_not_started(cohelm):
    said = cohelm("drive", "lab-gard")
    refused(said, "lab-gard", "did you mean lab-guard?")
    assert "starting" not in said.err


@pytest.mark.parametrize("wanted", ["abc", "0.5", "inf,0", "0.5,nan", "1e999,0"])
def test_an_invalid_controller_twist_is_refused(cohelm, wanted):
    refused(cohelm("base", "--controller", wanted, "--for", "1"), wanted, "such as 0.5,0")


def test_the_robot_is_checked_before_asking_for_free_floor(cohelm):
    refused(cohelm("calibrate", "sally", "--driver", "nowhere"), "nowhere", "package:name")


@pytest.mark.parametrize(
    ("driver", "meant"),
    [("my_package.Cart", "my_package:Cart"), ("cart.py", "cart:NAME")],
)
def test_a_driver_that_is_named_as_python_does_is_named_as_here(cohelm, driver, meant):
    refused(cohelm("robot", "sally", "--driver", driver), f"did you mean {meant}?")


def test_a_file_whose_keys_are_almost_a_robots_is_refused_as_a_robots(cohelm, tmp_path):
    old = "name: cart\nfootprint: [[0.5, 0.3], [-0.2, 0.3], [-0.2, -0.3]]\ntrack: 0.5\nversion: 2\n"
    (tmp_path / "cart.yaml").write_text(old)
    said = cohelm("robot", "cart.yaml")
    refused(said, "cart.yaml:2", "footprint", "did you mean footprint_m (in m)?")
    assert "reference" not in said.err


def test_of_many_problems_the_first_are_reported_and_the_rest_counted(cohelm, tmp_path):
    wrong = ", ".join(f"{{name: o{i}, center_m: [1, 1], radius_m: -1}}" for i in range(500))
    (tmp_path / "s.yaml").write_text(f"{BASE}obstacles: [{wrong}]\n")
    said = cohelm("run", "s.yaml")
    refused(said, "obstacles.0.radius_m", "... and 480 more")
    assert len(said.err.splitlines()) == 21


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nowhere.yaml", ["nowhere.yaml: no such file", "minimal"]),
        ("lab-trak", ["did you mean lab-track?"]),
        ("minimal.yaml", ["did you mean the shipped scenario 'minimal'?"]),
        ("jackal", ["is a robot that comes with cohelm, not a scenario", "--set robot=jackal"]),
        (".", ["is a folder"]),
        ("sc\udcff.yaml", ["no such file"]),
    ],
)
def test_a_missing_scenario_is_reported_with_the_nearest_name(cohelm, name, words):
    refused(cohelm("run", name), *words)


@pytest.mark.parametrize("further", [[], ["--scenario", "lab-guard"], ["--driver", "carts:Cart"]])
@pytest.mark.parametrize(
    ("name", "word"),
    [("nowhere", "nowhere: no such file"), ("salli.yaml", "did you mean sally?")],
)
def test_a_missing_robot_is_reported_with_all_that_can_be_given(cohelm, name, word, further):
    said = cohelm("robot", name, *further)
    refused(said, word, "robots that come with cohelm: sally, ", "; scenarios that come with ")
    assert "or give the YAML file of either" in said.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("foo", ["write key.path=value"]),
        ("=3", ["write key.path=value"]),
        ("law..x=3", ["write key.path=value"]),
        ("law.barrier.k_cbf=", ["must be a number, got nothing"]),
        ("law.barrier.k_cbf=much", ["must be a number, got 'much'"]),
        ("law.barrier.k_cbf=[1", ["not valid YAML"]),
        ("law.barier.k_cbf=1", ["did you mean barrier?"]),
        ("obstacles.7.radius_m=1", ["has 1 items", "post"]),
        ("name.x=1", ["name is a value"]),
        ("name=b\udcff", ["not a YAML text file"]),
    ],
)
def test_an_override_that_can_not_be_applied_is_quoted_as_typed(cohelm, change, words):
    refused(cohelm("run", "minimal", "--set", change), "--set", *words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"t,x,psi\n0,0,0\n2,0.1,0\n1,0,0\n", ["s.csv:4", "1 s comes after 2 s", "sort"]),
        (b"t,x,psi\n0,0,0\n1,1.4,0\n", ["s.csv:3", "1.4 is beyond"]),
        (b"t,x,psi\n0,nan,0\n", ["s.csv:2", "finite"]),
        (b"t,x,psi\n0,hard,0\n", ["s.csv:2", "'hard'"]),
        (b"t,x\n0,0\n", ["no column psi", "t, x"]),
        (b"t,x,psi\n", ["header but no rows"]),
        (b"", ["is empty"]),
        (b"\xff\xfe\x00\x01", ["not a text file"]),
        (b"a" * 200_000, ["s.csv", "field larger than field limit", "holds numbers only"]),
        # mtime: the workers must find the same tests, and gzip writes down the second
        (gzip.compress(b"t,x,psi\n0,0,0\n", mtime=0)[:-9], ["damaged or cut short"]),
    ],
)
def test_a_stick_file_that_is_no_stick_is_refused_by_line_and_value(
    cohelm, tmp_path, content, words
):
    (tmp_path / "s.csv").write_bytes(content)
    refused(cohelm("run", "minimal", "--stick", "s.csv"), *words)


@pytest.mark.parametrize(
    "command",
    [("pair", "install"), ("station", "--robot", "sally", "--tls", "--tls-cert")],
    ids=["pairing", "certificate"],
)
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pipe", ["is a device or a pipe", "name a file"]),
        ("/dev/zero", ["is a device or a pipe", "name a file"]),
        ("nowhere.pem", ["can not be read", "No such file"]),
        (".", ["can not be read", "Is a directory"]),
    ],
)
def test_a_file_that_is_no_key_file_is_refused_without_waiting(
    cohelm, tmp_path, command, name, words
):
    os.mkfifo(tmp_path / "pipe")
    refused(cohelm(*command, name), name, *words)


def test_a_missing_stick_file_is_reported_with_the_nearest_name(cohelm, tmp_path):
    (tmp_path / "mine.csv").write_text("t,x,psi\n0,0,0\n")
    refused(cohelm("run", "minimal", "--stick", "mein.csv"), "no such", "did you mean mine.csv?")


@pytest.mark.parametrize("out", ["taken", "taken/below"])
def test_a_file_in_place_of_the_output_folder_is_reported(cohelm, tmp_path, out):
    (tmp_path / "taken").write_text("mine")
    refused(cohelm("run", "minimal", "--out", out), f"the folder {out} can not be made", "--out")
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize(
    "command",
    [
        ("run", "minimal", "--out"), ("reproduce", "--out"), ("replay",), ("map",),
        ("map", "r.mcap", "--out"), ("campaign", "random", "--out"), ("campaign", "barn", "--data"),
        ("calibrate", "sally", "--out"), ("station", "--replay"), ("robot", "--record"),
        ("drive", "--records"), ("drive", "--map"), ("drive", "--keep-out"), ("pair", "install"),
        ("drive", "--speed-zones"), ("station", "--tls-cert"), ("station", "--tls-key"),
        ("pair", "new", "a", "--out"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_an_empty_path_is_refused(cohelm, tmp_path, command):
    """As where a variable of the shell is empty: what lay here would be written over."""
    refused(cohelm(*command, ""), "name is empty", "or . for this folder")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words", [("map", "no.mcap"), ("reproduce",), ("calibrate", "sally", "--yes")]
)
def test_a_folder_that_another_command_writes_into_is_left_to_it(cohelm, words):
    with alone(Path("busy")):
        refused(cohelm(*words, "--out", "busy"), "busy: another cohelm writes there", "--out")
    assert not Path("busy").exists()  # nothing was written


def test_a_file_named_out_in_place_of_the_default_folder_is_reported(cohelm, tmp_path):
    (tmp_path / "out").write_text("mine")
    refused(cohelm("run", "minimal"), "the folder out can not be made", "--out")


def test_an_existing_record_is_reported_before_anything_starts(cohelm, tmp_path):
    (tmp_path / "r.mcap").write_text("mine")
    refused(cohelm("robot", "lab-guard", "--fast", "--record", "r.mcap"), "r.mcap exists already")
    refused(cohelm("robot", "lab-guard", "--fast", "--record", "."), "is a folder: name a file in")


def test_an_empty_robot_file_is_reported_with_the_robot_documentation(cohelm, tmp_path):
    (tmp_path / "r.yaml").touch()
    refused(cohelm("filter", "--robot", "r.yaml"), "the file is empty; see docs/robot-yaml.md")
    refused(cohelm("filter", "--robot", "sally", "--params", "r.yaml"), "r.yaml: the file is empty")


def test_a_file_in_place_of_the_records_folder_is_reported(cohelm, tmp_path):
    (tmp_path / "taken").write_text("mine")
    said = cohelm("robot", "lab-guard", "--fast", "--for", "1", "--record", "taken/r.mcap")
    assert said.code == 2
    assert "taken/r.mcap can not be made (Not a directory): choose a folder" in said.err


MAY_ALL = pytest.mark.skipif(os.geteuid() == 0, reason="root may read and write everything")


@MAY_ALL
@pytest.mark.parametrize("words", [("map", "no.mcap"), ("reproduce",), ("calibrate", "sally")])
def test_a_read_only_folder_is_reported_before_the_work(cohelm, tmp_path, words):
    (tmp_path / "shut").mkdir(mode=0o555)
    refused(cohelm(*words, "--out", "shut"), "shut can not be written", "--out")


@MAY_ALL
def test_what_is_in_a_closed_folder_is_not_said_to_be_unwritable_alone(cohelm, tmp_path):
    (tmp_path / "shut").mkdir(mode=0)
    said = cohelm("replay", "shut/x.mcap")
    assert said.code == 1
    assert "shut/x.mcap can not be read or written (Permission denied)" in said.err


def test_a_folder_that_was_removed_meanwhile_is_told_as_that(cohelm, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    said = cohelm("drive", "--kinematic", "--port", "0")
    monkeypatch.chdir(tmp_path)
    assert said.code == 1
    assert said.err.startswith("error: the folder that this was started in has been removed: go to")


@MAY_ALL
@pytest.mark.parametrize("out", ["shut", "shut/below"])
def test_a_read_only_folder_is_reported(cohelm, tmp_path, out):
    (tmp_path / "shut").mkdir(mode=0o555)
    refused(cohelm("run", "minimal", "--out", out), "can not be made (Permission denied)", "shut")


@pytest.mark.parametrize(
    "name", ["record.mcap", "scenario.yaml", "metrics.json", "run.png", "run.svg"]
)
def test_nothing_that_is_in_the_folder_already_is_overwritten(cohelm, tmp_path, name):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / name).write_text("mine")
    refused(cohelm("run", "minimal", "--out", "mine"), f"mine holds {name}", "--out")
    assert [file.name for file in (tmp_path / "mine").iterdir()] == [name]
    assert (tmp_path / "mine" / name).read_text() == "mine"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, ["can not be read", "check the name"]),
        (b"", ["no record of cohelm"]),
        (b"t,x,psi\n0,0,0\n", ["is not an MCAP file"]),
        (b"\x89MCAP0\r\n", ["no record of cohelm"]),
        (np.random.default_rng(0).bytes(5000), ["is not an MCAP file"]),
    ],
)
def test_a_file_that_is_no_record_is_not_replayed(cohelm, tmp_path, content, words):
    if content is not None:
        (tmp_path / "r.mcap").write_bytes(content)
    refused(cohelm("replay", "r.mcap", "--json"), "r.mcap", *words)


def test_a_folder_without_a_record_is_not_replayed(cohelm, tmp_path):
    refused(cohelm("replay", tmp_path), "record.mcap", "can not be read")


ROBOT = """
name: cart
footprint_m: [[0.5, 0.3], [-0.2, 0.3], [-0.2, -0.3], [0.5, -0.3]]
track_m: 0.5
wheel_radius_m: 0.1
"""


def test_a_robot_file_given_as_a_scenario_is_recognized_and_the_reverse(cohelm, tmp_path):
    (tmp_path / "cart.yaml").write_text(ROBOT)
    (tmp_path / "office.yaml").write_text(BASE)
    said = cohelm("run", "cart.yaml")
    refused(said, "cart.yaml describes a robot, not a scenario", "--set robot=cart.yaml")
    assert len(said.err.splitlines()) == 1
    refused(cohelm("filter", "--robot", "office.yaml"), "is a scenario, and does not describe a")


def test_a_map_given_as_a_scenario_or_a_robot_is_recognized(cohelm, tmp_path):
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    for command in (("run",), ("robot",), ("filter", "--robot")):
        said = cohelm(*command, "map.yaml")
        refused(said, "map.yaml is a map of map_server, not a", "cohelm map map.yaml")
        assert len(said.err.splitlines()) == 1


def test_a_robot_named_on_the_command_line_is_relative_to_the_working_folder(cohelm, tmp_path):
    """As the message above says it, with a scenario from anywhere."""
    (tmp_path / "cart.yaml").write_text(ROBOT.replace("0.1", "-0.1"))
    refused(cohelm("run", "minimal", "--set", "robot=cart.yaml"), "cart.yaml:5: wheel_radius_m")
    refused(cohelm("run", "minimal", "--set", "robot=card.yaml"), "did you mean cart.yaml?")
    away = tmp_path / "sites"
    away.mkdir()
    (away / "office.yaml").write_text(BASE)
    (away / "van.yaml").write_text(
        ROBOT.replace("0.5\n", "-0.5\n")
    )  # beside the scenario, as in it
    refused(cohelm("run", "sites/office.yaml", "--set", "robot=van.yaml"), "van.yaml:4: track_m")


def test_a_base_is_simulated_in_any_scenario_and_a_missing_one_is_named(cohelm):
    refused(cohelm("base", "lab-gard"), "lab-gard: no such file", "did you mean lab-guard?")
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    said = cohelm("base", "lab-track", "--for", "0.1", "--json")
    assert said.code == 0, said.err


@pytest.mark.parametrize("text", ["[1, 2]", "5"])
def test_a_site_that_is_no_scenario_is_named_whatever_robot_drives_there(cohelm, tmp_path, text):
    (tmp_path / "s.yaml").write_text(text)
    refused(cohelm("robot", "sally", "--scenario", "s.yaml"), "s.yaml:1: needs keys of its own")


def test_an_option_that_was_mistyped_is_offered_and_no_other(cohelm):
    refused(cohelm("run", "minimal", "--otu", "x"), "no such option: --otu; did you mean --out?")
    said = cohelm("stick", "evdev", "--station", "x")
    refused(said, "no such option: --station; see `cohelm stick --help`")


def test_a_link_that_leads_nowhere_is_no_file(cohelm, tmp_path):
    (tmp_path / "lost.yaml").symlink_to("nowhere.yaml")
    said = cohelm("run", "lost.yaml")
    refused(said, "lost.yaml: no such file")
    assert "did you mean lost.yaml" not in said.err


def test_a_name_that_no_file_can_have_is_not_said_to_be_unwritable(cohelm):
    said = cohelm("robot", "x" * 300)
    refused(said, "can not be read (File name too long)")


@pytest.mark.parametrize(
    ("words", "mend"),
    [
        (("station", "--robot", "a", "--replay", "r.mcap"), "leave one of them out"),
        (("stick", "--trial"), "name it with --device brunner://HOST"),
    ],
)
def test_two_that_contradict_and_one_that_is_missing_are_named(cohelm, words, mend):
    refused(cohelm(*words), mend)


BESIDE = "has no effect beside"
WITHOUT = "has no effect without"


@pytest.mark.parametrize(
    ("words", "idle"),
    [
        (("stick", "--list", "--drive"), f"--drive {BESIDE} --list"),
        (("stick", "--list", "--device", "s.csv", "--trial"), "--device and --trial have no"),
        (("stick", "--drive", "--name", "sally"), f"--name {BESIDE} --drive"),
        (("stick", "--drive", "--strongest", "20"), f"--strongest {WITHOUT} --trial"),
        (("stick", "--trial", "--device", "brunner://a", "--k-s", "5"), f"--k-s {BESIDE} --trial"),
        (("stick", "--trial", "--device", "brunner://a", "--drive"), f"--drive {BESIDE} --trial"),
        (("station", "--replay", "r.mcap", "--name", "sally"), f"--name {BESIDE} --replay"),
        (("drive", "sally", "--driver", "x:Y", "--twin"), f"--twin {BESIDE} --driver"),
        (("drive", "sally", "--ros2", "--kinematic"), f"--kinematic {BESIDE} --ros2"),
        (("robot", "--driver", "x:Y", "--kinematic"), f"--kinematic {BESIDE} --driver"),
        (("calibrate", "sally", "--driver", "x:Y", "--scenario", "open"), f"--scenario {BESIDE}"),
        (("robot", "--pictures", "9"), f"--pictures {WITHOUT} --record, --listen or --fox"),
        (("filter", "--robot", "sally", "--json"), f"--json {WITHOUT} --print-config"),
        (("map", "folder", "--scan-topic", "/scan"), "--scan-topic, --odom-topic and --robot are"),
        (("campaign", "folder", "--replay", "1", "--jobs", "2"), f"--jobs {BESIDE} --replay"),
        (("campaign", "random", "--cluster", "a:1", "--jobs", "2"), f"--jobs {BESIDE} --cluster"),
    ],
)  # fmt: skip
def test_no_option_is_passed_over_in_silence(cohelm, tmp_path, words, idle):
    (tmp_path / "folder").mkdir()
    said = cohelm(*words)
    refused(said, idle)
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("wrong", ["footprint", "footprint_mm"])
def test_a_mistyped_key_of_a_robot_file_is_named(cohelm, tmp_path, wrong):
    (tmp_path / "cart.yaml").write_text(ROBOT.replace("footprint_m", wrong))
    said = cohelm("robot", "cart.yaml")
    refused(said, f"cart.yaml:3: {wrong}: unknown key; did you mean footprint_m")
    assert "reference" not in said.err
    refused(cohelm("run", "cart.yaml"), "cart.yaml describes a robot, not a scenario")


def test_a_robot_file_is_driven_from_the_browser_in_the_given_scenario(cohelm, tmp_path):
    """As `cohelm robot` takes it; refused here only for what stands in it."""
    (tmp_path / "cart.yaml").write_text(ROBOT.replace("0.1", "-0.1"))
    said = cohelm("drive", "cart.yaml")
    refused(said, "cart.yaml:5: wheel_radius_m: must be > 0")
    (tmp_path / "cart.yaml").write_text(ROBOT)
    refused(cohelm("drive", "cart.yaml", "--scenario", "lab-gard"), "did you mean lab-guard?")


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--joy", "/joy", "--listen", "127.0.0.1"), "leave out --joy"),
        (("--joy-param", "enable_button=1"), "name that with --joy /joy"),
        (("--joy", "/joy", "--joy-param", "enable=1"), "did you mean enable_button"),
    ],
)
def test_an_unusable_joystick_topic_is_reported(cohelm, options, why):
    refused(cohelm("robot", "lab-guard", *options), why)


@pytest.mark.parametrize("option", ["--goals-from", "--initial-pose-from", "--joy", "--masks-from"])
def test_an_invalid_topic_name_is_reported_before_discovery(cohelm, option):
    refused(cohelm("robot", "lab-guard", "--ros2", option, "bad name"), "is no name of a topic")


@pytest.mark.parametrize(
    ("environment", "options", "why"),
    [
        ({}, ("--in", "/cmd_vel"), "--in and --out are both /cmd_vel"),
        ({"ROS_DOMAIN_ID": "abc"}, (), "ROS_DOMAIN_ID must be a number from 0 to 232"),
        ({"ROS_DISTRO": "foxy"}, (), "ROS_DISTRO is 'foxy', and there are humble"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "HOME"}, (), "RANGE is 'HOME', and there are SUBNET"),
    ],
)
def test_unusable_filter_topics_are_reported(cohelm, monkeypatch, environment, options, why):
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    refused(cohelm("filter", "--robot", "sally", *options), why)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--map", "no.yaml"), "no.yaml"),
        (("--map", "text.yaml"), "text.yaml: has no keys such as image and resolution"),
        (("--map", "office.yaml"), "office.yaml: has no keys such as image and resolution: give a"),
        (("--records", "text.yaml"), "text.yaml is no folder: choose another with --records"),
        (("--keep-out", "no.yaml"), "no.yaml"),
        (("--speed-zones", "no.yaml"), "no.yaml"),
        (("--set", "robot=nobody"), "no robot is called 'nobody'"),
        (("--topic", "scan=/front"), "add --ros2"),
        (("--url", "ws://robot:8765"), "add --ros2"),
        (("--masks-from", "/costmap_filter_info"), "add --ros2"),
        (("--lock-timeout", "1"), "add --ros2"),
    ],
)
def test_unusable_options_of_a_drive_are_reported_before_anything_starts(
    cohelm, tmp_path, options, why
):
    (tmp_path / "text.yaml").write_text("a" * 9999)
    (tmp_path / "office.yaml").write_text("name: office\nreference: {speed_mps: 0.3}\n")
    refused(cohelm("drive", "lab-guard", *options), why)


@pytest.mark.parametrize("option", [("--print-config",), ("--lock-timeout", "1")])
def test_options_of_ros_2_robots_are_refused_for_other_robots(cohelm, option):
    refused(cohelm("robot", "lab-guard", *option), "of a ROS 2 robot: add --ros2")


def test_ros_arguments_are_refused_with_the_matching_option(cohelm):
    said = cohelm("filter", "--robot", "sally", "--ros-args", "-r", "cmd_vel_nav:=/nav/cmd_vel")
    assert said.code == 2
    assert "--ros-args: cohelm is no node of rclpy: name topics with --in, --out" in said.err


@pytest.mark.parametrize(
    ("words", "mend"),
    [
        (["campaign", "random", "--n", "nan"], "invalid value for '--n': must be a valid integer"),
        (["drive", "--port", "-1"], "'--port': must be greater than or equal to 0"),
        (["run"], "missing argument 'SCENARIO'"),
        (["run", "minimal", "more"], "unexpected extra argument(s) (more): the folder to write"),
        (["robot", "cart.yaml", "office.yaml"], "(office.yaml): where it is driven is --scenario"),
        (["campaign", "random", "4"], "(4): the number of episodes is --n N; see"),
        (["run", "minimal", "--bogus"], "no such option: --bogus"),
        (["run", "minimal", "--robot", "husky"], "--robot: here that is --set robot=VALUE; see"),
        (["robot", "--seconds", "5"], "--seconds: here that is --for SECONDS; see"),
        (["run", "minimal", "--for", "5"], "is --set simulation.duration_s=SECONDS; see"),
        (["drive", "--seconds", "5"], "here that is Ctrl-C, or --for of `cohelm robot`; see"),
        (["nonsense"], "no such command 'nonsense'"),
        (["stick", "--strongest"], "option '--strongest' requires an argument; see `cohelm stick"),
        (["robot", "lab-guard", "--rate"], "option '--rate' requires an argument; see `cohelm"),
    ],
)
def test_a_wrong_command_line_is_one_sentence_that_names_the_help(cohelm, words, mend):
    said = cohelm(*words)
    refused(said, mend, "--help`")
    assert said.err.count("\n") == 1


def test_the_scenario_option_is_refused_beside_a_scenario(cohelm):
    refused(
        cohelm("drive", "dock", "--scenario", "minimal"), "dock is none: give minimal in its place"
    )


@pytest.mark.parametrize("laws", [",", "guard,,paper", " "])
def test_an_empty_law_name_is_refused(cohelm, laws):
    refused(cohelm("campaign", "random", "--n", "1", "--compare", laws), "name each law")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("robot", ""), "ROBOT|SCENARIO"), (("robot", "sally", "--scenario", ""), "--scenario"),
        (("robot", "sally", "--driver", "x:Y", "--scenario", ""), "--scenario"),
        (("robot", "--mode", ""), "--mode"), (("robot", "dock", "--dock="), "--dock"),
        (("robot", "--joy", ""), "--joy"), (("robot", "--reset-from", ""), "--reset-from"),
        (("robot", "--initial-pose-from", ""), "--initial-pose-from"),
        (("robot", "--goals-from", "/goal", "--goals-from", ""), "--goals-from"),
        (("robot", "--set", ""), "--set"), (("robot", "--url", ""), "--url"),
        (("drive", ""), "ROBOT|SCENARIO"), (("drive", "--scenario", ""), "--scenario"),
        (("base", "--scenario", ""), "--scenario"), (("base", "--controller", ""), "--controller"),
        (("calibrate", "sally", "--scenario", ""), "--scenario"),
        (("campaign", "random", "--law", ""), "--law"), (("filter", "--robot", ""), "--robot"),
        (("filter", "--robot", "sally", "--out", ""), "--out"),
        (("station", "--robot", ""), "--robot"), (("stick", "--device", ""), "--device"),
        (("pair", "new", ""), "NAME"), (("pair", "new", "a", "--robot", ""), "--robot"),
    ],
)  # fmt: skip
def test_an_empty_value_is_no_default(cohelm, words, name):
    """As where a variable of the shell is not set: by default a robot may set off."""
    refused(cohelm(*words), f"{name} is empty: name one")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("run", "a\nb"), "SCENARIO"), (("robot", "--record", "a\nb"), "--record"),
        (("campaign", "random", "--law", "a\nb"), "--law"),
    ],
)  # fmt: skip
def test_a_value_of_several_lines_is_one_error(cohelm, words, name):
    """As the output of a command that was not one name."""
    said = cohelm(*words)
    refused(said, f"{name} has a line break in it")
    assert said.err.count("error:") == 1


def test_an_empty_value_in_a_parameter_file_is_no_default(cohelm, tmp_path):
    (tmp_path / "p.yaml").write_text("cohelm_filter: {ros__parameters: {scan: '', robot: sally}}")
    refused(cohelm("filter", "--params", "p.yaml"), "--scan is empty")


def test_an_empty_mcap_file_is_not_read_as_a_carmen_log(cohelm, tmp_path):
    (tmp_path / "empty.mcap").touch()
    refused(cohelm("map", "empty.mcap"), "is not an MCAP file")


def test_a_maps_picture_in_place_of_its_yaml_is_told_so(cohelm, tmp_path):
    (tmp_path / "office.PNG").write_bytes(b"\x89PNG\r\n\x1a\n")
    refused(cohelm("map", "office.PNG"), "is a picture: give the YAML file that goes with it")


def test_a_cluster_without_a_port_is_refused_in_one_sentence(cohelm):
    said = cohelm("campaign", "random", "--n", "1", "--cluster", "nothing")
    refused(said, "missing port number")
    assert said.err.count("\n") == 1


def test_without_confirmation_nothing_is_calibrated(cohelm, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    said = cohelm("calibrate", "sally")
    assert said.code == 2
    assert "error: nothing was driven" in said.err
