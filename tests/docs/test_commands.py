"""Every command that README and documentation show is one that the command line takes."""

import itertools
import re
import shlex
from pathlib import Path

import pytest
import typer

from cohelm.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMAND = typer.main.get_command(app)
AFTER = {">", "2>", "|", "&", "&&", ";"}


def shown(page: Path) -> list[list[str]]:
    """What is typed after `cohelm`, in blocks and in lines; a bare name is only spoken of."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = re.findall(r"^ *(?:\$ )?cohelm (.*)$", text, re.M) + re.findall(
        r"`cohelm ([^`]*)`", text
    )
    typed = [shlex.split(line, comments=True) for line in lines]
    typed = [list(itertools.takewhile(lambda word: word not in AFTER, line)) for line in typed]
    return [[word.rstrip(";") for word in line] for line in typed if len(line) > 1]


def test_commands_are_found():
    assert sum(len(shown(page)) for page in PAGES) > 100


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_in_the_docs_is_accepted(page):
    for words in shown(page):
        command = COMMAND
        while hasattr(command, "commands"):
            assert words[0] in command.commands, words
            command = command.commands[words.pop(0)]
        try:
            command.make_context("cohelm", list(words))
        except typer.Exit:  # --help
            continue
