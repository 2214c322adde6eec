"""The units in docs/deploy.md are units, and the commands in them are ones that cohelm takes."""

import configparser
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import typer

from cohelm.cli import app

PAGE = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text(encoding="utf-8")
UNITS = re.findall(r"```ini\n(.*?)```", PAGE, re.S)


def exec_start(unit: str) -> str:
    return re.findall(r"^ExecStart=(.*)$", unit, re.M)[0]


def service(unit: str) -> configparser.SectionProxy:
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(unit)
    return parser["Service"]


def test_there_are_two_units():
    assert len(UNITS) == 2


@pytest.mark.parametrize("unit", UNITS, ids=["filter", "robot"])
def test_the_command_of_a_unit_is_one_that_cohelm_takes(unit):
    line = exec_start(unit)
    if line.startswith("/bin/sh -c "):  # as systemd and then the shell read it
        boot = "6f0e8c39a2f04b3a9f6f5b3f1c0a7d21"
        script = shlex.split(line.replace("%b", boot).replace("%%", "%").replace("$$", "$"))[2]
        ran = subprocess.run(
            ["/bin/sh", "-c", script.replace("exec ", "echo ", 1)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        line = ran.stdout
        named = rf"--record /var/lib/cohelm/records/\d{{4}}-\d\d-\d\d-\d{{6}}-{boot}\.mcap$"
        assert re.search(named, line.strip())
    program, name, *words = shlex.split(line)
    assert program == "/opt/cohelm/bin/cohelm"
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    command.make_context(name, words)


def test_the_compiled_code_is_kept_where_the_service_may_write():
    unit = service(UNITS[0])
    assert unit["ProtectSystem"] == "strict"
    assert "COHELM_CACHE_DIR=/var/cache/" + unit["CacheDirectory"] in UNITS[0]
    robot = service(UNITS[1])
    state, records = ("/var/lib/" + one for one in robot["StateDirectory"].split())
    assert f"COHELM_KEYS={state}/" in UNITS[1]
    assert f"--record {records}/" in exec_start(UNITS[1])
    assert re.search(rf"^e {records} 0750 cohelm cohelm \d+d$", PAGE, re.M)  # old ones go


def test_the_service_has_no_right_but_the_one_it_needs_and_compiles():
    unit = service(UNITS[0])
    assert unit["AmbientCapabilities"] == unit["CapabilityBoundingSet"] == "CAP_SYS_NICE"
    assert not {"MemoryDenyWriteExecute", "RestrictRealtime", "PrivateNetwork"} & set(unit)


def test_what_may_have_driven_is_not_started_again_by_itself():
    """A restart forgets a latched stop, and a controller may still command."""
    assert service(UNITS[0])["Restart"] == "no"
    assert "Restart=" not in UNITS[1]


@pytest.mark.parametrize("second", [False, True], ids=["filter", "robot"])
def test_systemd_takes_the_unit(tmp_path, second):
    systemd = shutil.which("systemd-analyze")
    if systemd is None:
        pytest.skip("no systemd here; Debian: apt-get install systemd")
    unit = UNITS[0]
    if second:  # the first one with the lines of the second
        unit = re.sub(r"^ExecStart=.*\n", "", unit, count=1, flags=re.M)
        unit = unit.replace("[Service]\n", UNITS[1], 1)
    true = shutil.which("true") or "/bin/true"
    path = tmp_path / "cohelm-filter.service"
    path.write_text(unit.replace("/opt/cohelm/bin/cohelm", true))
    ran = subprocess.run([systemd, "verify", str(path)], capture_output=True, text=True)
    ours = [line for line in ran.stderr.splitlines() if "cohelm" in line]
    assert not ours, ran.stderr
