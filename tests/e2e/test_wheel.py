"""What is installed elsewhere runs there, with all it needs: no checkout, no tools of ours.

`make package` runs all of it, also with a wheel built as from a fresh clone, without the pages that
`make` left here, and every scenario. CI takes those pages, and what this tree has compiled.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.few import first

ROOT = Path(__file__).parents[2]
SCENARIOS = (ROOT / "scenarios").glob("*.yaml")
UV = shutil.which("uv") or str(ROOT / ".venv" / "bin" / "uv")
CLEAN = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}

pytestmark = [
    pytest.mark.xdist_group("wheel"),  # built once
    pytest.mark.skipif(not Path(UV).exists(), reason="uv is not installed"),
]


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> Path:
    """What git would hand out: no pages, no environment."""
    folder = tmp_path_factory.mktemp("clone")
    listing = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    names = subprocess.run(listing, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder


def built(clone: Path, dist: Path) -> Path:
    subprocess.run((UV, "build", "--quiet", "--wheel", "--out-dir", dist, clone), check=True)
    (made,) = dist.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(clone, tmp_path_factory) -> Iterator[Path]:
    """The command, from a wheel in an environment of its own: what it depends on, as locked, and no
    extra. Its 900 MB are removed at once: pytest would keep those of three runs, and remove the
    fourth when all tests have ended."""
    folder = tmp_path_factory.mktemp("wheel")
    with_pages = shutil.copytree(clone, folder / "clone")
    pages = Path("src/cohelm/station/static")
    if (ROOT / pages).is_dir():
        shutil.copytree(ROOT / pages, with_pages / pages, dirs_exist_ok=True)
    wheel = built(with_pages, folder / "dist")
    environment = folder / "env"
    python = environment / "bin" / "python"
    locked = (UV, "sync", "--quiet", "--frozen", "--no-dev", "--no-install-project")
    subprocess.run(
        (*locked, "--project", clone, "--python", sys.executable), check=True,
        env=CLEAN | {"UV_PROJECT_ENVIRONMENT": str(environment)},
    )  # fmt: skip
    install = (UV, "pip", "install", "--quiet", "--no-deps", "--python", python, wheel)
    subprocess.run(install, check=True)
    subprocess.run((UV, "pip", "check", "--quiet", "--python", python), check=True)
    yield environment / "bin" / "cohelm"
    subprocess.run(("rm", "-rf", folder), check=True)  # takes a third of what Python does


@pytest.mark.slow
def test_a_wheel_from_a_clean_checkout_holds_the_pages_and_not_their_sources(clone, tmp_path):
    names = zipfile.ZipFile(built(clone, tmp_path)).namelist()
    assert "cohelm/station/static/index.html" in names
    assert any(name.startswith("cohelm/station/static/assets/") for name in names)
    assert not [name for name in names if name.startswith("cohelm/station/web/")]


@pytest.mark.slow
def test_without_node_no_wheel_is_made_and_the_missing_tool_is_named(clone, tmp_path):
    shutil.copytree(clone, tmp_path / "clone", ignore=shutil.ignore_patterns("static"))
    broken = tmp_path / "bin"
    broken.mkdir()
    for name in ("node", "npm"):
        (broken / name).write_text("#!/bin/sh\nexit 1\n")
        (broken / name).chmod(0o755)
    said = subprocess.run(
        (UV, "build", "--wheel", "--out-dir", tmp_path / "dist", tmp_path / "clone"),
        env={**CLEAN, "PATH": f"{broken}:{CLEAN['PATH']}"}, capture_output=True, text=True,
    )  # fmt: skip
    assert said.returncode != 0
    assert "the operator's pages can not be made" in said.stderr
    assert "no Node.js 20.19 or newer is here" in said.stderr
    assert not list((tmp_path / "dist").glob("*.whl"))


@pytest.mark.parametrize(
    "scenario", first(sorted((path.stem for path in SCENARIOS), key=lambda name: name != "minimal"))
)
def test_every_shipped_scenario_runs_from_an_empty_folder(installed, tmp_path, scenario):
    command = (installed, "run", scenario, "--json")
    said = subprocess.run(command, cwd=tmp_path, env=CLEAN, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert all(line.startswith("warning: ") for line in said.stderr.splitlines())
    assert json.loads(said.stdout)["scenario"] == scenario
    (folder,) = (tmp_path / "out").iterdir()
    assert (folder / "record.mcap").exists()


@pytest.mark.slow  # no file of the package is left out: below
def test_the_version_and_the_schema_are_those_of_the_checkout(installed, tmp_path):
    said = [
        subprocess.run((installed, word), cwd=tmp_path, capture_output=True, text=True, check=True)
        for word in ("--version", "schema")
    ]
    assert said[0].stdout.startswith("cohelm ")
    schema = ROOT / "scenarios" / "scenario.schema.json"
    assert said[1].stdout == schema.read_text(encoding="utf-8")


def test_drive_answers_with_the_page_starts_the_robot_and_ends_on_ctrl_c(installed, tmp_path):
    drive = subprocess.Popen(
        (installed, "drive", "--port", "0"), cwd=tmp_path, text=True, env=CLEAN,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert drive.stdout is not None
    try:
        address = drive.stdout.readline().strip()
        assert address.startswith("http://"), drive.communicate()
        with urllib.request.urlopen(address, timeout=60.0) as answer:
            assert b"<title>" in answer.read()
        assert drive.stderr is not None
        said = ""
        while "the robot is ready" not in said:  # moves on as long as something is compiled
            line = drive.stderr.readline()
            assert line, said
            said += line
    finally:
        drive.send_signal(signal.SIGINT)
        _, err = drive.communicate(timeout=120)
    assert "Traceback" not in said + err
    assert drive.returncode in (0, 130)


@pytest.mark.slow  # `drive`, above, starts the twin too
def test_robot_drives_the_twin(installed, tmp_path):
    said = subprocess.run(
        (installed, "robot", "lab-guard", "--twin", "--fast", "--for", "1", "--json"),
        cwd=tmp_path, env=CLEAN, capture_output=True, text=True,
    )  # fmt: skip
    assert said.returncode == 0, said.stderr
    assert json.loads(said.stdout)["kind"] == "twin"


def test_no_file_of_the_package_is_left_out(clone, installed):
    (package,) = installed.parents[1].glob("lib/python*/site-packages/cohelm")
    here, there = (
        {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
        for folder in (clone / "src" / "cohelm", package)
    )
    assert {name for name in here - there if not name.startswith("station/web/")} == set()


@pytest.mark.slow  # all its files are in the wheel; what it does: tests/study/test_reproduce.py
def test_the_paper_is_reproduced(installed, tmp_path):
    said = subprocess.run(
        (installed, "reproduce", "--json"), cwd=tmp_path, env=CLEAN, capture_output=True, text=True
    )
    assert (said.returncode, said.stderr) == (0, "")
    assert len(list((tmp_path / "out" / "reproduce").glob("*.png"))) >= 6


@pytest.mark.slow  # what is said: tests/core/test_extras.py
@pytest.mark.parametrize(
    ("command", "package"),
    [
        (("map", "drive.log"), "gtsam"),
        (("campaign", "lab", "--n", "1"), "pyarrow"),
        (("stick", "--list"), "pygame-ce"),
    ],
)
def test_a_feature_whose_extra_is_missing_names_what_to_install(
    installed, tmp_path, command, package
):
    (tmp_path / "drive.log").write_text(
        "".join(
            f"ODOM {k * 0.1} 0 0 0 0 0 {k} h {k}\nFLASER 180 {'2.0 ' * 180}0 0 0 0 0 0 {k} h {k}\n"
            for k in range(60)
        )
    )
    said = subprocess.run(
        (installed, *command), cwd=tmp_path, env=CLEAN, capture_output=True, text=True
    )
    assert said.returncode == 2
    assert said.stderr.startswith("error: "), said.stderr
    assert said.stderr.count("\n") == 1
    assert "needs what is not installed here: pip install '" in said.stderr
    assert package in said.stderr
