"""Help texts fit 80 columns and need no slow imports."""

import itertools
import json
import shlex
import subprocess
import sys

import pytest
import typer
import yaml

from cohelm import __version__
from cohelm.cli import app
from cohelm.scenario.load import shipped

SHOW_IMPORTS = """
import atexit, sys
from cohelm.cli import main
atexit.register(lambda: print(*sys.modules, file=sys.stderr))
main()
"""
TREE = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
COMMANDS = [[name] for name in TREE if name != "pair"]
COMMANDS += [["pair", name] for name in TREE["pair"].commands]


@pytest.mark.parametrize("arguments", [[], ["pair"], *COMMANDS], ids=" ".join)
def test_help_fits_eighty_columns_and_cuts_nothing_short(cohelm, monkeypatch, arguments):
    monkeypatch.setenv("COLUMNS", "80")
    said = cohelm(*arguments, "--help")
    assert said.code == 0
    assert said.out.startswith("Usage: cohelm")
    assert max(len(line) for line in said.out.splitlines()) <= 80
    assert "..." not in said.out.replace("[ARGS]...", "").replace("/dev/input/event...", "")
    assert "range>" not in said.out  # a number says what it counts


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_every_help_text_shows_an_example_that_the_command_accepts(cohelm, arguments):
    shown = cohelm(*arguments, "--help").out.partition("For example:")[2].splitlines()
    typed = [shlex.split(line) for line in shown if line.strip()]
    assert typed
    for line in typed:
        assert line[: len(arguments) + 1] == ["cohelm", *arguments]
        command = TREE[line[1]]
        for name in line[2 : len(arguments) + 1]:
            command = command.commands[name]
        words = itertools.takewhile(lambda word: word != ">", line[len(arguments) + 1 :])
        command.make_context("cohelm", list(words))  # it raises what the command line would say


def test_without_a_command_the_help_is_shown(cohelm):
    said = cohelm()
    assert said.code == 2
    assert all(f"  {name} " in said.out + said.err for name in TREE)


def test_help_names_every_scenario_that_is_shipped(cohelm):
    words = cohelm("run", "--help").out.replace(",", " ").replace(".", " ").split()
    assert set(shipped()) <= set(words)


def test_the_version_is_the_packages(cohelm):
    assert cohelm("--version") == (0, f"cohelm {__version__}\n", "")


def test_help_imports_no_slow_modules():
    command = [sys.executable, "-c", SHOW_IMPORTS, "--help"]
    help_ = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in help_.stderr.split()}
    assert "typer" in loaded
    assert not loaded & {"numpy", "numba", "scipy", "pydantic", "matplotlib", "rosbags", "rich"}


def test_the_schema_that_is_printed_takes_every_scenario_that_is_shipped(cohelm):
    said = cohelm("schema")
    schema = json.loads(said.out)
    assert (said.code, said.err) == (0, "")
    for file in shipped().values():
        assert set(yaml.safe_load(file.read_text())) <= set(schema["properties"])
