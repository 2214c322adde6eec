"""`cohelm pair`."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from cohelm.cli import app


@pytest.fixture
def on(tmp_path, monkeypatch):
    """Run a command on a machine of this name."""
    monkeypatch.chdir(tmp_path)

    def run(machine: str, *arguments: str):
        monkeypatch.setenv("COHELM_KEYS", str(tmp_path / machine))
        return CliRunner().invoke(app, ["pair", *arguments], catch_exceptions=True)

    return run


def test_a_station_is_paired_listed_and_removed(on, tmp_path):
    made = on("robot", "new", "anna", "--robot", "sally")
    assert made.exit_code == 0, made.output
    assert "cohelm pair install anna.pair" in made.stdout
    there = on("station", "install", str(tmp_path / "anna.pair"))
    assert there.exit_code == 0, there.output
    assert "--name sally" in there.stdout
    robot = json.loads(on("robot", "list", "--json").stdout)["pairs"]
    station = json.loads(on("station", "list", "--json").stdout)["pairs"]
    assert [(p["what"], p["name"]) for p in robot] == [("station let in", "anna")]
    assert [(p["what"], p["name"]) for p in station] == [("robot", "sally")]
    assert station[0]["sha256"] in there.stderr
    shown = on("robot", "list").stdout.splitlines()  # eighty columns wide here
    assert [line.split() for line in shown[1:]] == [
        ["station", "let", "in", "anna", robot[0]["sha256"]]
    ]  # on one line, to be compared and copied whole
    assert on("robot", "remove", "anna").exit_code == 0
    assert json.loads(on("robot", "list", "--json").stdout) == {"pairs": []}
    assert "nothing is paired here" in on("robot", "list").stderr
