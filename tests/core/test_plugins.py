"""What is loaded by its name, and what is said where it can not be."""

import pytest

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
