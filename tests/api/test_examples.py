"""Every example runs as it stands, is short, and is shown in the documentation."""

import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import cohelm
from cohelm.drive.factory import own_robot
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs an example as a script, in this process, which has imported what it needs."""

    def call(name: str, *args: str) -> str:
        path = str(ROOT / "examples" / name)
        monkeypatch.setattr(sys, "argv", [path, *args])
        with warnings.catch_warnings(action="default"):
            runpy.run_path(path, run_name="__main__")
        return capsys.readouterr().out

    return call


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_no_example_is_long_or_left_out_of_the_documentation(path):
    assert len(path.read_text().splitlines()) <= 60
    assert f"examples/{path.name}" in (ROOT / "docs" / "api.md").read_text()


def test_the_filter_stops_an_external_cart_before_the_wall(run):
    said = run("safety_filter.py")
    centimetres = int(said.split("the bow stands ")[1].split(" cm")[0])
    assert 3 <= centimetres <= 15


def test_the_same_law_touches_without_the_filter_and_not_with_it(run):
    field, filtered = run("own_law.py").splitlines()
    assert not field.startswith("potential_field: 0 contacts")
    assert filtered.startswith("filtered: 0 contacts")


def test_a_hundred_runs_are_made_in_parallel():
    """Its workers import the script, so it runs as one."""
    script = [sys.executable, str(ROOT / "examples" / "hundred_runs.py"), "2"]
    done = subprocess.run(script, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 5


def test_a_scenario_is_built_in_python(run):
    lines = run("custom_scenario.py").splitlines()
    assert ["not through" in line for line in lines] == [True, False, False]
    assert all("0 contacts" in line for line in lines)


def test_a_record_goes_into_pandas(tmp_path, run):
    from cohelm.record.write import Recorder

    with Recorder(tmp_path / "run.mcap") as recorder:
        result = cohelm.run("lab-guard", changes=["simulation.duration_s=3"])
        recorder.write(result.trace)
    with warnings.catch_warnings(record=True) as told:
        said = run("record_to_pandas.py", str(tmp_path / "run.mcap"))
    assert "UNTOUCHED" in said
    assert " inf" not in said
    assert "NaN" not in said
    assert not [one for one in told if one.category is RuntimeWarning]  # of infinity less itself


def test_an_external_robot_drives_the_lab(monkeypatch):
    """The example's class, on a clock of the test's."""
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    from own_robot import Cart

    class Simulated(Cart):
        real_time = False
        t = 0.0

        def now(self) -> float:
            return self.t

        def wait(self, until: float) -> None:
            self.t = max(self.t, until)

    made = own_robot(Cart, "lab-guard", "sally")
    simulated = type(made)(made.scenario, Simulated, real_time=False)
    with Session(SessionConfig(simulated)) as session:
        session.run(lambda loop: loop.gated.now() > 12.0, Mode.AUTOMATIC)
        assert session.gated.gate.reason == ""
        assert session.loop.seen.pose.y > 0.0
        assert not session.loop.seen.lost
