"""Changes numbers in a robot's YAML file; all else in it stays as it is, comments too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode


def rewritten(text: str, values: Mapping[str, float]) -> str:
    """The text with these values, by keys as `limits.speed_mps`.

    A key on a line of its own is changed there, or put at the end of its block. A file in another
    style, as in braces, is written anew and loses its comments.
    """
    made, wanted = text if text.endswith("\n") else text + "\n", yaml.compose(text, yaml.SafeLoader)
    for key, value in values.items():
        number = np.format_float_positional(float(f"{value:.6g}"), trim="-")
        made = _changed(made, key.split("."), number)
        _set(wanted, key.split("."), number)
    try:
        if _plain(yaml.compose(made, yaml.SafeLoader)) == _plain(wanted):
            return made
    except yaml.YAMLError:
        pass
    library: Any = yaml  # which has no types for this
    return library.serialize(wanted, Dumper=yaml.SafeDumper, allow_unicode=True)


def _set(block: Any, path: list[str], number: str) -> None:
    """Set a key below a mapping's node, which gets it if it has none."""
    name, *rest = path
    there = {key.value: value for key, value in block.value}
    value = there.get(name) if rest else ScalarNode(_resolved(number), number)
    if rest:
        value = value or MappingNode("tag:yaml.org,2002:map", [])
        _set(value, rest, number)
    block.value = [(key, value if key.value == name else old) for key, old in block.value]
    if name not in there:
        block.value.append((ScalarNode(_resolved(name), name), value))


def _resolved(text: str) -> str:
    """The tag of a plain scalar."""
    loader: Any = yaml.SafeLoader("")
    return loader.resolve(ScalarNode, text, (True, False))


def _plain(node: Node | None) -> Any:
    """What a node holds, every key as often as it is there, in any order."""
    if isinstance(node, MappingNode):
        return sorted((key.value, _plain(value)) for key, value in node.value)
    if isinstance(node, SequenceNode):
        return [_plain(one) for one in node.value]
    return "" if node is None else str(node.value)


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
