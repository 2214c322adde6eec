"""`cohelm robot` as a process: over the link, and conflicting options."""

import json
import os
import socket
import subprocess
import sys
import time

import pytest

from cohelm.link import keys
from cohelm.link.station_end import StationEnd
from tests.few import first


def test_a_paired_station_connects_to_a_listening_robot(tmp_path, monkeypatch):
    """From `cohelm pair new` to telemetry, with nothing but what the commands do."""
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    keys.pair("anna", tmp_path / "anna.pair")
    keys.install(tmp_path / "anna.pair")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "cohelm", "robot", "--listen", f"127.0.0.1:{port}"]
    with subprocess.Popen(
        [*command, "--for", "150", "--json"], cwd=tmp_path, env=os.environ | {"NO_COLOR": "1"},
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as robot:  # fmt: skip
        try:
            assert any("listening on" in line for line in robot.stderr)
            with StationEnd(keys.station(), "127.0.0.1", port) as station:
                until = time.monotonic() + 120.0  # its code may have to be compiled first
                while station.status() is None:
                    assert time.monotonic() < until, "no telemetry"
                    time.sleep(0.05)
        finally:
            robot.terminate()
        robot.communicate(timeout=30.0)


@pytest.mark.slow  # a whole drive, of which only the start is its own
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", "<&-", ">&-"])
def test_it_drives_where_standard_streams_are_closed(closed):
    """As a script or a service may: no socket takes the number of one, and what is printed."""
    drive = f"exec {sys.executable} -m cohelm robot lab-guard --for 1 {closed}"
    done = subprocess.run(["sh", "-c", drive], capture_output=True, text=True, timeout=150.0)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr


def test_mode_options_are_refused_with_listen(cohelm):
    said = cohelm("robot", "--listen", "127.0.0.1", "--arrive")
    assert said.code == 2
    assert "leave out --mode, --dock, --arrive and --fast" in said.err


def test_an_unknown_mode_is_refused_before_anything_starts(cohelm):
    said = cohelm("robot", "--mode", "fly")
    assert said.code == 2
    assert "there is no mode 'fly'" in said.err
    assert "starting" not in said.err


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--goals-from", "/goal"), "are of a ROS 2 robot: add --ros2"),
        (("--no-tf",), "are of a ROS 2 robot: add --ros2"),
        (("--dock", "nowhere"), "no dock is called 'nowhere'"),
        (("--mode", "hold", "--arrive"), "in hold mode the robot stands, and does not arrive"),
        (("--listen", "127.0.0.1:x"), "'127.0.0.1:x' is no HOST[:PORT]"),
    ],
)
def test_what_can_be_seen_to_be_wrong_is_refused_before_anything_starts(
    cohelm, monkeypatch, tmp_path, options, why
):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    said = cohelm("robot", "lab-guard", *options)
    assert said.code == 2
    assert why in said.err
    assert said.err.count("\n") == 1, said.err


def test_simulation_options_are_refused_for_a_custom_robot(cohelm):
    said = cohelm("robot", "--driver", "tests.api.carts:Cart", "--fast")
    assert said.code == 2
    assert "with --driver nothing is simulated" in said.err


@pytest.mark.parametrize("command", ["robot", "drive", "calibrate"])
def test_a_custom_robot_is_no_ros_2_robot_too(cohelm, command):
    said = cohelm(command, "sally", "--driver", "tests.api.carts:Cart", "--ros2")
    assert said.code == 2
    assert "--driver and --ros2 each name a robot: leave one of them out" in said.err
    assert "starting" not in said.err


def test_a_missing_custom_robot_is_reported(cohelm):
    said = cohelm("robot", "sally", "--driver", "no_such_package:Cart")
    assert said.code == 2
    assert "no_such_package:Cart can not be imported" in said.err


@pytest.mark.parametrize("named", ["tests/api/carts.py:Cart", "./carts:Cart", "carts.py:Cart"])
def test_a_file_in_a_modules_place_is_refused_with_the_modules_name(cohelm, named):
    said = cohelm("robot", "sally", "--driver", named)
    assert said.code == 2
    assert "a module has no path and no .py: give carts:Cart" in said.err


@pytest.mark.parametrize("command", ["robot", "drive"])
@pytest.mark.parametrize("driver", [[], ["--driver", "tests.api.carts:Cart"]])
def test_of_two_robots_none_is_driven(cohelm, command, driver):
    said = cohelm(command, "sally", *driver, "--set", "robot=jackal")
    assert said.code == 2
    assert "sally and --set robot=... each name a robot: leave one of them out" in said.err


@pytest.mark.parametrize("named", first([["sally"], []]))
def test_a_custom_robot_without_a_site_stands(cohelm, named):
    said = cohelm("robot", *named, "--driver", "tests.api.carts:Simulated", "--for", "2", "--json")
    assert said.code == 0, said.err
    assert "no --scenario: it stands, and follows no route. Name its site" in said.err
    assert "no --map or walls to localize on: it uses its odometry" in said.err
    assert json.loads(said.out)["least_clearance_moving_m"] is None


def test_what_a_custom_robot_prints_is_no_result(cohelm):
    said = cohelm("robot", "--driver", "tests.api.carts:Talking", "--for", "1", "--json")
    assert said.code == 0, said.err
    assert "\nstop\n" in said.err
    assert json.loads(said.out)["reason"] == "the drive is over"


def test_an_invalid_address_of_the_live_view_starts_nothing(cohelm):
    said = cohelm("robot", "--foxglove", "host:port")
    assert said.code == 2
    assert "'host:port' is no HOST[:PORT]" in said.err
    assert "starting" not in said.err


def test_a_filter_that_no_drive_has_is_not_passed_over_in_silence(cohelm):
    """As somebody asks for who compares filters; a run has it."""
    said = cohelm("robot", "lab-track", "--fast", "--for", "0.5", "--json")
    assert said.code == 0, said.err
    assert "guarded all the same, though law.filter is none" in said.err
    said = cohelm("robot", "lab-guard", "--fast", "--for", "0.5", "--json")
    assert "law.filter" not in said.err


def test_without_map_and_walls_the_robot_uses_its_odometry(cohelm, tmp_path):
    """As the first drive through a building has to, of which there is no map yet."""
    (tmp_path / "bare.yaml").write_text(
        "name: bare\nreference: {speed_mps: 0.5, waypoints_m: [[0, 0], [4, 0]]}\n"
    )
    said = cohelm("robot", "bare.yaml", "--fast", "--for", "2", "--json")
    assert said.code == 0, said.err
    assert "no --map or walls to localize on: it uses its odometry" in said.err
    assert json.loads(said.out)["lost_share"] is None
