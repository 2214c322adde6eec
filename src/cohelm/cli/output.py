"""Output of commands: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import os
import shlex
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from cohelm.core.errors import CohelmError

_SAID_EVERY = 10.0  # without a terminal the line is printed again at this interval [s]
_PROGRESS_EVERY = 30.0  # ... and so is that of a long job [s]


def named(path: str | Path) -> Path:
    """A path as it is typed; none is not this folder. For typer's `parser`."""
    if not str(path):  # as where a shell's variable is empty
        raise CohelmError("a file's or folder's name is empty: name one, or . for this folder")
    return Path(path)


Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="DIR", parser=named, help="Folder to write into."),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", callback=lambda wanted: bool(wanted) and _alone(),  # pyright: ignore
        help="Print exactly one JSON object, on stdout.",
    ),
]  # fmt: skip

Pictures = Annotated[
    float,
    typer.Option(
        "--pictures", metavar="HZ", min=0.0, max=60.0,
        help="Camera pictures a second for records and viewers; 0 for none.",
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
    """The console of stdout, or of stderr for what is not the result."""
    from rich.console import Console

    # ":DE:" in a fingerprint is no flag
    return Console(stderr=stderr, soft_wrap=stderr, highlight=False, emoji=False)


_stdout: int | None = None
"""What was stdout, while that is stderr."""


def _alone() -> bool:
    """Nobody else prints on stdout from now on, laws and drivers by others neither, in C or in
    processes that they start: it goes to stderr."""
    global _stdout
    if sys.stdout is not None:  # pyright: ignore[reportUnnecessaryComparison]  # `>&-`
        with suppress(OSError):  # `2>&-`
            _stdout = os.dup(1)
            os.dup2(2, 1)
    return True


def shared_again() -> None:
    """Stdout is as it was before --json."""
    global _stdout
    if _stdout is not None:
        sys.stdout.flush()
        os.dup2(_stdout, 1)
        os.close(_stdout)
        _stdout = None


def print_json(value: Mapping[str, Any]) -> None:
    """Exactly one JSON object on stdout; NaN and infinity are no JSON, and a mistake of ours."""
    text = json.dumps(value, indent=2, allow_nan=False)
    shared_again()
    print(text, flush=True)
    _alone()


def say(text: str) -> None:
    """Print a line on stderr, while that is there: not on a terminal that was closed."""
    with suppress(OSError):
        console(stderr=True).print(text)


@contextmanager
def warnings_said() -> Generator[list[warnings.WarningMessage]]:
    """All that is warned of within this is said at its end."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield caught
    for warning in caught:
        say(f"[yellow]warning:[/yellow] {plain(str(warning.message))}")


def typed(path: str | Path) -> str:
    """A path as it is typed into a shell; never as an option."""
    name = str(path)
    return shlex.quote(f"./{name}" if name.startswith("-") else name)


def plain(text: str) -> str:
    """A text in which rich sees no markup, and the terminal no command."""
    from rich.markup import escape

    return escape("".join(c if c.isprintable() else "�" for c in text))


@contextmanager
def progress(what: str) -> Generator[Callable[[str, float], None]]:
    """A progress bar on stderr, elsewhere than on a terminal a line now and then; called with the
    text and the share done."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    stderr = console(stderr=True)
    if not stderr.is_terminal:
        with _lines(what) as show:
            yield show
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda doing, share: bar.update(task, description=doing, completed=min(share, 1.0))


@contextmanager
def _lines(what: str) -> Generator[Callable[[str, float], None]]:
    """The same in lines, as in the log of a batch system."""
    from cohelm.core.jit import compiled_since

    now, over = [(what, 0.0)], threading.Event()
    since, began = time.time(), time.monotonic()

    def text() -> str:
        doing, share = now[0]
        compiled = 0 if share > 0.0 else compiled_since(since)
        counted = f", {compiled} functions compiled" if compiled else ""
        return f"{doing}: {share:.0%}{counted} ({time.monotonic() - began:.0f} s)"

    thread = threading.Thread(
        target=_repeat, args=(text, _PROGRESS_EVERY, over), name="progress", daemon=True
    )
    thread.start()

    def update(doing: str, share: float) -> None:
        now[0] = (doing, min(share, 1.0))

    try:
        yield update
    finally:
        over.set()
        thread.join(1.0)


def _repeat(text: Callable[[], str], every: float, over: threading.Event) -> None:
    """Print the text at this interval [s] until it is over."""
    while not over.wait(every):
        say(plain(text()))


class Starting:
    """A line that shows what is starting, with compiled functions and elapsed time."""

    def __init__(self, what: str) -> None:
        """what: is started, e.g. "the robot in lab-guard"."""
        self._what, self._since, self._began = what, time.time(), time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show, name="starting", daemon=True)
        self._thread.start()

    def text(self) -> str:
        """For a person, now."""
        from cohelm.core.jit import compiled_since

        functions, seconds = compiled_since(self._since), time.monotonic() - self._began
        counted = f"{functions} function{'' if functions == 1 else 's'}"
        compiling = f": compiling for this machine, once, some minutes; {counted} so far"
        return f"starting {self._what}{compiling if functions else ''} ({seconds:.0f} s)"

    def over(self) -> None:
        """The start is over."""
        self._over.set()
        self._thread.join(1.0)

    def _show(self) -> None:
        """Show the line until it is over: on a terminal it moves, elsewhere it is repeated."""
        screen = console(stderr=True)
        if screen.is_terminal:
            with screen.status("") as line:
                while not self._over.wait(0.25):
                    line.update(plain(self.text()))
        else:
            _repeat(self.text, _SAID_EVERY, self._over)


@contextmanager
def starting(what: str) -> Generator[Starting]:
    """A line on stderr that moves from now until `over` is called, or the block is left."""
    begun = Starting(what)
    try:
        yield begun
    finally:
        begun.over()
