"""Changes numbers in a robot's YAML file; all else in it stays as it is, comments too."""

from __future__ import annotations

import re
from collections.abc import Mapping

import yaml


def rewritten(text: str, values: Mapping[str, float]) -> str:
    """The text with these values, by keys as `limits.speed_mps`.

    A key on a line of its own is changed there, or put at the end of its block. A file in another
    style, in braces or with anchors, is rewritten and loses its comments.
    """
    made = text if text.endswith("\n") else text + "\n"
    for key, value in values.items():
        made = _changed(made, key.split("."), f"{value:.6g}")
    wanted = yaml.safe_load(text)
    for key, value in values.items():
        *path, last = key.split(".")
        at = wanted
        for name in path:
            at = at.setdefault(name, {})
        at[last] = float(f"{value:.6g}")
    try:
        if yaml.safe_load(made) == wanted:
            return made
    except yaml.YAMLError:
        pass
    return yaml.safe_dump(wanted, sort_keys=False, default_flow_style=None, allow_unicode=True)


def _changed(text: str, path: list[str], value: str) -> str:
    lines = text.splitlines(keepends=True)
    first, last, indent = 0, len(lines), ""
    for name in path[:-1]:
        head = re.compile(rf"{indent}{re.escape(name)}:\s*(#.*)?$")
        start = next((i for i in range(first, last) if head.match(lines[i])), None)
        if start is None:
            lines[last:last] = [f"{indent}{name}:\n", f"{indent}  {path[-1]}: {value}\n"]
            return "".join(lines)
        first = start + 1
        inner = _indent(lines[first]) if first < last else ""
        end = next((i for i in range(first, last)
                    if lines[i].strip() and not lines[i].startswith(inner or " ")
                    and not lines[i].lstrip().startswith("#")), last)  # fmt: skip
        last, indent = end, inner or indent + "  "
    own = re.compile(rf"({indent}{re.escape(path[-1])}:\s*)([^#\s]+)(.*)$", re.S)
    for i in range(first, last):
        if found := own.match(lines[i]):
            lines[i] = f"{found[1]}{value}{found[3]}"
            return "".join(lines)
    lines[last:last] = [f"{indent}{path[-1]}: {value}\n"]
    return "".join(lines)


def _indent(line: str) -> str:
    return line[: len(line) - len(line.lstrip())]
