"""Reads options of a command from a ROS 2 parameter file; the command line takes precedence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import typer

_ANY = "/**"
_PARAMETERS = "ros__parameters"
_EXCLUDED = ("help", "params")


def from_file(node: str) -> Callable[[typer.Context, Path | None], Path | None]:
    """The callback of an option `--params FILE`: the file's parameters of this node become the
    defaults of all other options."""

    def load(context: typer.Context, file: Path | None) -> Path | None:
        if file is not None:
            context.default_map = _values(file, node, context.command)
        return file

    return load


def _values(file: Path, node: str, command: Any) -> dict[str, Any]:
    """Values by name of the command's parameters. Raises CohelmError for what does not fit."""
    from cohelm.core.errors import CohelmError, did_you_mean
    from cohelm.scenario.load import tree_of
    from cohelm.scenario.text import plain

    problems: list[str] = []
    data: Any = plain(tree_of(file), problems)
    if problems:
        raise CohelmError("\n".join(problems))
    nodes = cast("dict[str, Any]", data) if isinstance(data, dict) else {}
    mine: list[dict[str, Any]] = []
    for name, values in nodes.items():
        inside: Any = cast("Any", values).get(_PARAMETERS) if isinstance(values, dict) else None
        if isinstance(inside, dict) and (name == _ANY or name.rpartition("/")[2] == node):
            mine.append(cast("dict[str, Any]", inside))
    if not mine:
        raise CohelmError(
            f"{file}: has no parameters of this node; write {node}: {{{_PARAMETERS}: {{...}}}}"
        )
    names = _names(command)
    found: dict[str, Any] = {}
    for key, value in (pair for section in mine for pair in section.items()):
        if key == "use_sim_time" and isinstance(value, bool):
            continue  # every ROS 2 node has it; here the kind of time is detected
        option = names.get(key)
        if option is None:
            near = did_you_mean(key, names) or f"; there are {', '.join(sorted(names))}"
            problems.append(f"{file}: {key}: there is no such parameter{near}")
        elif option.multiple and isinstance(value, str | list):
            given = cast("list[object]", value) if isinstance(value, list) else [value]
            found[option.name] = [str(one) for one in given]
        elif isinstance(value, list | dict) or value is None:
            problems.append(f"{file}: {key}: must be one value, got {value!r}")
        elif isinstance(value, bool) != option.is_flag:
            kind = "true or false" if option.is_flag else "no truth value"
            problems.append(f"{file}: {key}: must be {kind}, got {value!r}")
        else:
            found[option.name] = value
    if problems:
        raise CohelmError("\n".join(problems))
    return found


def _names(command: Any) -> dict[str, Any]:
    """Options by parameter name: `--clock-difference` is `clock_difference`."""
    return {
        option.opts[-1].lstrip("-").replace("-", "_"): option
        for option in command.params
        if option.param_type_name == "option" and option.name not in _EXCLUDED
    }
