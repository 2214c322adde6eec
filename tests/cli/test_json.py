"""Of a command with --json stdout holds one JSON object, whatever laws and drivers print there."""

import json
import os
import subprocess
import sys

import pytest

from cohelm.cli import main
from cohelm.cli.output import shared_again

LAW = """
import os
import cohelm
print("on import")
def law(robot, period):
    def drives(now):
        print("by Python")
        os.write(1, b"by a library\\n")
        return cohelm.Twist(0.3, 0.0)
    return drives
"""
DRIVER = """
import os
from tests.api.carts import Simulated
print("on import")
class Cart(Simulated):
    def read(self):
        print("by Python")
        os.write(1, b"by a library\\n")
        return super().read()
"""
CAMPAIGN = "campaign random --law talks:law --n 1 --jobs 1 --out there"
ROBOT = "robot sally --driver talks:Cart --for 1"


WORDS = ("on import", "by Python", "by a library")


def test_what_a_driver_prints_is_not_in_the_json(tmp_path, monkeypatch, capfd):
    (tmp_path / "talks_here.py").write_text(DRIVER)
    monkeypatch.chdir(tmp_path)
    typed = ROBOT.replace("talks", "talks_here").split()
    monkeypatch.setattr(sys, "argv", ["cohelm", *typed, "--json"])
    monkeypatch.setattr(sys.modules["__main__"], "__package__", None)  # as in tests/typed.py
    code = None
    try:
        main()
    except SystemExit as stop:
        code = stop.code
    finally:
        shared_again()
    said = capfd.readouterr()
    assert not code, said.err
    assert isinstance(json.loads(said.out), dict)
    for word in WORDS:
        assert word in said.err


@pytest.mark.slow  # in this process: above
@pytest.mark.parametrize(("text", "typed"), [(DRIVER, ROBOT), (LAW, CAMPAIGN)])
def test_what_a_law_or_driver_prints_is_not_in_the_json(tmp_path, request, text, typed):
    (tmp_path / "talks.py").write_text(text)
    said = subprocess.run(
        [sys.executable, "-m", "cohelm", *typed.split(), "--json"], cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(request.config.rootpath)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert said.returncode == 0, said.stderr
    assert isinstance(json.loads(said.stdout), dict)
    for word in WORDS:
        assert word in said.stderr
