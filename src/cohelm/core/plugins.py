"""Loads plugins by `package:name` or by an installed package's entry point."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from operator import attrgetter
from pathlib import Path
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.waiting import said_if_it_ends, said_if_it_waits


def plugins(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group that installed packages have, by name."""
    return {point.name: point for point in entry_points(group=group)}


def plugin(group: str, name: str) -> Any:
    """The object of `package:name`, also in the working folder, or the entry point of that name.
    What it prints when it is imported goes to stderr: it is no result of a command. That it waits,
    or ends this process, is said there too.

    Raises CohelmError where there is no such thing, or importing it fails.
    """
    module, colon, inside = name.partition(":")
    try:
        if not colon:
            known = plugins(group)
            if name in known:
                with _importing(name):
                    return known[name].load()
            there = f"; installed packages have {', '.join(sorted(known))}" if known else ""
            package, dot, last = name.rpartition(".")
            if dot:  # as Python writes it, or a file
                there += f"; did you mean {package}:{'NAME' if last == 'py' else last}?"
            raise CohelmError(f"{name}: give package:name, or an entry point of {group}{there}")
        if module.endswith(".py") or "/" in module:
            plain = Path(module).name.removesuffix(".py")
            raise CohelmError(
                f"{name}: a module has no path and no .py: give {plain}:{inside}, and start in its "
                "folder"
            )
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.insert(0, here)
        with _importing(name):
            return attrgetter(inside)(import_module(module))
    except CohelmError:
        raise
    except (Exception, SystemExit) as error:  # a program without `if __name__ == "__main__"`
        raise CohelmError(
            f"{name} can not be imported ({type(error).__name__}: {error}): check the name, and "
            "that its package is installed or its file in this folder"
        ) from error


@contextmanager
def _importing(name: str) -> Generator[None]:
    ended = f"error: this program ended while {name} was imported: run that alone, with " \
        "python -X faulthandler"  # fmt: skip
    with (
        redirect_stdout(sys.stderr),
        said_if_it_waits(f"the import of {name}"),
        said_if_it_ends(ended),
    ):
        yield
