"""What is loaded by its name, and what is said where it can not be."""

import subprocess
import sys

import pytest

from cohelm.core import waiting
from cohelm.core.errors import CohelmError
from cohelm.core.plugins import plugin


def test_a_program_that_ends_when_it_is_imported_is_reported(tmp_path, monkeypatch):
    """As one without `if __name__ == "__main__"`, which reads its own arguments."""
    (tmp_path / "ends_at_once.py").write_text("import sys\nsys.exit(3)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(CohelmError, match=r"can not be imported \(SystemExit: 3\)"):
        plugin("cohelm.robots", "ends_at_once:Cart")


def test_what_is_printed_when_it_is_imported_is_no_result(tmp_path, monkeypatch, capsys):
    (tmp_path / "greets.py").write_text("print('hello')\nclass Cart: ...\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    plugin("cohelm.robots", "greets:Cart")
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "hello\n")


def test_what_ends_the_program_when_it_is_imported_is_named(tmp_path):
    """In no way that Python hears of, as a library in C does."""
    (tmp_path / "exits.py").write_text("import os\nos._exit(3)\n")
    source = "from cohelm.core.plugins import plugin; plugin('cohelm.robots', 'exits:Cart')"
    ran = subprocess.run(
        [sys.executable, "-c", source], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 3
    assert "error: this program ended while exits:Cart was imported" in ran.stderr


def test_what_waits_when_it_is_imported_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / "waits.py").write_text("import time\ntime.sleep(0.2)\nclass Cart: ...\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(waiting, "WAITS", 0.01)
    plugin("cohelm.robots", "waits:Cart")
    assert "the import of waits:Cart has not returned for 0.01 s" in capsys.readouterr().err
