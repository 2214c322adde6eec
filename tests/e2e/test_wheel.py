"""What is installed elsewhere runs there, with all it needs: no checkout, no tools of ours."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UV = shutil.which("uv") or str(ROOT / ".venv" / "bin" / "uv")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path(UV).exists(), reason="uv is not installed"),
]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The command, from a wheel in an environment of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    for command in (
        ("build", "--quiet", "--wheel", "--out-dir", folder / "dist", ROOT),
        ("venv", "--quiet", folder / "env"),
    ):
        subprocess.run((UV, *command), check=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    python = folder / "env" / "bin" / "python"
    subprocess.run((UV, "pip", "install", "--quiet", "--python", python, wheel), check=True)
    return folder / "env" / "bin" / "cohelm"


@pytest.mark.parametrize("scenario", ["minimal", "lab-track", "lab-avoid", "lab-shared"])
def test_every_shipped_scenario_runs_from_an_empty_folder(installed, tmp_path, scenario):
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    command = (installed, "run", scenario, "--json")
    said = subprocess.run(command, cwd=tmp_path, env=clean, capture_output=True, text=True)
    assert (said.returncode, said.stderr) == (0, "")
    assert json.loads(said.stdout)["scenario"] == scenario
    (folder,) = (tmp_path / "out").iterdir()
    assert (folder / "record.mcap").exists()


def test_the_version_and_the_schema_are_those_of_the_checkout(installed, tmp_path):
    said = [
        subprocess.run((installed, word), cwd=tmp_path, capture_output=True, text=True, check=True)
        for word in ("--version", "schema")
    ]
    assert said[0].stdout.startswith("cohelm ")
    schema = ROOT / "scenarios" / "scenario.schema.json"
    assert said[1].stdout == schema.read_text(encoding="utf-8")
