"""How every command speaks: results on stdout, everything said beside them on stderr."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder to write into.")
]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object, on stdout.")]

Pictures = Annotated[
    float,
    typer.Option(
        "--pictures", metavar="HZ", min=0.0, max=60.0,
        help="Of the camera, so many a second go into a record; 0 for none.",
    ),
]  # fmt: skip


def print_table(title: str, headings: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """A table on stdout, for a person."""
    from rich.table import Table

    table = Table(title=plain(title), title_justify="left")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*(plain(cell) for cell in row))
    console().print(table)


def console(*, stderr: bool = False) -> Any:
    """Where a person reads: stdout, or stderr for what is not the result."""
    from rich.console import Console

    # ":DE:" in a fingerprint is no flag
    return Console(stderr=stderr, soft_wrap=stderr, highlight=False, emoji=False)


def print_json(value: Mapping[str, Any]) -> None:
    """Exactly one JSON object on stdout; NaN and infinity are no JSON, and a mistake of ours."""
    print(json.dumps(value, indent=2, allow_nan=False))


def say(text: str) -> None:
    """To the person, beside the result: on stderr."""
    console(stderr=True).print(text)


def plain(text: str) -> str:
    """A text in which rich sees no markup, and the terminal no command."""
    from rich.markup import escape

    return escape("".join(c if c.isprintable() else "�" for c in text))


@contextmanager
def progress(what: str) -> Generator[Callable[[str, float], None]]:
    """A bar on stderr, if a person is there to see it, that hears what is done and its share."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    stderr = console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    hidden = not stderr.is_terminal
    with Progress(*columns, console=stderr, transient=True, disable=hidden) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda doing, share: bar.update(task, description=doing, completed=min(share, 1.0))
