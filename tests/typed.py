"""The command as it is typed, in this process: arguments in; exit code, stdout and stderr out."""

import sys
from collections.abc import Callable
from typing import NamedTuple

import pytest


class Said(NamedTuple):
    code: int
    out: str
    err: str


Cohelm = Callable[..., Said]


@pytest.fixture
def cohelm(monkeypatch, capsys, tmp_path) -> Cohelm:
    from cohelm.cli import main
    from cohelm.cli.output import shared_again

    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["cohelm", *map(str, arguments)])
        # started as `python -m pytest`, the command would be called that too
        monkeypatch.setattr(sys.modules["__main__"], "__package__", None)
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = int(stop.code or 0)
        finally:
            shared_again()
        return Said(code, *capsys.readouterr())

    return call
